"""COLLADA of files made here by hand: a concave plate, there twice, in inches."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.mesh.named import NOT_THERE
from poseviewer.files.mesh.references import names_in
from poseviewer.geometry.normals import face_normals_and_areas

pytest.importorskip("collada", reason="pip install 'poseviewer[dae]'")
CORNERS = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
"""An L of area 3; a fan about its first corner is right, one about its second has area 4."""
L = [1, 2, 3, 4, 5, 0]
DOCUMENT = """<?xml version="1.0"?>
<!-- by hand -->
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>a%20b.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="c"><lambert><diffuse>{diffuse}</diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><!-- an L -->
<source id="p"><float_array id="pa" count="18">{points}</float_array><technique_common>
<accessor source="#pa" count="6" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="u"><float_array id="ua" count="12">{uvs}</float_array><technique_common>
<accessor source="#ua" count="6" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<source id="k"><float_array id="ka" count="18">{colours}</float_array><technique_common>
<accessor source="#ka" count="6" stride="3"><param name="R" type="float"/>
<param name="G" type="float"/><param name="B" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
{polygons}</mesh></geometry></library_geometries>
<library_nodes><node id="n" name="plate"><rotate>0 0 1 90</rotate>{instance}</node></library_nodes>
<library_visual_scenes><visual_scene id="w">
<node name="first"><instance_node url="#n"/></node>
<node name="second"><translate>10 0 0</translate><scale>2 2 2</scale>
<instance_node url="#n"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""
INPUTS = """<input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="0" set="1"/>"""
COLOUR = '<input semantic="COLOR" source="#k" offset="0"/>'
ORDER = " ".join(map(str, L))
POLYGONS = {
    kind: f'<{kind} count="1" material="x">{INPUTS}{indices}</{kind}>'
    for kind, indices in {
        "polylist": f"<vcount>6</vcount><p>{ORDER}</p>",
        "polygons": f"<p>{ORDER}</p>",
        "triangles": "<p>0 1 2 0 2 3 0 3 4 0 4 5</p>",
        "trifans": "<p>0 1 2 3 4 5</p>",
        "tristrips": "<p>2 3 1 0</p><p>3 4 0 5</p>",
    }.items()
}
INSTANCE = """<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="x" target="#m">
<bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="1"/></instance_material>
</technique_common></bind_material></instance_geometry>"""


def plate(**changes: str) -> str:
    """The document, an L of one colour, with changes."""
    entries = {
        "diffuse": "<color>0.25 0.5 0.75 1</color>",
        "points": " ".join(f"{x} {y} 0" for x, y in CORNERS),
        "uvs": " ".join(f"{x / 2} {y / 2}" for x, y in CORNERS),
        "colours": " ".join(f"{x / 2} {y / 2} 1" for x, y in CORNERS),
        "polygons": POLYGONS["polylist"],
        "instance": INSTANCE,
    }
    return DOCUMENT.format(**(entries | changes))


def load(folder: Path, text: str, more: str = ""):
    (folder / "l.dae").write_text(text.replace("</COLLADA>", f"{more}</COLLADA>"))
    return load_mesh(folder / "l.dae")


@pytest.mark.parametrize("kind", POLYGONS)
def test_polygons_instances_and_units_of_a_dae(tmp_path, kind):
    mesh = load(tmp_path, plate(polygons=POLYGONS[kind]))
    areas = face_normals_and_areas(mesh.vertices, mesh.faces)[1]
    assert areas.sum() == pytest.approx(3.0 + 4 * 3.0)
    np.testing.assert_allclose(mesh.bounds, [[-2, 0, 0], [10, 4, 0]], atol=1e-6)
    np.testing.assert_allclose(mesh.colours, np.tile([0.25, 0.5, 0.75], (len(mesh.colours), 1)))
    assert (mesh.unit, mesh.y_up, mesh.part_names, mesh.notes) == ("in", False, ("plate",), ())


def test_units_without_a_name_are_made_metres(tmp_path):
    mesh = load(tmp_path, plate().replace('"0.0254"', '"0.5"').replace("Z_UP", "Y_UP"))
    np.testing.assert_allclose(mesh.bounds, [[-1, 0, 0], [5, 2, 0]], atol=1e-6)
    assert (mesh.unit, mesh.y_up) == ("m", True)
    assert mesh.notes == ("Lengths in units of 0.5 m were made lengths in m.",)


def test_colours_of_corners_beside_a_material(tmp_path):
    mesh = load(tmp_path, plate(polygons=POLYGONS["polylist"].replace(INPUTS, INPUTS + COLOUR)))
    x, y, _ = mesh.vertices[mesh.vertices[:, 0] < 0.5].T
    wanted = np.stack([y / 2, -x / 2, np.ones(len(x))], axis=1)
    np.testing.assert_allclose(mesh.colours[mesh.vertices[:, 0] < 0.5], wanted, atol=1e-6)


