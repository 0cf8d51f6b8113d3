"""glTF as its specification and the registered extensions say it, of files made here by hand."""

import json
import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import InputFile
from poseviewer.files.mesh.gltf import read_gltf
from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.mesh import Mesh

CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "<f4")
UVS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")
"""v downwards: the picture stands upright on the plate."""
FACES = np.array([0, 1, 2, 0, 2, 3], "<u2")
TYPES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125,
         "float32": 5126}  # fmt: skip
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Plate:
    """A document of a textured plate, from (-1, -1) to (1, 1), whose entries a test changes."""

    def __init__(self) -> None:
        self.data = b""
        self.entries: dict[str, Any] = {"accessors": [], "bufferViews": []}
        self.attributes = {"POSITION": self.array(CORNERS), "TEXCOORD_0": self.array(UVS)}
        self.texture: dict[str, Any] = {"index": 0}
        self.material: dict[str, Any] = {"pbrMetallicRoughness": {"baseColorTexture": self.texture}}
        indices = self.array(FACES)
        self.primitive = {"attributes": self.attributes, "indices": indices, "material": 0}
        self.mesh: dict[str, Any] = {"primitives": [self.primitive]}
        self.nodes: list[dict[str, Any]] = [{"mesh": 0, "name": "plate"}]
        rgba = np.full((2, 2, 4), 255, np.uint8)
        rgba[..., :3] = [[(200, 0, 0), (0, 200, 0)], [(0, 0, 200), (200, 200, 0)]]
        rgba[:, 1, 3] = 0
        self.picture(rgba)

    def view(self, data: bytes) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.data += data
        self.entries["bufferViews"].append(view)
        return len(self.entries["bufferViews"]) - 1

    def array(self, values: np.ndarray, **more: Any) -> int:
        values = np.ascontiguousarray(values)
        shape = SHAPES[values[0].size]
        view = {} if more.pop("empty", False) else {"bufferView": self.view(values.tobytes())}
        self.entries["accessors"].append({**view, "componentType": TYPES[values.dtype.name],
                                          "count": len(values), "type": shape, **more})  # fmt: skip
        return len(self.entries["accessors"]) - 1

    def picture(self, pixels: np.ndarray) -> None:
        memory = BytesIO()
        Image.fromarray(pixels).resize((64, 64), Image.Resampling.NEAREST).save(memory, "png")
        view = self.view(memory.getvalue())
        self.entries["images"] = [{"bufferView": view, "mimeType": "image/png"}]

    def load(self, folder: Path, **more: Any) -> Mesh:
        document = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": self.nodes, "meshes": [self.mesh], "materials": [self.material],
            "textures": [{"source": 0}], "buffers": [{"byteLength": len(self.data)}],
            **self.entries, **more,
        }  # fmt: skip
        text = json.dumps(document).encode()
        text, data = text + b" " * (-len(text) % 4), self.data + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
        (folder / "m.glb").write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
        return load_mesh(folder / "m.glb")


def quarters(mesh: Mesh) -> list[str]:
    """Colours of the plate's quarters: upper left, upper right, lower left, lower right."""
    corners, uvs = mesh.vertices[mesh.faces], mesh.uvs[mesh.faces]
    names = {(200, 0, 0): "red", (0, 200, 0): "green", (0, 0, 200): "blue", (200, 200, 0): "yellow"}
    shown = []
    for place in ((-0.5, 0.6), (0.6, 0.5), (-0.6, -0.5), (0.5, -0.6)):
        for points, own in zip(corners[:, :, :2], uvs, strict=True):
            weights = np.linalg.solve(np.vstack([points.T, np.ones(3)]), [*place, 1.0])
            if weights.min() > 0.0:
                u, v = (weights @ own) % 1.0
                shown.append(names[tuple(mesh.textures[0][int((1.0 - v) * 64), int(u * 64)])])
    return shown


ALL = ["red", "green", "blue", "yellow"]


