"""Colours and textures of model files come in as they would be shown."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.mesh.named import NOT_THERE
from poseviewer.geometry.image import srgb_from_linear
from poseviewer.geometry.mesh import Mesh
from tests.textured import CORNERS, write_gltf, write_obj, write_ply

PICTURE = "a picture.png"
TEXTURE = np.arange(4 * 4 * 3, dtype=np.uint8).reshape(4, 4, 3) * 5


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Image.fromarray(TEXTURE).save(tmp_path / PICTURE)
    return tmp_path


def assert_is_textured_quad(mesh: Mesh) -> None:
    """A renderer that looks the texture up sees it spread over the quad."""
    assert mesh.faces.shape == (2, 3)
    assert mesh.has_reflectance
    np.testing.assert_array_equal(mesh.textures[0], TEXTURE)
    np.testing.assert_array_equal(mesh.colours, 1.0)
    low, high = np.min(CORNERS, axis=0)[:2], np.max(CORNERS, axis=0)[:2]
    for face in mesh.faces:
        right, up = (mesh.vertices[face].mean(axis=0)[:2] - low) / (high - low)
        u, v = mesh.uvs[face].mean(axis=0)
        assert (int(4 * u), int(4 * (1.0 - v))) == (int(4 * right), int(4 * (1.0 - up)))


@pytest.mark.parametrize("write", [write_obj, write_ply, write_gltf])
def test_a_texture_is_laid_on_the_model(folder: Path, write) -> None:
    path = write(folder, PICTURE)
    mesh = load_mesh(path)
    assert_is_textured_quad(mesh)
    assert mesh.unit == ("m" if path.suffix == ".gltf" else None)
    (folder / PICTURE).unlink()
    mesh = load_mesh(path)
    assert mesh.textures == ()
    assert np.all(mesh.face_texture == -1)
    assert mesh.notes == (f"Texture left out: {PICTURE} {NOT_THERE}.",)


@pytest.mark.parametrize("named", [f"-s 1 1 1 -clamp on {PICTURE}", f"C:\\old place\\{PICTURE}"])
def test_names_of_textures_in_an_mtl_file(folder: Path, named: str) -> None:
    assert_is_textured_quad(load_mesh(write_obj(folder, named)))


def test_a_texture_takes_the_place_of_the_material_colour_where_it_is_there(folder: Path) -> None:
    path = write_obj(folder, PICTURE)
    (folder / "quad.mtl").write_text(f"newmtl paint\nKd 0.5 0.25 0\nmap_Kd {PICTURE}\n")
    assert_is_textured_quad(load_mesh(path))
    (folder / PICTURE).unlink()
    np.testing.assert_allclose(load_mesh(path).colours, np.tile([0.5, 0.25, 0.0], (4, 1)))


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n"])
def test_a_damaged_texture_is_noted(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.png").write_bytes(content)
    mesh = load_mesh(write_obj(tmp_path, "bad.png"))
    assert not mesh.has_reflectance
    assert mesh.notes[0].startswith("Texture left out: ")


@pytest.mark.parametrize("damage", ["", "not a picture", "BLP2"])
def test_a_damaged_picture_in_a_glb_is_noted(tmp_path: Path, damage: str) -> None:
    paint = PBRMaterial(baseColorTexture=Image.fromarray(TEXTURE))
    visual = TextureVisuals(np.array(CORNERS)[:, :2], material=paint)
    quad = trimesh.Trimesh(CORNERS, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)
    quad.export(tmp_path / "quad.glb")
    data = (tmp_path / "quad.glb").read_bytes()
    at = data.index(b"\x89PNG")
    if damage:
        data = data[:at] + damage.encode().ljust(40, b"\xff") + data[at + 40 :]
        (tmp_path / "quad.glb").write_bytes(data)
    mesh = load_mesh(tmp_path / "quad.glb")
    assert len(mesh.faces) == 2
    assert len(mesh.textures) == (0 if damage else 1)
    assert [note[:17] for note in mesh.notes] == (["Texture left out:"] if damage else [])


def test_very_many_material_files_are_not_all_sought(tmp_path: Path) -> None:
    path = write_obj(tmp_path, PICTURE)
    many = "".join(f"mtllib {number}.mtl\n" for number in range(20_000))
    path.write_text(many + path.read_text())
    notes = load_mesh(path).notes
    assert "Material files left out: all but 1000 of 20,001." in notes
    assert len(notes) < 1010


def test_missing_materials_are_noted(folder: Path) -> None:
    path = write_obj(folder, PICTURE)
    (folder / "quad.mtl").write_text("newmtl other\nKd 1 0 0\n")
    assert load_mesh(path).notes == ("Materials not in the MTL file: paint.",)
    (folder / "quad.mtl").write_bytes(b"")
    assert load_mesh(path).notes == ("Material file left out: quad.mtl is empty.",)
    (folder / "quad.mtl").unlink()
    assert load_mesh(path).notes == (f"Material file left out: quad.mtl {NOT_THERE}.",)


@pytest.mark.parametrize("names", [("u", "v"), ("texture_u", "texture_v")])
def test_other_names_of_texture_coordinates_of_a_ply(folder: Path, names: tuple[str, str]) -> None:
    path = write_ply(folder, PICTURE)
    text = path.read_text()
    for old, new in zip("st", names, strict=True):
        text = text.replace(f"float {old}\n", f"float {new}\n")
    path.write_text(text)
    assert_is_textured_quad(load_mesh(path))


def test_textures_of_a_ply_by_face(folder: Path) -> None:
    """``texnumber`` tells which of several; a number of none of them, that there is none."""
    text = write_ply(folder, "other.png").read_text()
    Image.fromarray(TEXTURE[::-1]).save(folder / "other.png")
    header, _, rows = text.partition("end_header\n")
    header = header.replace("float s", "float a").replace("float t", "float b")
    header = header.replace("comment", f"comment TextureFile {PICTURE}\ncomment", 1)
    corners = "".join(f"{row}\n" for row in rows.splitlines()[:4])
    faces = "3 0 1 2 6 0 0 1 0 1 1 {}\n3 0 2 3 6 0 0 1 1 0 1 {}\n"
    header += "property list uchar float texcoord\nproperty int texnumber\nend_header\n"
    path = folder / "quad.ply"
    path.write_text(header + corners + faces.format(0, 0))
    assert_is_textured_quad(load_mesh(path))
    path.write_text(header + corners + faces.format(1, 7))
    mesh = load_mesh(path)
    assert sorted(mesh.face_texture) == [-1, 0]
    np.testing.assert_array_equal(mesh.textures[0], TEXTURE[::-1])


def test_colours_of_faces_and_mixed_polygons_of_a_ply(tmp_path: Path) -> None:
    text = "ply\nformat ascii 1.0\nelement vertex 4\n"
    text += "".join(f"property float {axis}\n" for axis in "xyz")
    text += "element face 2\nproperty list uchar int vertex_indices\n"
    text += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    text += "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 5\n"
    (tmp_path / "mixed.ply").write_text(text + "4 0 1 2 3 255 0 0\n3 0 2 1 0 0 255\n")
    mesh = load_mesh(tmp_path / "mixed.ply")
    assert {tuple(c) for c in mesh.colours.tolist()} <= {(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)}
    assert len(mesh.faces) == 2  # the triangle doubles half of the quad


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
RGB = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0.6, 0.2]])


def load_square(folder: Path, name: str, head: str, rows: list[str], face: str) -> Mesh:
    """Load a text file of a square with a row for each corner, and its one face."""
    (folder / name).write_text(head + "".join(f"{row}\n" for row in rows) + f"{face}\n")
    return load_mesh(folder / name)


def rows_of(colours: np.ndarray, *more: str) -> list[str]:
    """Rows x y z r g b of the square's corners, with more behind."""
    numbers = np.concatenate([SQUARE, colours], axis=1)
    return [" ".join([*(f"{value:.6g}" for value in row), *more]) for row in numbers]


