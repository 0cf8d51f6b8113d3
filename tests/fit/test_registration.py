"""What a photo, a model and settings are made into."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.api import load
from poseviewer.errors import SettingsError
from poseviewer.files.demo import demo_case
from poseviewer.fit.problem import make_problem
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.scene.settings import FitSettings, settings_as_json, settings_from_json
from poseviewer.scene.types import Scene as FitScene
from tests.meshes import make_box
from tests.opened import by, scene_of

MESH = make_box()
START = Pose(
    Perspective(100.0, 100.0, 80.0, 60.0, 160, 120),
    RigidTransform(np.eye(3), np.array([0.0, 0.0, 9.0])),
)


def make_photo(chroma: float, channels: int = 3) -> Photo:
    """Grey noise of full range, and colour noise of a standard deviation in grey levels."""
    random = np.random.default_rng(0)
    grey = random.uniform(40.0, 215.0, (120, 160, 1))
    pixels = grey + random.normal(0.0, chroma, (120, 160, channels))
    return Photo(np.clip(np.rint(pixels), 0, 255).astype(np.uint8), "p.png", "0" * 64)


def opened(photo: Photo, mask: Mask | None = None, settings: FitSettings | None = None) -> FitScene:
    return scene_of(photo, MESH, START, settings, mask)


def compared(photo: Photo, settings: FitSettings) -> PhotoAttributes:
    return make_problem(opened(photo, settings=settings))[0].photo


@pytest.mark.parametrize(("chroma", "channels"), [(2.0, 1), (10.0, 3)])
def test_colour_is_compared_where_there_is_some(chroma, channels):
    made = compared(make_photo(chroma), FitSettings())
    assert made.channels.shape == (120, 160, channels)


def test_grey_can_be_had_of_any_photo():
    for photo in (make_photo(30.0), make_photo(30.0, channels=1)):
        made = compared(photo, FitSettings(grey=True))
        assert made.channels.shape == (120, 160, 1)
        assert made.channels[..., 0] == pytest.approx(photo.grey())


def test_near_is_a_box_about_the_start():
    made = compared(make_photo(30.0), FitSettings())
    rows, columns = np.nonzero(made.weights)
    seen = START.project(MESH.vertices)
    margin = 0.25 * np.linalg.norm(np.ptp(seen, axis=0))
    assert columns.min() == pytest.approx(seen[:, 0].min() - margin, abs=1.0)
    assert rows.max() + 1 == pytest.approx(seen[:, 1].max() + margin, abs=1.0)
    assert not made.clipped


@pytest.mark.parametrize(
    ("chosen", "used"), [("near", "clip"), ("clip", "clip"), ("whole", "whole")]
)
def test_the_papers_method_is_grey_on_clipped_or_whole_pixels(chosen, used):
    settings = FitSettings("paper", pixels=chosen, colour_reflectance=True)
    assert settings.pixels == used
    made = compared(make_photo(30.0), settings)
    assert made.channels.shape == (120, 160, 1)
    assert not made.colour_reflectance
    written = settings_as_json(settings)
    assert settings_from_json(written | {"unknown": 3}) == settings
    with pytest.raises(SettingsError, match=r"`\$\.limits\.seconds`; take them out"):
        settings_from_json({"limits": {"seconds": "many"}})


@pytest.mark.parametrize(
    ("chosen", "loss", "search"),
    [
        ({"loss": "paper"}, "paper", "simplex"),
        ({}, "default", "models"),
        ({"pixels": "clip"}, "default", "simplex"),
    ],
)
def test_the_loss_chooses_its_search(chosen, loss, search):
    settings = settings_from_json(chosen)
    assert (settings.loss, settings.searched_by, settings.method) == (loss, search, loss)


def test_a_search_that_was_chosen_goes_with_either_loss():
    for search in ("simplex", "models"):
        paper = FitSettings(search=search).of_loss("paper")
        assert (paper.searched_by, paper.method) == (search, f"paper by {search}")
    assert FitSettings().of_loss("paper").searched_by == "simplex"
    with pytest.raises(SettingsError, match=r"'newton' - at `\$\.search`"):
        settings_from_json({"search": "newton"})


def test_what_a_mask_hides_does_not_count():
    weights = np.ones((120, 160), np.float32)
    weights[:, :80], weights[50, 100] = 0.0, 0.25
    registration = opened(make_photo(30.0), Mask.of(weights))
    for pixels in ("whole", "clip"):
        made = make_problem(by(registration, pixels=pixels))[0].photo
        assert np.array_equal(made.weights, weights)
    near = compared(make_photo(30.0), FitSettings()).weights
    problem, _ = make_problem(registration)
    found = problem.views[0].fine_photo or problem.photo
    assert found.weights.sum() == pytest.approx((near * weights).sum())


def test_blurred_edges_are_made_steep_on_the_finest_photo():
    small, _ = make_problem(opened(make_photo(30.0)))
    assert small.views[0].fine_photo is None
    assert small.photo.structure is not None
    assert small.photo.structure.is_steep
    hidden = np.zeros(small.photo.weights.shape, bool)
    hidden[50:60, 70:80] = True
    rest = small.views[0].without(hidden).photo.structure
    assert rest is not None
    assert rest.is_steep
    demo = demo_case()
    large = load(demo.photo, demo.model, demo.start).problem
    assert large.views[0].fine_photo is not None
    assert large.photo.structure is not None
    assert not large.photo.structure.is_steep


def test_a_mask_of_another_size_is_refused():
    said = "the mask has 20x10 px, the photo p.png has 160x120 px; make"
    with pytest.raises(SettingsError, match=said):
        opened(make_photo(30.0), Mask.of(np.ones((10, 20))))


@pytest.mark.parametrize(
    ("translation", "weight", "said"),
    [
        ([500.0, 0.0, 9.0], 1.0, "near the start pose"),
        ([0.0, 0.0, 9000.0], 1.0, "the pose and the model in one unit"),
        ([0.0, 0.0, 9.0], 0.0, "0 pixels count"),
    ],
    ids=["beside the photo", "in a thousandth of the unit", "all hidden"],
)
def test_a_start_of_which_nothing_can_be_compared_is_refused(translation, weight, said):
    pose = replace(START, camera_from_model=RigidTransform(np.eye(3), np.array(translation)))
    mask = Mask.of(np.full((120, 160), weight))
    with pytest.raises(SettingsError, match=said):
        make_problem(opened(make_photo(30.0), mask).with_pose(0, pose))


@pytest.mark.parametrize("seed", [-1, 1.5, "1"])
def test_a_seed_that_is_none_is_refused(seed):
    with pytest.raises(SettingsError, match=r"^`seed=.*`: wanted a whole number of 0 or more\.$"):
        FitSettings(seed=seed)