@pytest.mark.parametrize(("transform", "wanted"), [
    ({}, ALL),
    ({"offset": [0.5, 0.0], "scale": [0.5, 0.5]}, ["green"] * 4),
    ({"offset": [0.5, 0.0]}, ["green", "red", "yellow", "blue"]),
    # The specification's example: the lower left quarter alone, turned clockwise.
    ({"offset": [0, 1], "rotation": 1.57079632679, "scale": [0.5, 0.5]}, ["blue"] * 4),
    ({"offset": [0, 1], "rotation": 1.57079632679}, ["blue", "red", "yellow", "green"]),
    ({"offset": [0, 1], "scale": [1, -1]}, ["blue", "yellow", "red", "green"]),
])  # fmt: skip
def test_textures_are_moved(tmp_path, transform, wanted):
    plate = Plate()
    plate.texture["extensions"] = {"KHR_texture_transform": transform}
    assert quarters(plate.load(tmp_path, extensionsRequired=["KHR_texture_transform"])) == wanted


@pytest.mark.parametrize("way", ["texCoord", "extension"])
def test_other_texture_coordinates(tmp_path, way):
    plate = Plate()
    plate.attributes |= {"TEXCOORD_3": plate.attributes["TEXCOORD_0"],
                         "TEXCOORD_0": plate.array(np.full((4, 2), 0.1, "<f4"))}  # fmt: skip
    if way == "texCoord":
        plate.texture["texCoord"] = 3
    else:
        plate.texture["extensions"] = {"KHR_texture_transform": {"texCoord": 3}}
    assert quarters(plate.load(tmp_path)) == ALL


@pytest.mark.parametrize("kind", ["int8", "int16", "uint8", "uint16"])
@pytest.mark.parametrize("is_normalised", [True, False])
def test_quantised_positions_and_coordinates(tmp_path, kind, is_normalised):
    plate, top = Plate(), np.iinfo(kind).max
    flat = (CORNERS + 1.0) / 2.0 * (1, 1, 0)
    stored = np.zeros((4, 4), kind)  # rows are aligned to 4 bytes
    stored[:, :3] = np.round(flat * (top if is_normalised else 100))
    width = 4 * stored.itemsize
    position = plate.array(stored, normalized=is_normalised, type="VEC3")
    plate.entries["bufferViews"][-1]["byteStride"] = width
    plate.attributes["POSITION"] = position
    if kind.startswith("u"):
        uvs = np.round(UVS * top).astype(kind)
        plate.attributes["TEXCOORD_0"] = plate.array(uvs, normalized=True)
    size = 1.0 if is_normalised else 100.0
    plate.nodes[0] |= {"scale": [2.0 / size] * 3, "translation": [-1, -1, 0]}
    mesh = plate.load(tmp_path, extensionsRequired=["KHR_mesh_quantization"])
    np.testing.assert_allclose(mesh.bounds, [[-1, -1, 0], [1, 1, 0]], atol=1e-9)
    assert quarters(mesh) == ALL


@pytest.mark.parametrize("is_empty", [True, False])
def test_sparse_accessors(tmp_path, is_empty):
    plate = Plate()
    which, values = np.array([1, 3], "u1"), np.array([[5, -1, 2], [-7, 1, 0]], "<f4")
    of_values = {"bufferView": plate.view(values.tobytes())}
    of_indices = {"bufferView": plate.view(which.tobytes()), "componentType": 5121}
    sparse = {"count": 2, "values": of_values, "indices": of_indices}
    plate.attributes["POSITION"] = plate.array(CORNERS, sparse=sparse, empty=is_empty)
    if is_empty:  # all others are at 0
        plate.primitive["indices"] = plate.array(np.array([0, 1, 3], "<u2"))
    wanted = CORNERS * (0.0 if is_empty else 1.0)
    wanted[which] = values
    assert {tuple(v) for v in plate.load(tmp_path).vertices} == {tuple(v) for v in wanted.tolist()}


def test_instances(tmp_path):
    plate = Plate()
    turned = np.array([[0, 0, 0, 1], [0, 0, np.sqrt(0.5), np.sqrt(0.5)]], "<f4")
    attributes = {"TRANSLATION": plate.array(np.array([[0, 0, 0], [10, 0, 1]], "<f4")),
                  "ROTATION": plate.array(turned),
                  "SCALE": plate.array(np.array([[1, 1, 1], [2, 3, 1]], "<f4"))}  # fmt: skip
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    plate.nodes[0] |= {"translation": [0, 0, 4], "extensions": instancing}
    mesh = plate.load(tmp_path, extensionsRequired=["EXT_mesh_gpu_instancing"])
    np.testing.assert_allclose(mesh.bounds, [[-1, -2, 4], [13, 2, 5]], atol=1e-6)


