"""``poseviewer track``: chains of a sequence as rows, whose results make the whole again."""

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from poseviewer.api import load
from poseviewer.batch.chains import count_steps, open_chains
from poseviewer.errors import SettingsError
from poseviewer.files.masks import load_mask
from poseviewer.files.photo import frame_bytes, load_photo, save_image
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.files.scene_json import load_scene, save_scene
from poseviewer.files.writing import sha256_of
from poseviewer.fit.problem import make_problem
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.scene.sequence import show_frame
from poseviewer.scene.types import PlacedModel, Scene
from tests.commands import read_rows, refusal, run
from tests.moving import ball, box, off, sequence, write_sequence
from tests.several import CAMERA


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Chains are run in this process, and their frames are noted."""
    begun = list[str]()

    def run_here(function, jobs, *_):
        for job in jobs:
            begun.append("{},{}".format(*job.frames))
            yield job, function(job)

    monkeypatch.setattr("poseviewer.batch.run.run_in_processes", run_here)
    return begun


def results(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / "rows").glob("*.json")}


@pytest.mark.slow
def test_chains_are_joined_and_done_once(tmp_path, here, capsys):
    keys = {index: [ball(index)] for index in (1, 3)}
    path, out = write_sequence(tmp_path, sequence(keys, count=4)), tmp_path / "out"
    assert run("track", path, "--out", out, "--quiet") == 0
    assert "4 of 4 frames have poses" in capsys.readouterr().out
    scene = load_scene(out / "scene.json")
    sources = [frame.poses["a"].source for frame in scene.frames]
    assert sources == ["propagated", "key", "propagated", "key"]
    assert all(off(scene, index, ball(index)) < 1.0 for index in range(4))
    assert [row["status"] for row in read_rows(out / "results.csv")] == [
        "1 of 2 frames have propagated poses.", "1 of 3 frames have propagated poses.",
    ]  # fmt: skip
    assert len(read_rows(out / "poses.csv")) == 4
    assert here == ["0,1", "1,3"]
    # As many steps as the progress counts with: one way to the first key, both between two.
    start, batch = open_chains(scene, tmp_path / "counted")
    lines = [len(path.read_text().splitlines()) for path in sorted((out / "poses").iterdir())]
    assert lines == [count_steps(start, job) for job in batch.jobs] == [1, 2]
    before = results(out)
    # The poses so far are kept, and a chain is begun again where its keys have changed.
    assert run("track", out / "scene.json", "--out", out) == 0
    assert "2 of 2 chains were done before" in capsys.readouterr().err
    assert results(out) == before
    (tmp_path / "mended").mkdir()
    mended = write_sequence(tmp_path / "mended", sequence({1: [ball(1)], 3: [ball(3.02)]}, count=4))
    assert run("track", mended, "--out", out, "--quiet") == 0
    assert here == ["0,1", "1,3", "0,1", "1,3"]  # the photos are others


@pytest.mark.usefixtures("here")
def test_a_chain_that_was_cut_off_goes_on_after_its_last_line(tmp_path):
    path, out = write_sequence(tmp_path, sequence({0: [ball(0)]}, count=4)), tmp_path / "out"
    words = "track", path, "--out", out, "--quiet"
    assert run(*words) == 0
    ((whole,), (row,)) = ([*(out / name).iterdir()] for name in ("poses", "rows"))
    first, *others = whole.read_text().splitlines(keepends=True)
    assert len(others) == 2
    # As after a kill: no result, and half a line. What is known is not searched for again.
    row.unlink()
    marked = json.dumps({**json.loads(first), "note": "marked"}) + "\n"
    whole.write_text(marked + others[0][:100])
    assert run(*words) == 0
    again = whole.read_text().splitlines(keepends=True)
    assert json.loads(again[0]) == json.loads(marked)
    assert [json.loads(line)["frame_index"] for line in again] == [1, 2, 3]
    tracked = load_scene(out / "scene.json")
    assert all(off(tracked, index, ball(index)) < 1.0 for index in range(4))


@pytest.mark.slow
@pytest.mark.long
def test_a_frame_that_vanishes_costs_no_pose_of_another(tmp_path, monkeypatch, capsys):
    keys = {index: [ball(index)] for index in (0, 2)}
    path, out = write_sequence(tmp_path, sequence(keys, count=4)), tmp_path / "out"
    photo, away = tmp_path / "frames" / "1.png", tmp_path / "1.png"

    def run_here(function, jobs, *_):
        photo.rename(away)
        for job in jobs:
            yield job, function(job)

    monkeypatch.setattr("poseviewer.batch.run.run_in_processes", run_here)
    words = "track", path, "--out", out, "--quiet"
    assert run(*words) == 2
    said = capsys.readouterr().out
    assert "1.png: no longer there" in said
    assert "3 of 3 frames have poses" in said
    assert "1 frame is no longer there" in said
    left = open_scene(Sources(scene=out / "scene.json"))
    assert [frame.file.name for frame in left.frames] == ["0.png", "2.png", "3.png"]
    away.rename(photo)
    assert run(*words) == 2  # it vanishes again, before the other chain, which is done
    away.rename(photo)
    monkeypatch.setattr(
        "poseviewer.batch.run.run_in_processes",
        lambda function, jobs, *_: ((job, function(job)) for job in jobs),
    )
    assert run(*words) == 0
    tracked = load_scene(out / "scene.json")
    assert all(off(tracked, index, ball(index)) < 1.0 for index in range(4))


@pytest.mark.parametrize(("frames_in_memory", "wanted"), [(0.5, 1), (2.0, 2), (math.inf, 3)])
def test_no_more_processes_track_than_the_memory_holds(
    tmp_path, monkeypatch, frames_in_memory, wanted
):
    counts = list[int]()

    def stop(_, __, count, *___):
        counts.append(count)
        raise KeyboardInterrupt

    monkeypatch.setattr("poseviewer.batch.run.run_in_processes", stop)
    monkeypatch.setattr("poseviewer.render.pool.processors", lambda: 4)
    taken = frames_in_memory * frame_bytes(CAMERA.width, CAMERA.height)
    monkeypatch.setattr("poseviewer.processes.memory_bytes", lambda: taken)
    path = write_sequence(tmp_path, sequence({1: [ball(1)], 2: [ball(2)]}, count=4))
    assert run("track", path, "--out", tmp_path / "out", "--quiet") == 130
    assert counts == [wanted]


@pytest.mark.usefixtures("here")
def test_ctrl_c_while_results_are_joined_says_that_they_are_kept(tmp_path, monkeypatch, capsys):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("poseviewer.batch.chains.save_sequence", interrupt)
    path = write_sequence(tmp_path, sequence({0: [ball(0)]}, count=1))
    assert run("track", path, "--out", tmp_path / "out", "--quiet") == 130
    assert "what is done is kept" in capsys.readouterr().err


def test_folder_of_frames_goes_out_from_any_frame(tmp_path, here, capsys):
    scene = sequence({0: [ball(0)]}, count=3)
    write_sequence(tmp_path, scene)
    save_pose(tmp_path / "key.json", PoseRecord.of(ball(1).pose))
    line = "track", tmp_path / "frames", tmp_path / "a.ply", "--out", tmp_path / "out", "--quiet"
    assert "--pose" in refusal(capsys, *line)
    line = *line, "--pose", tmp_path / "key.json"
    assert "3 frames" in refusal(capsys, *line, "--key", 4)
    assert run(*line, "--key", 2) == 0
    tracked = load_scene(tmp_path / "out" / "scene.json")
    (name,) = (item.id for item in tracked.objects)
    sources = [frame.poses[name].source for frame in tracked.frames]
    assert sources == ["propagated", "key", "propagated"]
    assert all(off(tracked, index, ball(index), name) < 1.0 for index in range(3))
    assert here == ["0,1", "1,2"]


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_what_was_opened_is_said_and_a_torn_frame_is_stepped_over(tmp_path, capsys):
    write_sequence(tmp_path, sequence({0: [ball(0)]}, count=6))
    frames = tmp_path / "frames"
    for index, left in ((2, 200), (4, 0)):
        path = frames / f"{index}.png"
        path.write_bytes(path.read_bytes()[: path.stat().st_size * left // 400])
    (frames / "5.png").rename(frames / "6.png")
    guess, place = load_photo(frames / "0.png").default_camera(), ball(0).pose.camera_from_model
    nearer = place.translation * [1.0, 1.0, guess.fx / CAMERA.fx]
    key = Pose(guess, replace(place, translation=nearer))
    save_pose(tmp_path / "key.json", PoseRecord.of(key))
    model: Any = trimesh.load(tmp_path / "a.ply", process=False)
    model.faces = [*model.faces, (0, 0, 0)]
    model.export(tmp_path / "a.ply")
    line = "track", frames, tmp_path / "a.ply", "--pose", tmp_path / "key.json"
    assert run(*line, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr()
    for words in (
        "note: A frame is missing between 4.png and 6.png",
        "note: 1 of 6 frames are left out: 4.png: an empty file",
        "note: a.ply: Triangles without area, left out: 1.",
        "note: The focal length is assumed",
    ):
        assert words in printed.err
    assert "2.png: cannot be read" in printed.out
    assert "; stepped over.\n" in printed.out
    assert "4 of 5 frames have poses" in printed.out
    poses = load_scene(tmp_path / "out" / "scene.json").frames
    assert [bool(frame.poses) for frame in poses] == [True, True, False, True, True]


@pytest.mark.slow
@pytest.mark.parametrize("how", ["each", "a folder", "both"])
def test_several_keys_are_named_one_by_one_or_by_a_folder(tmp_path, here, how):
    write_sequence(tmp_path, sequence({0: [ball(0)]}, count=4))
    keys = tmp_path / "keys"
    keys.mkdir()
    for index, name in ((0, "0.pose.json"), (3, "3.json")):
        save_pose(keys / name, PoseRecord.of(ball(index).pose))
    line = ["track", tmp_path / "frames", tmp_path / "a.ply", "--out", tmp_path / "out", "--quiet"]
    given = {
        "each": ["--key", f"1={keys}/0.pose.json", "--key", f"4={keys}/3.json"],
        "a folder": ["--key", keys],
        "both": ["--pose", keys / "0.pose.json", "--key", f"4={keys}/3.json"],
    }[how]
    assert run(*line, *given) == 0
    frames = load_scene(tmp_path / "out" / "scene.json").frames
    sources = [pose.source for frame in frames for pose in frame.poses.values()]
    assert sources == ["key", "propagated", "propagated", "key"]
    assert here == ["0,3"]


def test_keys_that_cannot_be_are_refused(tmp_path, capsys):
    write_sequence(tmp_path, sequence({0: [ball(0)]}, count=3))
    pose = tmp_path / "0.json"
    save_pose(pose, PoseRecord.of(ball(0).pose))
    (tmp_path / "keys").mkdir()
    line = ["track", tmp_path / "frames", tmp_path / "a.ply", "--out", tmp_path / "out", "--quiet"]
    for words, said in (
        ([], "give --pose, the pose in the first frame, or --key N=POSE.json"),
        (["--key", 2], "or --key N=POSE.json"),
        (["--key", 2, "--key", f"1={pose}"], "--key 2 without a pose of its own"),
        (["--pose", pose, "--key", f"1={pose}"], "frame 1 has two poses by --key"),
        (["--key", f"1={pose}", "--key", f"1={pose}"], "frame 1 has two poses by --key"),
        (["--key", f"9={pose}"], "has 3 frames; name one of them"),
        (["--key", f"2={tmp_path}/no.json"], "no.json: no such file"),
        (["--key", tmp_path / "keys"], "keys: no pose file in it; wanted names of frames, such"),
        (["--key", tmp_path], "scene.json; wanted names of frames, such as 0.pose.json"),
        (["--key", f"first={pose}"], "is not a number of a frame and a pose file, N=POSE.json"),
    ):
        assert said in refusal(capsys, *line, *words), words
    assert not (tmp_path / "out").exists()


def test_api_tracks_a_range(tmp_path):
    path = write_sequence(tmp_path, sequence({0: [ball(0)]}, count=4))
    seen = []
    tracked = load(path).track(0, 2, watch=lambda _, step: seen.append(step.frame_index))
    assert seen == [1, 2]
    assert [bool(frame.poses) for frame in tracked.scene.frames] == [True, True, True, False]
    tracked.save(tmp_path / "tracked.json")
    assert off(load_scene(tmp_path / "tracked.json"), 2, ball(2)) < 1.0


def test_sequence_without_keys_is_refused(tmp_path, capsys):
    scene = sequence({0: [ball(0)]}, count=2)
    frames = tuple(replace(frame, poses={}) for frame in scene.frames)
    path = write_sequence(tmp_path, replace(scene, frames=frames))
    assert "no pose is a key" in refusal(capsys, "track", path, "--out", tmp_path / "out")
    with pytest.raises(SettingsError, match="no pose is a key"):
        load(path).track()


def test_frames_that_are_no_longer_those_of_their_poses_are_said(tmp_path, capsys):
    path = write_sequence(tmp_path, sequence({0: [ball(0)]}, count=1))
    scene = load_scene(path)
    photo = scene.frames[0].file.location
    known = replace(scene.frames[0].file, sha256=sha256_of(photo))
    save_scene(path, replace(scene, frames=(replace(scene.frames[0], file=known),)))
    assert run("track", path, "--out", tmp_path / "out") == 0
    assert "fingerprints" not in capsys.readouterr().err
    photo.write_bytes(photo.read_bytes() + b"another picture")
    assert run("track", path, "--out", tmp_path / "out") == 0
    assert "note: 1 of 1 frames are other pictures than" in capsys.readouterr().err


POST = slice(136, 162)
"""Columns of the second frame's photo that a post covers."""


