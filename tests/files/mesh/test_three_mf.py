"""3MF of packages made here by hand: a coloured pyramid, there twice, and a plain one in it."""

from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import trimesh

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.mesh.three_mf import read_3mf

CORE = "http://schemas.microsoft.com/3dmanufacturing"
MODEL = f"""<?xml version="1.0"?>
<model unit="inch" xmlns="{CORE}/core/2015/02" xmlns:m="{CORE}/material/2015/02"
 xmlns:p="{CORE}/production/2015/06" xmlns:b="{CORE}/beamlattice/2017/02"
 requiredextensions="m p"><resources>
<basematerials id="1"><base name="red" displaycolor="#FF0000"/>
<base name="sea" displaycolor="#0080FFFF"/></basematerials>
<m:colorgroup id="2"><m:color color="#000000"/><m:color color="#FFFFFF"/></m:colorgroup>
<object id="3" name="painted" pid="1" pindex="1"><mesh>{{vertices}}<triangles>
<triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3" pid="1" p1="0"/>
<triangle v1="0" v2="3" v3="2" pid="2" p1="0" p2="1" p3="1"/><triangle v1="1" v2="2" v3="3"/>
</triangles></mesh></object>
<object id="4" name="plain"><mesh>{{vertices}}<triangles>
<triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/><triangle v1="0" v2="3" v3="2"/>
<triangle v1="1" v2="2" v3="3"/></triangles></mesh></object>
<object id="5"><components><component objectid="3"/>
<component objectid="4" transform="2 0 0 0 2 0 0 0 2 5 0 0"/></components></object>
</resources><build><item objectid="5"/>
<item objectid="3" partnumber="world" transform="-1 0 0 0 1 0 0 0 1 -3 0 0"/></build></model>"""
POINTS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
VERTICES = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in POINTS)
TEXT = MODEL.format(vertices=f"<vertices>{VERTICES}</vertices>")


def load(folder: Path, text: str, **more: str):
    with ZipFile(folder / "p.3mf", "w") as archive:
        for name, content in {"3D/3dmodel.model": text, **more}.items():
            archive.writestr(name, content)
    return load_mesh(folder / "p.3mf")


def test_colours_instances_and_units_of_a_3mf(tmp_path):
    mesh = load(tmp_path, TEXT)
    assert (mesh.unit, mesh.part_names, mesh.notes) == ("in", ("painted", "plain"), ())
    np.testing.assert_allclose(mesh.bounds, [[-4, 0, 0], [7, 2, 2]])
    corners, centres = mesh.vertices[mesh.faces], mesh.vertices[mesh.faces].mean(axis=1)
    assert len(corners) == 12
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at = centres[:, :1]
    middles = np.select([at < -1, at < 2], [(-3.25, 0.25, 0.25), (0.25,) * 3], (5.5, 0.5, 0.5))
    assert np.all(np.sum(outwards * (centres - middles), axis=1) > 0.0)
    shown = {tuple(map(tuple, np.round(mesh.colours[face] * 255))) for face in mesh.faces}
    flat = {((0, 128, 255),) * 3, ((255, 0, 0),) * 3, ((204, 204, 204),) * 3}
    assert flat < shown
    assert {frozenset(face) for face in shown - flat} == {frozenset([(0, 0, 0), (255, 255, 255)])}


@pytest.mark.parametrize(("old", "new", "note"), [
    ("<m:colorgroup", '<m:texture2dgroup id="9"/><m:colorgroup', "textures"),
    ("<mesh>", "<mesh><b:beamlattice/>", "beams"),
])  # fmt: skip
def test_what_is_lost_of_a_3mf_is_noted(tmp_path, old, new, note):
    assert load(tmp_path, TEXT.replace(old, new)).notes == (f"Not read, left out: {note}.",)


def test_settings_of_a_slicer_are_noted(tmp_path):
    (note,) = load(tmp_path, TEXT, **{"Metadata/Slic3r_PE.config": "x"}).notes
    assert note == "Not read, left out: a slicer's settings."


SOLID = f"""<mesh><vertices>{VERTICES}</vertices>
<triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>"""


HEAVY = f"<mesh><vertices>{VERTICES}</vertices><triangles>{{}}</triangles></mesh>".format(
    1000 * '<triangle v1="0" v2="2" v3="1"/>'
)
"""A mesh of very many triangles."""


