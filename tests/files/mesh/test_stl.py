"""STL as programs write it: headers of another length, words and colours."""

import struct

import numpy as np
import pytest

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh

TRIANGLES = [[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(1, 0, 0), (1, 1, 0), (0, 1, 0)]]


def binary(attribute: int = 0) -> bytes:
    return b"".join(struct.pack("<12fH", 0, 0, 1, *np.ravel(t), attribute) for t in TRIANGLES)


@pytest.mark.parametrize(
    ("promised", "more", "notes"),
    [(2, b"", 0), (2, b"\0" * 30, 0), (0, b"", 1), (2, b"\0" * 100, 1)],
)
def test_stl_whose_header_says_another_length(tmp_path, promised, more, notes):
    (tmp_path / "m.stl").write_bytes(bytes(80) + struct.pack("<I", promised) + binary() + more)
    mesh = load_mesh(tmp_path / "m.stl")
    assert (len(mesh.faces), len(mesh.notes)) == (2, notes)


def test_attributes_of_triangles_are_noted(tmp_path):
    header = b"solid COLOR=".ljust(80) + struct.pack("<I", 2)
    (tmp_path / "m.stl").write_bytes(header + binary(0x801F))
    (note,) = load_mesh(tmp_path / "m.stl").notes
    assert note.startswith("Attributes of triangles (colours")


FACETS = "".join(
    "facet normal 0 0 1\nouter loop\n"
    + "".join(f" vertex {x} {y} {z}\n" for x, y, z in triangle)
    + "endloop\nendfacet\n"
    for triangle in TRIANGLES
)
TEXTS = {
    "plain": f"solid a\n{FACETS}endsolid a\n",
    "capitals": f"SOLID A\n{FACETS.upper()}ENDSOLID A\n",
    "end solid": f"solid a\n{FACETS}end solid a\n",
    "words before": f"# made by hand\n; of 2 facets\n\nsolid a\n{FACETS}endsolid a\n",
    "a byte order mark": f"\ufeffsolid a\n{FACETS}endsolid a\n",
    "words of the format in names": f"solid vertex solid 1 normal\n{FACETS}endsolid vertex\n",
    "no name of a solid": FACETS,
    "old line ends": f"solid a\n{FACETS}endsolid a\n".replace("\n", "\r"),
    "two solids": f"solid a\n{FACETS[: len(FACETS) // 2]}endsolid a\nsolid b\n"
    f"{FACETS[len(FACETS) // 2 :]}endsolid b\n",
    "a long name": f"solid {'a' * 300}\n{FACETS}endsolid\n",
    "numbers with exponents": f"solid a\n{FACETS.replace('vertex 1 ', 'vertex 1.0E+00 ')}endsolid",
}  # fmt: skip


@pytest.mark.parametrize("name", TEXTS)
def test_texts_of_an_stl(tmp_path, name):
    (tmp_path / "m.stl").write_text(TEXTS[name], "utf-8", newline="")
    mesh = load_mesh(tmp_path / "m.stl")
    assert (len(mesh.faces), mesh.notes) == (2, ())
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 0]])


@pytest.mark.parametrize(("text", "words"), [
    (f"solid a\n{FACETS}", "cut short"),
    (f"solid a\n{FACETS}endsolid\nsolid b\n{FACETS}", "cut short"),
    (TEXTS["plain"].replace(" vertex 1 1 0\n", ""), "STL file"),
    (TEXTS["plain"].replace("vertex 1 1 0", "vertex 1 1"), "STL file"),
    (TEXTS["plain"].replace("vertex 1 1 0", "vertex 1 one 0"), "STL file"),
    (TEXTS["plain"].replace("vertex 1 1 0", "vertex 1 1 0 1"), "STL file"),
])  # fmt: skip
def test_broken_texts_of_an_stl_are_refused(tmp_path, text, words):
    (tmp_path / "m.stl").write_text(text)
    with pytest.raises(MeshFileError, match=rf"^m\.stl: .*{words}"):
        load_mesh(tmp_path / "m.stl")