@pytest.mark.parametrize(("counts", "words"), [
    ((2, 3), "GLB file"),  # of which values would be left over
    ((10**8,), "100,000,000 instances; poseviewer takes up to 50,000"),
])  # fmt: skip
def test_instances_of_several_numbers_or_too_many_are_refused(tmp_path, counts, words):
    plate = Plate()
    accessors = plate.entries["accessors"]
    moves = [len(accessors) + number for number in range(len(counts))]
    accessors += [{"componentType": 5126, "count": count, "type": "VEC3"} for count in counts]
    attributes = dict(zip(("TRANSLATION", "SCALE"), moves, strict=False))
    plate.nodes[0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    with pytest.raises(MeshFileError, match=words):
        plate.load(tmp_path)


def many_nodes(plate: Plate) -> None:
    plate.primitive["indices"] = plate.array(np.resize(FACES, 3000))
    plate.nodes += [{"mesh": 0}] * 3000
    plate.nodes[0]["children"] = list(range(1, 3001))


def many_instances(plate: Plate) -> None:
    plate.primitive["indices"] = plate.array(np.resize(FACES, 3000))
    plate.entries["accessors"].append({"componentType": 5126, "count": 40_000, "type": "VEC3"})
    attributes = {"TRANSLATION": len(plate.entries["accessors"]) - 1}
    plate.nodes[0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}


def counted(plate: Plate, name: str, count: int) -> int:
    """Number of an accessor, nearly all of its numbers 0."""
    kind = {"componentType": 5126, "type": "VEC3"} if name == "POSITION" else {
        "componentType": 5125, "type": "SCALAR"}  # fmt: skip
    plate.entries["accessors"].append({"count": count, **kind})
    return len(plate.entries["accessors"]) - 1


def many_positions(plate: Plate) -> None:
    plate.attributes.clear()
    plate.attributes["POSITION"] = counted(plate, "POSITION", 2_000_000_000)
    del plate.primitive["indices"]


def many_indices(plate: Plate) -> None:
    plate.primitive["indices"] = counted(plate, "indices", 600_000_000)


def many_weights(plate: Plate) -> None:
    plate.attributes.clear()
    plate.attributes["POSITION"] = counted(plate, "POSITION", 1_000_000)
    plate.primitive["targets"] = [{"POSITION": plate.attributes["POSITION"]}] * 100
    plate.mesh["weights"] = [1.0] * 100
    plate.primitive["indices"] = counted(plate, "indices", 3_000_000)


def other_attributes(plate: Plate) -> None:
    accessor = {"count": 2_000_000_000, "componentType": 5126, "type": "VEC4"}
    plate.entries["accessors"].append(accessor)
    plate.attributes["COLOR_0"] = len(plate.entries["accessors"]) - 1


@pytest.mark.parametrize(("change", "words"), [
    (many_nodes, "3,001,000 faces with all copies; poseviewer takes up to 2,0"),
    (many_instances, "40,000,000 faces with all copies; poseviewer takes"),
    (many_positions, "666,666,666 faces with all copies; poseviewer takes"),
    (many_indices, "200,000,000 faces with all copies; poseviewer takes"),
    (many_weights, "101,000,000 values of vertices with all copies; poseviewer takes"),
    (other_attributes, "its corners have attributes of several numbers"),
])  # fmt: skip
def test_what_a_small_file_would_grow_to_is_refused_before_any_is_built(
    tmp_path, monkeypatch, change, words
):
    monkeypatch.setattr("poseviewer.files.mesh.gltf._Document.array", None)
    plate = Plate()
    change(plate)
    with pytest.raises(MeshFileError, match=words):
        plate.load(tmp_path)


def test_vertices_that_many_primitives_share_are_built_where_they_are_used(tmp_path):
    plate = Plate()
    halves = [{**plate.primitive, "indices": plate.array(own)} for own in (FACES[:3], FACES[3:])]
    plate.mesh["primitives"] = halves
    assert quarters(plate.load(tmp_path)) == ALL
    parts = read_gltf(tmp_path / "m.glb").parts
    assert [len(part.vertices) for part in parts] == [3, 3]


def test_buffers_of_one_file_are_read_once(tmp_path, monkeypatch):
    plate = Plate()
    plate.load(tmp_path)
    plate.data += bytes(-len(plate.data) % 4)
    (tmp_path / "m.bin").write_bytes(plate.data)
    buffer = {"byteLength": len(plate.data), "uri": "m.bin"}
    for number, view in enumerate(plate.entries["bufferViews"]):
        view["buffer"] = number
    read, load = list[str](), InputFile.load_bytes
    monkeypatch.setattr(InputFile, "load_bytes", lambda s: read.append(s.path.name) or load(s))
    mesh = plate.load(tmp_path, buffers=[buffer] * len(plate.entries["bufferViews"]))
    assert quarters(mesh) == ALL
    assert read == ["m.bin"]


def test_a_skin_stands_in_the_pose_of_its_joints(tmp_path):
    """Half of the plate by a joint that moves and turns, the other half by one at rest."""
    plate = Plate()
    joints = np.array([[0, 1, 0, 0]] * 4, "u1")
    weights = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0]], "<f4")
    inverse = np.array([np.eye(4), np.eye(4)])
    inverse[1, 0, 3] = -1.0  # the second joint was at x = 1
    plate.attributes |= {"JOINTS_0": plate.array(joints), "WEIGHTS_0": plate.array(weights)}
    matrices = plate.array(inverse.swapaxes(1, 2).reshape(2, 16).astype("<f4"))
    plate.nodes[0] |= {"skin": 0, "translation": [100, 0, 0]}  # which a skin passes over
    half = float(np.sqrt(0.5))
    plate.nodes += [{"name": "root", "children": [2], "translation": [0, 0, 1]},
                    {"translation": [1, 0, 2], "rotation": [half, 0, 0, half]}]  # fmt: skip
    skins = [{"joints": [1, 2], "inverseBindMatrices": matrices}]
    mesh = plate.load(tmp_path, skins=skins, scenes=[{"nodes": [0, 1]}])
    wanted = {(-1, -1, 1), (-1, 1, 1), (1, 0, 2), (1, 0, 4)}
    assert {tuple(np.round(v, 6)) for v in mesh.vertices} == wanted


