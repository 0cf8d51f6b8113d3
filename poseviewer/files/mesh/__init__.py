"""Readers of models.

STL is read by trimesh, DAE by the parser that trimesh has for it, 3DS by assimp, STEP by cascadio.
OBJ, PLY, OFF, 3MF and glTF are read here, since trimesh 5.2 gets these wrong without a word:

=============  ================================================  ===============================
format         case                                              trimesh 5.2
=============  ================================================  ===============================
OBJ, PLY, OFF  concave polygons (DAE likewise)                   fans: the notch is filled
OBJ            words parted by tabs                              no faces
OBJ            two libraries on a line; a material, no usemtl    no texture
OBJ            colours of one object of two; ZBrush's #MRGB      no colours
PLY            triangle strips                                   no faces
PLY, OFF       colours called r g b; colours of COFF             no colours
3MF            components of components                          copies are missing
3MF            colours of materials and colour groups            no colours
glTF           sparse accessors                                  without the changed values
glTF           skins                                             not in the pose of their joints
glTF           EXT_mesh_gpu_instancing                           one instance
glTF           KHR_texture_transform, further coordinates        other texels
glTF           quantised coordinates                             from 0 to 65,535
glTF           alpha masks                                       solid
=============  ================================================  ===============================
"""
