"""Faults of films: a track goes on where it is right, and ends where it is not, with its reason."""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from poseviewer.confidence.verdict import Features, Verdict
from poseviewer.fit import propagation
from poseviewer.fit.occlusion import find_occluded
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.propagation import propagate
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.sequence import FrameStep
from poseviewer.scene.types import Scene
from tests.fit.test_point_motion import CAN, moved
from tests.fit.test_propagation import printed_sequence

pytestmark = pytest.mark.slow

COUNT = 6
POSES = [moved(60.0 * left, (left, 0.0, 0.0)) for left in (0.0, 0.05, 0.08, 0.16, 0.19, 0.25)]
"""The can rolls to the right, unevenly."""
Pixels = NDArray[np.uint8]


@pytest.fixture(autouse=True)
def short_second_search(monkeypatch):
    """Nobody waits in a test for a search of half a minute that finds nothing."""
    monkeypatch.setattr(propagation, "LOOK_AGAIN_S", 1.0)


def film(change: Callable[[int, Pixels], Pixels]) -> Scene:
    """The printed can in frames that are changed, the key in the first one."""
    scene = printed_sequence(POSES)
    frames = []
    for index, frame in enumerate(scene.frames):
        photo = frame.file.photo
        pixels = np.ascontiguousarray(change(index, photo.pixels.astype(np.uint8)))
        changed = replace(photo, pixels=pixels, sha256=f"{index + 1:064x}")
        frames.append(replace(frame, file=PhotoFile.of(changed)))
    return replace(scene, frames=tuple(frames))


def run(scene: Scene) -> tuple[list[FrameStep], dict[int, tuple[float, str]]]:
    """Steps, and the error, %, and label of each pose, by its frame."""
    steps = list(propagate(scene, {0: SoftwareRenderer(CAN)}, 0, COUNT - 1, threads=2))
    ends = {}
    for step in steps:
        for found in step.poses.values():
            assert found.result is not None
            pose = scene.views[0].pose(found.world_from_model)
            error = pose_error(CAN, pose, POSES[step.frame_index]).percent
            ends[step.frame_index] = error, str(found.result.verdict)
    return steps, ends


def blur(index: int, pixels: Pixels) -> Pixels:
    """The camera is shaken in one frame."""
    return np.asarray(cv2.blur(pixels, (9, 1)), np.uint8) if index == 2 else pixels


def switch_light(index: int, pixels: Pixels) -> Pixels:
    """Another light, weaker and yellow."""
    return (pixels * [0.5, 0.45, 0.3]).astype(np.uint8) if index >= 2 else pixels


def put_specks(_: int, pixels: Pixels) -> Pixels:
    """Dirt on the lens: corners that stand still while the can moves."""
    pixels = pixels.copy()
    for x, y in np.random.default_rng(2).integers((90, 50), (240, 190), (40, 2)):
        cv2.circle(pixels, (int(x), int(y)), 1, (0, 0, 0), -1)
    return pixels


def roll_shutter(_: int, pixels: Pixels) -> Pixels:
    """The camera moves to the right by 3 px while it reads its rows."""
    height, width = pixels.shape[:2]
    shear = np.array([[1.0, 3.0 / height, -1.5], [0.0, 1.0, 0.0]])
    return np.asarray(cv2.warpAffine(pixels, shear, (width, height)), np.uint8)


@pytest.mark.long
@pytest.mark.parametrize("change", [blur, switch_light, put_specks, roll_shutter])
def test_a_right_track_goes_on(change: Callable[[int, Pixels], Pixels]):
    steps, ends = run(film(change))
    assert [step.note for step in steps if step.note] == []
    assert list(ends) == [1, 2, 3, 4, 5]
    assert max(error for error, _ in ends.values()) < 2.0
    assert ends[5][0] < 1.0