def colours_of(mesh: Mesh) -> np.ndarray:
    """RGB of the square's corners, (4, 3)."""
    return np.array([mesh.colours[(mesh.vertices == c).all(axis=1)][0] for c in SQUARE])


@pytest.mark.parametrize("names", ["red green blue", "r g b", "R G B", "diffuse_red diffuse_green "
                                   "diffuse_blue"])  # fmt: skip
@pytest.mark.parametrize(
    ("kind", "top"),
    [("uchar", 255), ("int", 255), ("uint", 255), ("ushort", 65535), ("ushort", 255),
     ("short", 255), ("float", 1), ("double", 255), ("int", 65535)],
)  # fmt: skip
def test_colours_of_a_ply_under_all_names_and_types(tmp_path, names, kind, top):
    head = "ply\nformat ascii 1.0\nelement vertex 4\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    head += "".join(f"property {kind} {name}\n" for name in names.split())
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    values = RGB * top if top == 1 else np.rint(RGB * top)
    mesh = load_square(tmp_path, "m.ply", head, rows_of(values), "4 0 1 2 3")
    np.testing.assert_allclose(colours_of(mesh), RGB, atol=1e-3)
    assert mesh.notes == ()


def test_columns_of_a_ply_that_may_be_colours_and_other_elements_are_noted(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 4\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "intensity", "q", "w"))
    head += "element face 1\nproperty list uchar int vertex_indices\n"
    head += "element material 1\nproperty int red\nend_header\n"
    mesh = load_square(tmp_path, "m.ply", head, rows_of(RGB), "4 0 1 2 3\n7")
    assert mesh.notes == (
        "Columns of the PLY that may be colours, left out: intensity.",
        "Elements of the PLY, left out: material.",
    )


