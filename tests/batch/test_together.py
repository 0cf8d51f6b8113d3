"""A batch of a BOP scene whose objects are fitted together."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from poseviewer.batch.results import load_manifest
from poseviewer.batch.table import together
from poseviewer.cli import main as cli
from poseviewer.files.formats.bop import load_bop_images
from poseviewer.files.photo import load_photo
from poseviewer.fit.visibility import visibility
from tests.several import MESHES, STARTS, TRUTH, make_bop


def run(*arguments: object) -> int:
    return cli.main([str(argument) for argument in arguments])


def off(index: int, place) -> float:
    one = MESHES[index].vertices
    return float(np.linalg.norm(place.apply(one) - TRUTH[index].pose.camera_from_model.apply(one),
                                axis=1).mean())  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("one_process")
def test_the_objects_of_an_image_are_fitted_together(tmp_path: Path, capsys):
    scene, out = make_bop(tmp_path), tmp_path / "out"
    command = ("batch", scene, "--models", tmp_path / "models", "--together", "--out", out,
               "--quiet")  # fmt: skip
    assert run(*command) == 0
    assert "3 of 3 rows fitted, 0 failed" in capsys.readouterr().out
    (image,) = load_bop_images(out).images
    for index, one in enumerate(image.objects):
        assert off(index, one.place) < 0.5 * off(index, STARTS[index].pose.camera_from_model)
    masks = (out / folder / "000004_000000.png" for folder in ("mask", "mask_visib"))
    whole, seen = (load_photo(mask).pixels > 0 for mask in masks)
    assert seen.sum() / whole.sum() == pytest.approx(visibility(TRUTH).shares[0], abs=0.02)
    with (out / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len({row["pose"] for row in rows}) == 3
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.png")}
    poses = {path: path.stat().st_mtime_ns for path in (out / "poses").iterdir()}
    assert run(*command) == 0  # all is done
    assert all(path.stat().st_mtime_ns == then for path, then in (before | poses).items())
    manifest = load_manifest(out)
    assert manifest.together
    (job,) = together(manifest.jobs)
    assert len(job.mates) == 2


@pytest.mark.usefixtures("one_process")
def test_what_fails_fails_for_all_objects_of_the_image(tmp_path: Path, capsys):
    scene, out = make_bop(tmp_path), tmp_path / "out"
    (tmp_path / "models" / "obj_000002.ply").unlink()
    command = ("batch", scene, "--models", tmp_path / "models", "--together", "--out", out)
    assert run(*command, "--quiet") == 2
    assert "0 of 3 rows fitted, 3 failed" in capsys.readouterr().out
    text = (out / "results.csv").read_text()
    assert text.count("obj_000002.ply: no such file") == 3


def test_together_does_not_go_with_last(tmp_path: Path, capsys):
    scene = make_bop(tmp_path)
    command = ("batch", scene, "--models", tmp_path / "models", "--together", "--start", "last")
    assert run(*command, "--out", tmp_path / "out") == 2
    assert "--together with --start last" in capsys.readouterr().err
