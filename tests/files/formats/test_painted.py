"""Painted models as files that other tools read."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.gltf_export import save_painting
from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.image import linear_from_srgb
from poseviewer.geometry.painted_model import Painting
from tests.meshes import make_bumpy


@pytest.mark.parametrize("away", [0.0, 4e5])
def test_another_tool_reads_colours_where_they_are_and_what_is_unpainted(tmp_path, away):
    mesh = make_bumpy(3)
    mesh = replace(mesh, vertices=mesh.vertices + np.array([away, 0.0, 0.0]), unit="mm")
    shown = mesh.vertices[mesh.faces, 2].mean(axis=1) > 0.1
    save_painting(tmp_path / "painted.glb", Painting(mesh, mesh, mesh, shown, ("photo.jpg",)))
    scene = trimesh.load_scene(tmp_path / "painted.glb", process=False)
    found = {part.visual.material.name: part for part in scene.geometry.values()}
    (place, *_) = [scene.graph[node][0] for node in scene.graph.nodes_geometry]
    assert {name: len(part.faces) for name, part in found.items()} == {
        "painted": shown.sum(), "unpainted": (~shown).sum(),
    }  # fmt: skip
    for name, chosen in (("painted", shown), ("unpainted", ~shown)):
        part, faces = found[name], mesh.faces[chosen]
        corners = part.vertices[part.faces] + place[:3, 3]
        np.testing.assert_allclose(corners, mesh.vertices[faces], atol=1e-6)
        colours = part.visual.vertex_attributes["color"][part.faces]
        np.testing.assert_allclose(colours, linear_from_srgb(mesh.colours[faces]), atol=1e-5)
    again = load_mesh(tmp_path / "painted.glb")
    np.testing.assert_allclose(again.bounds, mesh.bounds, rtol=1e-6)


def test_painted_models_are_glb(tmp_path):
    mesh = make_bumpy(1)
    painting = Painting(mesh, mesh, mesh, np.ones(len(mesh.faces), bool), ())
    with pytest.raises(PoseFileError, match=r"painted\.obj: .*\.glb"):
        save_painting(tmp_path / "painted.obj", painting)