def write_case(folder: Path, placed: Sequence[Callable[[float], PlacedModel]]) -> list[Path]:
    """Write three frames, with a post before the ball in the second, a mask, and poses off there;
    return the pose files.
    """
    scene = sequence({1: [one(1) for one in placed]}, drawn=tuple(placed), count=3)
    frames = write_sequence(folder, scene).with_name("frames")
    pixels = scene.frames[1].file.photo.pixels.copy()
    noise = np.random.default_rng(0).normal(0.0, 6.0, (*pixels[:, POST].shape[:2], 3))
    pixels[:, POST] = np.clip(np.array([70, 110, 60]) + noise, 0, 255)
    save_image(frames / "1.png", pixels)
    counts = np.full((*pixels.shape[:2], 3), 255, np.uint8)
    counts[-40:] = 0
    save_image(folder / "mask.png", counts)
    poses = []
    for name, one in zip("ab", (one(1) for one in placed), strict=False):
        off_by = np.array([0.03, -0.03, 0.02, 0.02, -0.02, 0.02])
        start = FreeBodyChart.near(one.mesh, one.pose).to_pose(off_by)
        poses.append(folder / f"{name}.start.json")
        save_pose(poses[-1], PoseRecord.of(start))
    return poses


def covers_post(scene: Scene, index: int) -> bool:
    """Tell whether pixels of the post are left out in a frame."""
    weights = make_problem(show_frame(scene, index))[0].views[0].photo.weights
    _, width = weights.shape
    left, right = (round(column * width / 320) for column in (POST.start, POST.stop))
    middle = slice(weights.shape[0] * 2 // 5, weights.shape[0] * 3 // 5)
    return bool(np.mean(weights[middle, left + 1 : right - 1] == 0.0) > 0.5)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("mask", ["", "of its frame", "of all frames"])
def test_the_whole_way_from_a_fit_in_the_middle_to_an_audit(tmp_path, monkeypatch, capsys, mask):
    monkeypatch.chdir(tmp_path)
    (start,) = write_case(tmp_path, [ball])
    masked = ["--mask", "mask.png"] if mask else []
    line = "fit frames/1.png a.ply --out key.json --quiet --pose", start, *masked
    assert run(*line) == 0
    record = load_pose("key.json")
    assert record.mask == ("key.mask.png" if mask else None)
    assert record.occluders == "key.occluders.png"  # the post
    line = ["track frames a.ply --pose key.json --key 2 --out out"]
    line += ["--mask-all-frames"] if mask == "of all frames" else []
    assert run(*line) == 0
    assert ("hides pixels of 1.png alone" in capsys.readouterr().err) == (mask == "of its frame")
    assert len(read_rows(tmp_path / "out" / "results.csv")) == 2
    scene = open_scene(Sources(scene=Path("out/scene.json")))
    for index in range(3):
        hidden = [] if scene.views[0].mask is None else [scene.views[0].mask]
        assert len(hidden) == (mask == "of all frames")
        assert covers_post(scene, index) == (index == 1)
        assert off(scene, index, ball(index), "1") < 3.0
    # The same again, from what it wrote; then on to other tools, and to an audit.
    assert run("track out/scene.json --out out --quiet") == 0
    assert run("convert out/scene.json bop --to bop --unit mm --object 5") == 0
    assert [*json.loads(Path("bop/scene_gt.json").read_text())] == ["0", "1", "2"]
    assert len([*Path("bop/mask_visib").glob("*.png")]) == 3
    assert run("convert out/scene.json poses --to poseviewer") == 0
    masks = {path.name for path in Path("poses").glob("*.png")}
    wanted = {"": set(), "of its frame": {"1"}, "of all frames": {"0", "1", "2"}}[mask]
    assert masks == {f"{name}.mask.png" for name in wanted} | {"1.occluders.png"}
    if mask != "of its frame":
        return  # an audit of one of the three will do
    assert run("audit out/scene.json --out audited --quiet --evaluations 300") == 0
    rows = read_rows(tmp_path / "audited" / "results.csv")
    assert [row["finding"] for row in rows] == [""] * 3


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("here")
def test_the_whole_way_of_two_objects_with_a_mask(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path, [ball, lambda index: box(index - 8)])
    scene = load_scene("scene.json")
    frame = replace(scene.frames[1], mask=load_mask("mask.png"))
    save_scene("scene.json", replace(scene, frames=(scene.frames[0], frame, scene.frames[2])))
    assert run("track scene.json --out out --quiet") == 0
    tracked = load_scene("out/scene.json")
    assert [sorted(frame.poses) for frame in tracked.frames] == [["a", "b"]] * 3
    assert [bool(frame.mask) for frame in tracked.frames] == [False, True, False]
    assert len(read_rows(tmp_path / "out" / "results.csv")) == 2
    assert run("track out/scene.json --out out --quiet") == 0
    assert run("convert out/scene.json poses.csv --to csv") == 0
    assert len(read_rows(tmp_path / "poses.csv")) == 6
    assert run("audit out/scene.json --out audited --quiet --evaluations 300") == 0
    assert len(read_rows(tmp_path / "audited" / "results.csv")) == 6


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGTERM that can be heeded there")
def test_stopped_command_goes_on_where_it_was(tmp_path):
    keys = {index: [ball(index)] for index in (0, 4, 8)}
    path, out = write_sequence(tmp_path, sequence(keys, count=9)), tmp_path / "out"
    words = ["track", path, "--out", out, "--processes", 1, "--quiet"]
    line = [sys.executable, "-m", "poseviewer.cli.main", *map(str, words)]
    with subprocess.Popen(
        line, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        end = time.monotonic() + 240.0
        while not (out / "rows").exists() or not results(out):
            assert time.monotonic() < end
            time.sleep(0.02)
        process.terminate()  # as by a scheduler, or by hand; it says the same as after Ctrl-C
        printed, complaints = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "stopped, run it again to go on" in printed
    assert complaints == ""
    before = results(out)
    assert len(before) == 1
    assert all(frame.poses for frame in load_scene(out / "scene.json").frames[:5])
    assert run(*words) == 0
    assert before.items() <= results(out).items()
    assert all(frame.poses for frame in load_scene(out / "scene.json").frames)