@pytest.mark.parametrize("has_picture", [True, False])
def test_a_texture_of_a_dae_is_laid_on_or_noted(tmp_path, has_picture):
    pixels = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    if has_picture:
        Image.fromarray(pixels).save(tmp_path / "a b.png")
    text = plate(diffuse='<texture texture="t" texcoord="UV"/>')
    mesh = load(tmp_path, text)
    assert names_in(tmp_path / "l.dae") == {"a b.png": True}
    assert len(mesh.textures) == has_picture
    assert mesh.notes == (() if has_picture else (f"Texture left out: a b.png {NOT_THERE}.",))
    if has_picture:
        clamped = text.replace("s</source>", "s</source><wrap_s>CLAMP</wrap_s>")
        (note,) = load(tmp_path, clamped.replace("1.0 0.0", "2.0 0.0")).notes
        assert "clamped or mirrored" in note
        near = mesh.vertices[:, 0] < 0.5
        np.testing.assert_array_equal(mesh.textures[0], pixels)
        np.testing.assert_allclose(mesh.uvs[near][:, 0], mesh.vertices[near][:, 1] / 2, atol=1e-6)


def nest(text: str, *counts: int) -> str:
    """The document, with ``counts[0]`` plates side by side, as often as ``counts[1]`` says..."""
    nodes = f'<node id="n0">{INSTANCE}</node>'
    for level, count in enumerate(counts):
        axis = "{0} 0 0" if level % 2 == 0 else "0 {0} 0"
        moves = (f"<translate>{axis.format(3 * place)}</translate>" for place in range(count))
        inner = "".join(f'<node>{move}<instance_node url="#n{level}"/></node>' for move in moves)
        nodes = f'<node id="n{level + 1}">{inner}</node>{nodes}'  # each before those that it names
    start, end = text.index('<node id="n"'), text.index("</library_nodes>")
    return (text[:start] + nodes + text[end:]).replace('"#n"', f'"#n{len(counts)}"')


@pytest.mark.parametrize("counts", [(8, 8), (10, 10)])
def test_every_copy_of_nested_nodes_of_a_dae_is_there(tmp_path, counts):
    mesh = load(tmp_path, nest(plate(), *counts))
    areas = face_normals_and_areas(mesh.vertices, mesh.faces)[1]
    wanted = np.prod(counts)
    assert areas.sum() == pytest.approx(wanted * (3.0 + 4 * 3.0))
    assert mesh.notes == ()


def test_a_dae_of_too_many_copies_is_refused_before_they_are_made(tmp_path):
    with pytest.raises(MeshFileError, match=r"^l\.dae: 2,000,000 parts; poseviewer takes up to"):
        load(tmp_path, nest(plate(), *[10] * 6))


def test_a_dae_of_too_many_triangles_is_refused_while_its_copies_are_made(tmp_path):
    many = POLYGONS["triangles"].replace("0 1 2 0 2 3", 1000 * "0 1 2 0 2 3 ")
    with pytest.raises(MeshFileError, match=r"^l\.dae: 2,\d{3},\d{3} vertices with all copies; "):
        load(tmp_path, nest(plate(polygons=many), *[10] * 3))


def test_other_scenes_of_a_dae_are_noted_and_nodes_that_are_not_read_refused(tmp_path):
    text, node = plate(), '<node><instance_node url="#n"/></node>'
    other = f'<visual_scene id="o">{node}</visual_scene></library_visual_scenes>'
    (note,) = load(tmp_path, text.replace("</library_visual_scenes>", other)).notes
    assert note == "Geometries that the file's scene does not show, left out: 1."
    loose = text.replace("</visual_scene>", '<instance_node url="#n"/></visual_scene>')
    with pytest.raises(MeshFileError, match="its scene shows 3 geometries, its nodes 2"):
        load(tmp_path, loose)


BROKEN = {
    "skin": (INSTANCE, '<instance_controller url="#g"/>', "a skin or morph"),
    "hole": ("<p>", "<ph><p>0 1 2</p><h>3 4 5</h></ph><p>", "holes"),
    "turned by lookat": ("<rotate>0 0 1 90<", "<lookat>0 0 1 0 0 0 0 1 0</lookat><rotate>0 0 1 90<",
                         "lookat"),
    "numbers between": ('count="6" stride="3"', 'count="6" stride="4"', "between"),
    "corners that are not there": (ORDER, "1 2 3 4 5 77", "DAE file"),
    "corners below 0": (ORDER, "1 2 3 4 5 -1", "number -1"),
    "fewer corners": ("<vcount>6", "<vcount>5", "other corners"),
    "no scene": ("<scene>", "<scene/><extra>", "DAE file"),
    "cut short": ("</library_nodes>", "", "DAE file"),
    "no geometry": ("#g", "#h", "not found"),
    "a wrong unit": ("0.0254", "-1", "DAE file"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_not_read_or_broken_in_a_dae_is_refused(tmp_path, name):
    old, new, words = BROKEN[name]
    text = plate(polygons=POLYGONS["polygons" if name == "hole" else "polylist"])
    assert old in text
    with pytest.raises(MeshFileError, match=rf"^l\.dae: .*{words}"):
        load(tmp_path, text.replace(old, new))


def test_animations_and_lines_of_a_dae_are_noted(tmp_path):
    lines = f'<lines count="1">{INPUTS}<p>0 1</p></lines>'
    animations = "<library_animations><animation/></library_animations>"
    mesh = load(tmp_path, plate(polygons=POLYGONS["polylist"] + lines), animations)
    assert set(mesh.notes) == {"Not read, left out: animations.", "Not read, left out: lines."}
