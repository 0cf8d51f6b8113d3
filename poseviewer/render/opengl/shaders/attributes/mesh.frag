#version 330 core
in vec3 seen_normal;
in vec3 seen_colour;
in vec2 seen_uv;

layout(location = 0) out vec4 colour_and_face;  // faces from 1, 0 where there is none
layout(location = 1) out vec4 normal_and_u;     // normals turned to the side that is seen
layout(location = 2) out vec4 v;

void main()
{
    float length_of_normal = length(seen_normal);
    float scale = length_of_normal > 0.0 ? 1.0 / length_of_normal : 0.0;
    colour_and_face = vec4(seen_colour, float(gl_PrimitiveID + 1));
    normal_and_u = vec4((gl_FrontFacing ? scale : -scale) * seen_normal, seen_uv.x);
    v = vec4(seen_uv.y);
}