def nest(*counts: int, innermost: str = SOLID, built: int = 1) -> str:
    """A model of a triangle, ``counts[0]`` times in a row along y, and this row ``counts[1]`` times
    along z, and so on by turns.
    """
    text = f'<object id="0">{innermost}</object>'
    for level, count in enumerate(counts):
        axis = "{0} 0" if level % 2 == 0 else "0 {0}"
        row = "".join(
            f'<component objectid="{level}" transform="1 0 0 0 1 0 0 0 1 0 {axis.format(place)}"/>'
            for place in range(count)
        )
        text += f'<object id="{level + 1}"><components>{row}</components></object>'
    items = f'<item objectid="{len(counts)}"/>' * built
    resources = f"<resources>{text}</resources><build>{items}</build>"
    return f'<model xmlns="{CORE}/core/2015/02">{resources}</model>'


@pytest.mark.parametrize("counts", [(8, 8), (10, 10), (2, 3, 1, 1), (1, 1, 1, 7)])
def test_every_copy_of_nested_components_of_a_3mf_is_there(tmp_path, counts):
    mesh = load(tmp_path, nest(*counts))
    corners = mesh.vertices[mesh.faces].min(axis=1)
    places = np.stack(np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"))
    y, z = places[::2].sum(axis=0).ravel(), places[1::2].sum(axis=0).ravel()
    assert sorted(map(tuple, corners)) == sorted((0.0, *place) for place in zip(y, z, strict=True))
    assert mesh.notes == ()


@pytest.mark.parametrize(("text", "words"), [
    (nest(*[10] * 40), "100,000 parts; poseviewer takes up to 50,000"),
    (nest(*[10] * 40, innermost="<components/>"), "0 triangles"),
    (nest(50_000, built=2), "100,000 parts"),
    (nest(*[10] * 4, innermost=HEAVY), r"2,\d{3},\d{3} faces with all copies; poseviewer takes up"),
])  # fmt: skip
def test_a_3mf_of_too_many_copies_is_refused_before_they_are_made(tmp_path, text, words):
    with pytest.raises(MeshFileError, match=rf"^p\.3mf: {words}"):
        load(tmp_path, text)


def test_a_3mf_that_unpacks_to_too_much_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    load(tmp_path, TEXT)
    monkeypatch.setattr("poseviewer.files.mesh.three_mf.MAX_XML_BYTES", len(TEXT) - 1)
    monkeypatch.setattr(ZipFile, "read", None)
    with pytest.raises(MeshFileError, match=rf"^p\.3mf: {len(TEXT):,} bytes unpacked; poseviewer"):
        read_3mf(tmp_path / "p.3mf")


BROKEN = {
    "other files": ('"5"/>', '"5" p:path="/3D/other.model"/>', "several files"),
    "an extension": ('requiredextensions="m p"', 'requiredextensions="b"', "needs .*beam"),
    "no such object": ('objectid="5"', 'objectid="6"', "object 6 is not there"),
    "two objects of one number": ('id="4"', 'id="3"', "object 3 is there twice"),
    "an object in itself": ('component objectid="3"', 'component objectid="5"', "object 5 is not"),
    "corners that are not there": ('v3="3"', 'v3="4"', "3MF file"),
    "no triangles": ("triangles>", "slices>", "no triangles"),
    "a colour that is none": ("#FF0000", "red", "3MF file"),
    "no unit": ('"inch"', '"ell"', "3MF file"),
    "cut short": ("</build>", "", "3MF file"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_not_read_or_broken_in_a_3mf_is_refused(tmp_path, name):
    old, new, words = BROKEN[name]
    assert old in TEXT
    with pytest.raises(MeshFileError, match=rf"^p\.3mf: .*{words}"):
        load(tmp_path, TEXT.replace(old, new))


def test_a_scene_that_trimesh_writes_comes_back(tmp_path):
    scene = trimesh.Scene([trimesh.creation.box()])
    turn = trimesh.transformations.rotation_matrix(0.5, [1, 2, 3], [3, 0, 0])
    scene.add_geometry(trimesh.creation.cone(1, 2), transform=turn)
    scene.export(tmp_path / "s.3mf")
    mesh = load_mesh(tmp_path / "s.3mf")
    np.testing.assert_allclose(mesh.bounds, scene.bounds, atol=1e-6)
    assert (mesh.unit, mesh.has_reflectance) == ("mm", False)