@pytest.mark.parametrize(
    ("factor", "wanted"), [(1.002, 1.002), (3.0, 3.0), (255.0, 1.0), (40.5, 40.5 / 255)]
)
def test_numbers_above_one_are_bytes_only_where_they_are_far_above(tmp_path, factor, wanted):
    rows = [f"v {row}" for row in rows_of(RGB * factor)]
    mesh = load_square(tmp_path, "m.obj", "", rows, "f 1 2 3 4")
    np.testing.assert_allclose(colours_of(mesh), np.minimum(RGB * wanted, 1.0), atol=1e-5)
    assert bool(mesh.notes) == (factor < 10)


def test_colours_of_one_object_of_an_obj(tmp_path):
    rows = [f"v {row}" for row in rows_of(RGB)] + ["f 1 2 3 4", "o b"]
    rows += [f"v {x} {y} 5 # no colour here" for x, y, _ in SQUARE]
    mesh = load_square(tmp_path, "m.obj", "o a\n", rows, "f 5 6 7 8")
    np.testing.assert_allclose(colours_of(mesh), RGB, atol=1e-6)
    np.testing.assert_allclose(mesh.colours[mesh.vertices[:, 2] == 5.0], 0.8)
    assert mesh.notes == ()


@pytest.mark.parametrize("lines", [1, 2, 4])
def test_polypaint_of_zbrush(tmp_path, lines):
    digits = ["ff" + bytes(np.rint(255 * rgb).astype(np.uint8)).hex() for rgb in RGB]
    blocks = [digits[i::1][: 4 // lines] for i in range(0, 4, 4 // lines)]
    rows = [f"v {x} {y} {z}" for x, y, z in SQUARE] + [f"#MRGB {''.join(b)}" for b in blocks]
    mesh = load_square(tmp_path, "m.obj", "# ZBrush\n", rows, "f 1 2 3 4")
    np.testing.assert_allclose(colours_of(mesh), RGB, atol=1e-6)
    mesh = load_square(tmp_path, "m.obj", "# ZBrush\n", [*rows[:-1], "#MRGB ffx"], "f 1 2 3 4")
    assert not mesh.has_reflectance
    assert mesh.notes == ("Colours by #MRGB, left out: they are not 8 digits for each vertex.",)


@pytest.mark.parametrize(("line", "note"), [
    ("map_Kd -s 2 2 1 a picture.png", "Options of a texture, left out: -s 2 2 1."),
    ("map_Kd -o 0.5 0 0 a picture.png", "Options of a texture, left out: -o 0.5 0 0."),
    ("map_Kd -clamp on a picture.png", "Options of a texture, left out: -clamp on."),
    ("map_Kd -s 1 1.0 1 -o 0 0 0 a picture.png", None),
    ("d 0.0", "Material paint is said to be invisible, and is shown."),
    ("Tr 1", "Material paint is said to be invisible, and is shown."),
    ("d 1.0", None),
])  # fmt: skip
def test_lines_of_an_mtl_that_are_not_followed_are_noted(folder, line, note):
    path = write_obj(folder, PICTURE)
    (folder / "quad.mtl").write_text(f"newmtl paint\n{line}\n")
    assert load_mesh(path).notes == ((note,) if note else ())


def test_lines_of_an_obj_that_are_not_read_are_noted(tmp_path):
    rows = [f"v {x} {y} {z}" for x, y, z in SQUARE] + ["s off", "l 1 2", "curv 0 1 1 2", "# l"]
    mesh = load_square(tmp_path, "m.obj", "", rows, "f 1 2 3 4")
    assert mesh.notes == ("Lines not read: curv, l.",)


BYTES = np.rint(RGB * 255)
PLAIN = [f"{x} {y} {z}" for x, y, z in SQUARE]
OFFS = {
    "COFF, bytes": ("COFF\n4 1 0\n", rows_of(BYTES, "255"), "4 0 1 2 3", RGB),
    "COFF, numbers to 1": ("COFF 4 1 0\n", rows_of(RGB, "1"), "4 0 1 2 3", RGB),
    "COFF without alpha": ("COFF\n4 1\n", rows_of(BYTES), "4 0 1 2 3", RGB),
    "OFF with more columns": ("OFF\n4 1 0\n", rows_of(BYTES, "255"), "4 0 1 2 3", RGB),
    "CNOFF": ("CNOFF\n4 1 0\n", [f"{row} 0 0 1 {r} {g} {b} 1" for row, (r, g, b) in
                                zip(PLAIN, RGB, strict=True)], "4 0 1 2 3", RGB),
    "NOFF": ("NOFF\n4 1 0\n", [f"{row} 0 0 1" for row in PLAIN], "4 0 1 2 3", None),
    "counts on its line": ("OFF4 1 0\n", PLAIN, "4 0 1 2 3", None),
    "counts behind a blank": ("OFF 4 1 0\n", PLAIN, "4 0 1 2 3", None),
    "no word": ("4 1 0\n", PLAIN, "4 0 1 2 3", None),
    "a face's colour in bytes": ("OFF\n4 1 0\n", PLAIN, "4 0 1 2 3 255 153 51 255", RGB[3]),
    "a face's colour to 1": ("OFF\n4 1 0\n", PLAIN, "4 0 1 2 3 1.0 0.6 0.2", RGB[3]),
}  # fmt: skip


@pytest.mark.parametrize("name", OFFS)
def test_headers_and_colours_of_off(tmp_path, name):
    head, rows, face, wanted = OFFS[name]
    mesh = load_square(tmp_path, "m.off", head, rows, face)
    assert (len(mesh.faces), mesh.notes) == (2, ())
    np.testing.assert_allclose(np.abs(mesh.normals), [[0, 0, 1]] * len(mesh.normals), atol=1e-6)
    assert mesh.has_reflectance == (wanted is not None)
    if wanted is not None:
        np.testing.assert_allclose(colours_of(mesh), np.broadcast_to(wanted, (4, 3)), atol=1e-6)


def test_colours_of_faces_of_off_by_number_are_noted_and_other_headers_refused(tmp_path):
    notes = load_square(tmp_path, "m.off", "OFF\n4 1 0\n", PLAIN, "4 0 1 2 3 7").notes
    assert notes == ("Colours of some faces, or by their number in a colour map, left out.",)
    for head in ("4OFF\n4 1 0\n", "nOFF\n3\n4 1 0\n", "OFF BINARY\n4 1 0\n"):
        with pytest.raises(MeshFileError, match=r"m\.off: .*no OFF header of three"):
            load_square(tmp_path, "m.off", head, PLAIN, "4 0 1 2 3")


def test_gltf_is_linear_but_what_trimesh_writes_is_not(tmp_path: Path) -> None:
    colours = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [128, 255, 0]] * 2, np.uint8)
    box = trimesh.creation.box()
    trimesh.Trimesh(box.vertices, box.faces, vertex_colors=colours).export(tmp_path / "cube.glb")
    data = (tmp_path / "cube.glb").read_bytes()
    assert b"mikedh/trimesh" in data
    (tmp_path / "other.glb").write_bytes(data.replace(b"mikedh/trimesh", b"somebody/else_"))
    theirs = load_mesh(tmp_path / "other.glb")
    ours = load_mesh(tmp_path / "cube.glb")
    np.testing.assert_allclose(theirs.colours, srgb_from_linear(ours.colours), atol=1e-6)
    assert srgb_from_linear(np.array([0.0, 0.2140, 1.0])) == pytest.approx(
        [0.0, 0.5, 1.0], abs=1e-3
    )


def test_a_textured_face_has_one_colour_that_of_its_corners_on_average(folder: Path) -> None:
    header, _, rows = write_ply(folder, PICTURE).read_text().partition("element face")
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    head, _, rows = rows.partition("end_header\n")
    lines = rows.splitlines()
    lines[:4] = [f"{line} {red} 0 255" for line, red in zip(lines, (0, 0, 90, 90), strict=False)]
    path = folder / "quad.ply"
    path.write_text(f"{header}element face{head}end_header\n" + "\n".join(lines) + "\n")
    mesh = load_mesh(path)
    for face, red in zip(mesh.faces, (30, 60), strict=True):
        np.testing.assert_allclose(255.0 * mesh.colours[face], [[red, 0, 255]] * 3, rtol=1e-5)
    assert "shown in the mean of these: 2." in mesh.notes[0]