def test_morph_weights_change_the_shape(tmp_path):
    plate = Plate()
    plate.primitive["targets"] = [{"POSITION": plate.array(np.array([[0, 0, 2]] * 4, "<f4"))}]
    plate.mesh["weights"] = [0.25]
    mesh = plate.load(tmp_path)
    assert mesh.vertices[0, 2] == pytest.approx(0.5)
    assert "Shapes with morph targets, shown at rest: 1." in mesh.notes


def test_a_model_that_moves_is_said_to_be_at_rest(tmp_path):
    plate = Plate()
    plate.nodes += [{"name": "arm", "children": [0]}, {"camera": 0}]
    channels = [{"sampler": 0, "target": {"node": node, "path": "rotation"}} for node in (1, 2)]
    animations = [{"channels": channels, "samplers": []}]
    mesh = plate.load(tmp_path, animations=animations, scenes=[{"nodes": [1, 2]}])
    assert mesh.notes == ("Animated nodes, shown at rest: 1.",)


@pytest.mark.parametrize(("cutoff", "right"), [(None, 0.0), (0.0, 1.0)])
def test_alpha_cuts(tmp_path, cutoff, right):
    """The picture's right half is clear; the plate has an edge in its middle."""
    plate = Plate()
    corners = np.array([(x, y, 0) for x in np.linspace(-1.0, 1.0, 17) for y in (-1, 1)], "<f4")
    plate.attributes |= {
        "POSITION": plate.array(corners),
        "TEXCOORD_0": plate.array(((corners[:, :2] * (1, -1) + 1) / 2).astype("<f4")),
    }
    plate.primitive |= {"mode": 5, "indices": plate.array(np.arange(34, dtype="<u2"))}
    plate.material |= {"alphaMode": "MASK"} | ({} if cutoff is None else {"alphaCutoff": cutoff})
    mesh = plate.load(tmp_path)
    assert mesh.bounds[1, 0] == right
    assert mesh.notes == (("Invisible triangles, left out: 16.",) if right == 0.0 else ())