def cut(index: int, pixels: Pixels) -> Pixels:
    """The film goes on elsewhere."""
    blocks = np.random.default_rng(4).integers(0, 255, (24, 32, 3)).astype(np.uint8)
    other = cv2.resize(blocks, pixels.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    return np.asarray(other, np.uint8) if index >= 2 else pixels


def mirror(index: int, pixels: Pixels) -> Pixels:
    return pixels[:, ::-1] if index >= 2 else pixels


@pytest.mark.long
def test_a_mirrored_film_is_not_found():
    _, ends = run(film(mirror))
    assert ends[1][0] < 1.0
    assert all("found" not in verdict for index, (_, verdict) in ends.items() if index > 1)


def test_a_wrong_track_ends_and_says_why():
    steps, ends = run(film(cut))
    assert list(ends) == [1]
    assert ends[1][0] < 1.0
    (note,) = [step.note for step in steps if step.note]
    assert note.startswith("frame 3 (2.png): a is lost: ")
    assert note.endswith(". Place it there, or later, as another key.")
    assert "calibration" not in note


@pytest.mark.long
def test_nothing_is_looked_for_in_front_where_the_photo_is_explained_as_at_the_key(monkeypatch):
    asked = []

    def find(*about: Any, **how: Any) -> Any:
        asked.append(about)
        return find_occluded(*about, **how)

    told, judge_in_film = list[bool](), propagation._judge_in_film

    def judge(end: FitProgress, key: Any, is_told: bool, is_jump: bool) -> FitProgress:
        told.append(is_told)
        return judge_in_film(end, key, is_told, is_jump)

    monkeypatch.setattr(propagation, "find_occluded", find)
    monkeypatch.setattr(propagation, "_judge_in_film", judge)
    _, ends = run(film(lambda _, pixels: pixels))
    assert max(error for error, _ in ends.values()) < 1.0
    assert len(asked) == 1  # at the key
    assert told[0]  # points tell the motion, though the loss is minimised alone, too


def hold_board(index: int, pixels: Pixels) -> Pixels:
    """A striped board before the left of the can, from the third frame on."""
    pixels = pixels.copy()
    if index >= 2:
        stripes = np.kron(np.random.default_rng(8).integers(30, 220, (24, 1)), np.ones((10, 1)))
        pixels[:, : 148 + 3 * index] = stripes[..., None]
    return pixels


@pytest.mark.long
def test_what_is_in_front_is_left_out():
    steps, ends = run(film(hold_board))
    assert max(error for error, _ in ends.values()) < 2.0
    results = [step.poses["a"].result for step in steps]
    shares = [result.seen[0] for result in results if result and result.seen[0] is not None]
    assert min(shares[:1]) > 0.99
    assert max(shares[1:]) < 0.85


def make_noisy(index: int, pixels: Pixels) -> Pixels:
    """So that no pose explains all of the photo, as in real ones."""
    noise = np.random.default_rng(index).normal(0.0, 20.0, pixels.shape)
    return np.clip(pixels + noise, 0, 255).astype(np.uint8)


@pytest.mark.long
def test_a_printed_thing_whose_points_tell_its_pose_takes_few_evaluations(monkeypatch):
    asked = []

    def evaluate(*about: Any) -> float:
        asked.append(about)
        return pose_loss(*about)

    monkeypatch.setattr(propagation, "pose_loss", evaluate)
    counts = []
    renderers = {0: SoftwareRenderer(CAN)}
    for step in propagate(film(make_noisy), renderers, 0, COUNT - 1):
        counts.append(len(asked))
        assert step.poses
        asked.clear()
    assert sorted(counts[1:])[2] < 30


@pytest.mark.parametrize(
    ("rise", "drop", "probability", "is_told", "wanted"),
    [
        (0.0, 0.0, 0.9, True, "found"),
        (0.1, 0.0, 0.9, True, "doubtful"),
        (0.0, 0.3, 0.9, True, "doubtful"),
        (0.2, 0.0, 0.9, True, "doubtful"),
        (0.1, 0.0, 0.96, True, "found"),
        (0.2, 0.0, 0.9, False, "doubtful"),
        (0.2, 0.0, 0.4, False, "lost"),
        (0.2, 0.3, 0.4, True, "lost"),
        (0.0, 0.0, 0.1, True, "doubtful"),
        (0.1, 0.0, 0.1, True, "lost"),
    ],
)
def test_the_verdict_of_a_film_compares_with_the_key(
    rise: float, drop: float, probability: float, is_told: bool, wanted: str
):
    scene = printed_sequence(POSES[:1])
    problem = make_problem(scene)[0]
    nothing = brentq(lambda loss: problem.scale.as_unexplained(loss) - 0.4 - rise, -10.0, 100.0)
    features = Features(1.0, 2.0, 0.9 - drop, 1.0)
    label = "found" if probability > 0.8 else "lost"
    verdict = Verdict(label, probability, ("It is so.",), asdict(features))
    end = replace(FitProgress.at_start(problem), loss=nothing, verdict=verdict)
    judged = propagation._judge_in_film(end, propagation._AtKey(0.4, 0.9), is_told).verdict
    assert judged is not None
    assert judged.label == wanted
    is_told_by_key = rise > 0.06 and probability < 0.95
    assert len(judged.reasons) == 1 + is_told_by_key + (drop > 0.25)
