"""Huge and hostile models, and those of very many textures, take bounded memory and time."""

from pathlib import Path

import pytest
from PIL import Image

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh
from tests.writing import write


def textured_obj(folder: Path, **sides: int) -> Path:
    """A model of a triangle for each square picture, by its name and side in px."""
    lines = ["mtllib model.mtl", "vt 0 0", "vt 1 0", "vt 0 1"]
    for i, (name, side) in enumerate(sides.items()):
        Image.new("RGB", (side, side), (i, 0, 0)).save(folder / f"{name}.png")
        lines += [f"v {i} 0 0", f"v {i + 1} 0 0", f"v {i} 1 0", f"usemtl {name}"]
        lines += [f"f {3 * i + 1}/1 {3 * i + 2}/2 {3 * i + 3}/3"]
    materials = "".join(f"newmtl {name}\nmap_Kd {name}.png\n" for name in sides)
    (folder / "model.mtl").write_text(materials)
    path = folder / "model.obj"
    path.write_text("\n".join(lines))
    return path


def test_large_textures_are_shrunk_until_they_fit_together(tmp_path, monkeypatch):
    monkeypatch.setattr("poseviewer.files.mesh.parts.MAX_TEXELS", 3600)
    mesh = load_mesh(textured_obj(tmp_path, a=10, b=10, c=10, large=60, huge=61))
    sides = sorted(texture.shape[0] for texture in mesh.textures)
    assert sides[:3] == [10, 10, 10]
    assert 30 < sides[3] < 60
    assert sum(side**2 for side in sides) <= 3600
    notes = " ".join(mesh.notes)
    assert "huge.png has too many pixels" in notes
    assert "Textures shrunk to" in notes


@pytest.mark.parametrize("most", ["MAX_FACES", "MAX_PARTS"])
def test_models_of_too_many_faces_or_parts(tmp_path, monkeypatch, most):
    path = textured_obj(tmp_path, a=4, b=4, c=4)
    assert len(load_mesh(path).faces) == 3
    monkeypatch.setattr(f"poseviewer.files.mesh.surface.{most}", 2)
    with pytest.raises(MeshFileError, match=r"^model\.obj: 3 \w+; poseviewer takes up to 2, simp"):
        load_mesh(path)


BLANKS = "\n" + "\t" * 900_000
TRIANGLE = "facet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


def test_blanks_without_end_take_no_time(tmp_path):
    """Each took minutes."""
    with pytest.raises(MeshFileError, match="no OFF header"):
        load_mesh(write(tmp_path / "a.off", BLANKS))
    mesh = load_mesh(write(tmp_path / "a.stl", f"solid a\n{BLANKS}\n{TRIANGLE}endsolid a\n"))
    assert len(mesh.faces) == 1


def test_a_texture_of_a_name_of_very_many_letters_is_noted(tmp_path):
    path = textured_obj(tmp_path, a=4)
    write(tmp_path / "model.mtl", f"newmtl a\nmap_Kd -s {'1' * 900_000}!\n")
    (note,) = load_mesh(path).notes
    assert len(note) < 1000
    assert note.startswith("Texture left out")
