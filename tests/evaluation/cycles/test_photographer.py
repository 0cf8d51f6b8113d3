"""Blender draws the vehicle where the pose has it, and photos are drawn once."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.cli import main as cli
from poseviewer.evaluation.cycles.photographer import (
    QUALITY,
    VARIABLE,
    CyclesPhotographer,
    blender_version,
)
from poseviewer.evaluation.cycles.stage import random_scene
from poseviewer.evaluation.photos import random_view
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.geometry.camera import Pose
from poseviewer.render.software.renderer import SoftwareRenderer
from tests.evaluation.cycles.blender import require_blender
from tests.vehicles import save_vehicle

SIZE = (240, 160)


def make_view(folder, parallel=True):
    path = save_vehicle(folder)
    mesh = load_mesh(path)
    keypoints = load_keypoints(path, mesh)
    assert keypoints is not None
    pose = random_view(mesh, keypoints, SIZE, parallel, np.random.default_rng(1))
    return CyclesPhotographer(mesh, keypoints), pose


def make_scene(photographer, pose, behind, seed=0):
    random = np.random.default_rng(seed)
    return random_scene(pose, photographer.keypoints, behind, False, random)


@pytest.mark.slow
@pytest.mark.parametrize("parallel", [True, False])
def test_blender_covers_the_pixels_that_the_rasteriser_covers(tmp_path, parallel):
    require_blender()
    photographer, pose = make_view(tmp_path, parallel)
    # Off-centre, as a crop is.
    camera = replace(pose.camera, cx=pose.camera.cx + 11.3, cy=pose.camera.cy - 7.6)
    pose = Pose(camera, pose.camera_from_model)
    drawn = photographer.silhouette(pose) > 0.5
    wanted = np.asarray(SoftwareRenderer(photographer.mesh).covers(pose), dtype=bool)
    assert (drawn & wanted).sum() / (drawn | wanted).sum() > 0.99
    for axis in (0, 1):
        off = np.nonzero(drawn)[axis].mean() - np.nonzero(wanted)[axis].mean()
        assert abs(off) < 0.1


@pytest.mark.slow
def test_a_photo_has_the_ground_around_a_vehicle_with_its_shadow(tmp_path):
    require_blender()
    photographer, pose = make_view(tmp_path)
    ground = np.full(3, 0.6)
    photo = photographer.photograph(pose, make_scene(photographer, pose, ground), QUALITY, 8)
    covered = np.asarray(SoftwareRenderer(photographer.mesh).covers(pose), dtype=bool)
    assert photo.shape == (SIZE[1], SIZE[0], 3)
    outside = photo.mean(axis=2)[~covered]
    plain = np.median(outside)
    assert plain == pytest.approx(0.6 * 255, abs=8)
    assert 0.005 < np.mean(outside < 0.85 * plain) < 0.5  # shadow
    assert photo[covered].std() > 15


def test_fingerprints_tell_what_matters(tmp_path):
    require_blender()
    photographer, pose = make_view(tmp_path)
    scene = make_scene(photographer, pose, np.full(3, 0.6))
    same = make_scene(photographer, pose, np.full(3, 0.6))
    kept = photographer.fingerprint(pose, scene, QUALITY)
    assert photographer.fingerprint(pose, same, QUALITY) == kept
    others = [
        photographer.fingerprint(pose, make_scene(photographer, pose, np.full(3, 0.61)), QUALITY),
        photographer.fingerprint(pose, make_scene(photographer, pose, np.full(3, 0.6), 1), QUALITY),
        photographer.fingerprint(pose.scaled(0.5), scene, QUALITY),
        photographer.fingerprint(pose, scene, QUALITY, samples=7),
    ]
    assert len({kept, *others}) == 5


@pytest.mark.slow
def test_a_study_draws_its_photos_once(tmp_path, monkeypatch, capsys):
    require_blender()
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path / "state"))
    model = save_vehicle(tmp_path)
    options = ["--photographer", "cycles", "--kinds", "grey", "--starts", 1, "--deviations", 4,
               "--readings", "relative", "--size", "96x72", "--evaluations", 40,
               "--model", model, "--jobs", 1]  # fmt: skip
    outs = [tmp_path / "first", tmp_path / "second"]
    said = []
    for out in outs:
        assert cli.main([str(x) for x in ("study", "--out", out, *options)]) == 0
        shown = capsys.readouterr()
        assert "path-traced, plain grey ground" in shown.out
        said.append(shown.err.count("path-traced in"))
    assert said == [1, 0]
    photos = [load_photo(out / "photos" / "grey-traced-0.png") for out in outs]
    assert photos[0].sha256 == photos[1].sha256


def test_without_blender_it_is_said_what_to_install(tmp_path, monkeypatch, capsys):
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S -I "$@"\n')
    python.chmod(0o755)
    monkeypatch.setenv(VARIABLE, str(python))
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path / "state"))
    blender_version.cache_clear()
    model = save_vehicle(tmp_path)
    command = ["study", "--out", tmp_path / "out", "--photographer", "cycles", "--model", model,
               "--size", "96x72", "--quiet"]  # fmt: skip
    try:
        assert cli.main([str(x) for x in command]) == 2
    finally:
        blender_version.cache_clear()
    message = capsys.readouterr().err
    assert "poseviewer[photo]" in message
    assert VARIABLE in message
    assert message.count("\n") == 1


@pytest.mark.parametrize("kind", ["photo-parallel", "plain,photo-perspective"])
def test_photos_that_are_not_drawn_have_no_photographer(tmp_path, capsys, kind):
    command = ["study", "--out", str(tmp_path), "--photographer", "cycles", "--kinds", kind]
    assert cli.main(command) == 2
    assert "is not drawn" in capsys.readouterr().err