HALF, NOTHING = np.full((4, 4), 0.5, "<f4"), np.zeros((4, 4), "<f4")
HITBOXES = {
    "alpha 0": ({"alphaMode": "BLEND"}, 0.0, None, True),
    "alpha a half": ({"alphaMode": "BLEND"}, 0.5, None, False),
    "below the cutoff": ({"alphaMode": "MASK"}, 0.4, None, True),
    "at the cutoff": ({"alphaMode": "MASK", "alphaCutoff": 0.1}, 0.1, None, False),
    "opaque": ({}, 0.0, NOTHING, False),
    "alpha 0 of corners": ({"alphaMode": "BLEND"}, 1.0, NOTHING, True),
    "alpha of both": ({"alphaMode": "MASK", "alphaCutoff": 0.3}, 0.5, HALF, True),
}


@pytest.mark.parametrize("name", HITBOXES)
def test_what_alpha_makes_invisible_is_left_out(tmp_path, name):
    material, alpha, colours, is_invisible = HITBOXES[name]
    plate = Plate()
    box = {"POSITION": plate.array((3.0 * CORNERS + (0, 0, 1)).astype("<f4"))}
    box |= {} if colours is None else {"COLOR_0": plate.array(colours)}
    primitive = {"attributes": box, "indices": plate.array(FACES), "material": 1}
    plate.mesh["primitives"].append(primitive)
    look = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}}
    mesh = plate.load(tmp_path, materials=[plate.material, {**material, **look}])
    assert mesh.bounds[1, 0] == (1.0 if is_invisible else 3.0)
    assert mesh.notes == (("Invisible triangles, left out: 2.",) if is_invisible else ())


@pytest.mark.parametrize("way", ["another scene", "hidden", "below what is hidden"])
def test_nodes_that_the_scene_does_not_show_are_left_out(tmp_path, way):
    plate = Plate()
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    plate.nodes += [{"name": "other", "children": [2]}, {"mesh": 0, "scale": [3, 3, 3]}]
    plate.nodes[1 if way.startswith("below") else 2] |= {} if way == "another scene" else hidden
    scenes = [{"nodes": [1]}, {"nodes": [0] if way == "another scene" else [0, 1]}]
    mesh = plate.load(tmp_path, scene=1, scenes=scenes, extensionsUsed=["KHR_node_visibility"])
    assert mesh.bounds[1, 0] == 1.0
    assert mesh.notes == ("Nodes that the file's scene does not show, left out: 1.",)


@pytest.mark.parametrize(("wrap", "is_noted"), [("wrapS", True), ("wrapT", False)])
def test_textures_that_are_clamped_or_mirrored_are_noted_where_it_matters(tmp_path, wrap, is_noted):
    plate = Plate()
    plate.attributes["TEXCOORD_0"] = plate.array((UVS * (2, 1)).astype("<f4"))
    textures, samplers = [{"source": 0, "sampler": 0}], [{wrap: 33071}]
    mesh = plate.load(tmp_path, textures=textures, samplers=samplers)
    note = "A texture that is clamped or mirrored, repeated instead."
    assert mesh.notes == ((note,) if is_noted else ())


def test_colours_of_corners_a_hair_above_one_are_cut(tmp_path):
    plate = Plate()
    plate.material = {}
    plate.attributes["COLOR_0"] = plate.array(np.full((4, 3), (1.002, 1.0, 0.0), "<f4"))
    mesh = plate.load(tmp_path)
    assert mesh.colours[0].tolist() == [1.0, 1.0, 0.0]
    assert mesh.notes == ("Colours above 1, cut to 1: 4.",)


def test_a_chain_of_thousands_of_nodes_is_read_at_once(tmp_path):
    plate, length = Plate(), 3000
    plate.nodes = [
        {"mesh": 0, "children": [i + 1], "translation": [0, 0, 1]} for i in range(length)
    ]
    plate.nodes[-1].pop("children")
    assert plate.load(tmp_path).bounds[1, 2] == length


@pytest.mark.parametrize("limit", ["MAX_TEXELS", "MAX_TEXTURES"])
def test_pictures_that_cut_are_bounded_together(tmp_path, monkeypatch, limit):
    """Each picture of 64 x 64 px; of two, one fits."""
    plate = Plate()
    images = plate.entries["images"]
    plate.picture(np.full((2, 2, 4), 255, np.uint8))
    plate.entries["images"] += images
    plate.mesh["primitives"].append({**plate.primitive, "material": 1})
    plate.material["alphaMode"] = "MASK"
    other = {**plate.material, "pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}
    more = {"textures": [{"source": 0}, {"source": 1}], "materials": [plate.material, other]}
    monkeypatch.setattr(
        f"poseviewer.files.mesh.parts.{limit}", 5000 if limit == "MAX_TEXELS" else 1
    )
    mesh = plate.load(tmp_path, **more)
    words = "too many pixels" if limit == "MAX_TEXELS" else "all but 1 of 2"
    assert len(mesh.textures) == 1
    assert [note for note in mesh.notes if words in note]


def test_a_picture_that_many_materials_name_anew_is_read_once(tmp_path, monkeypatch):
    plate, read = Plate(), list[str]()
    convert = Image.Image.convert
    monkeypatch.setattr(Image.Image, "convert", lambda own, to: read.append(to) or convert(own, to))
    plate.entries["images"] *= 50
    materials = []
    for number in range(50):
        look = {"baseColorTexture": {"index": number}}
        materials.append(
            {"pbrMetallicRoughness": look, "alphaMode": "MASK" if number else "OPAQUE"}
        )
    plate.mesh["primitives"] = [{**plate.primitive, "material": n} for n in range(50)]
    textures = [{"source": number} for number in range(50)]
    mesh = plate.load(tmp_path, materials=materials, textures=textures)
    assert quarters(mesh)[::2] == ALL[::2]
    assert sorted(read) == ["RGB", "RGB", "RGBA"]


def test_strips_and_fans(tmp_path):
    for mode, order in ((5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])):
        plate = Plate()
        plate.primitive |= {"mode": mode, "indices": plate.array(np.array(order, "<u2"))}
        mesh = plate.load(tmp_path)
        assert len(mesh.faces) == 2
        assert mesh.notes == ()
        np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * 4, atol=1e-6)


def test_older_glossy_materials_have_their_colour(tmp_path):
    plate = Plate()
    plate.material = {"extensions": {"KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [1, 1, 1, 1], "diffuseTexture": {"index": 0}}}}  # fmt: skip
    assert quarters(plate.load(tmp_path)) == ALL


UNREAD = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu", "ACME_one"


@pytest.mark.parametrize("name", UNREAD)
def test_an_extension_that_is_not_read_is_refused_where_it_is_required(tmp_path, name):
    with pytest.raises(MeshFileError, match=f"needs {name}"):
        Plate().load(tmp_path, extensionsUsed=[name], extensionsRequired=[name])


@pytest.mark.parametrize(("name", "note"), [
    ("KHR_texture_basisu", ""),
    ("ACME_unknown", "ACME_unknown"),
    ("KHR_node_visibility", ""),
    ("KHR_materials_clearcoat", ""),
    ("KHR_draco_mesh_compression", ""),
])  # fmt: skip
def test_an_extension_that_is_not_required_is_noted_where_something_is_lost(tmp_path, name, note):
    mesh = Plate().load(tmp_path, extensionsUsed=[name])
    assert mesh.notes == ((f"Not read, left out: {note}.",) if note else ())


@pytest.mark.parametrize("has_other", [True, False])
def test_a_picture_of_a_kind_that_is_not_read_is_noted_unless_there_is_another(tmp_path, has_other):
    texture = {"extensions": {"KHR_texture_basisu": {"source": 0}}} | (
        {"source": 0} if has_other else {}
    )
    mesh = Plate().load(tmp_path, textures=[texture], extensionsUsed=["KHR_texture_basisu"])
    assert len(mesh.textures) == has_other
    note = "Texture left out: its picture is of KHR_texture_basisu."
    assert mesh.notes == (() if has_other else (note,))
