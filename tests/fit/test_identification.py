"""Which model is it: the right one first, judged on pixels that all share."""

import numpy as np
import pytest
import trimesh

from poseviewer.errors import SettingsError
from poseviewer.fit.identification import identify, settings_for_all
from poseviewer.fit.problem import make_problem
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.scene.settings import FitSettings, Limits
from tests.commands import run

BRIEFLY = FitSettings(limits=Limits(evaluations=150))


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """Two models that the scene's photo does not show."""
    folder = tmp_path_factory.mktemp("others")
    trimesh.creation.box((1.6, 1.0, 1.2)).export(str(folder / "box.ply"))
    trimesh.creation.cone(0.8, 1.8).export(str(folder / "cone.ply"))
    return [folder / "box.ply", folder / "cone.ply"]


def open_all(scene, models):
    return [open_scene(Sources(scene.photo, model=model, start=scene.start)) for model in models]


def test_the_model_of_the_photo_is_first(scene, others):
    for models in ([scene.model, *others], [*others, scene.model]):
        ranked = identify(open_all(scene, models), BRIEFLY)
        losses = [fit.loss for _, fit in ranked]
        assert losses == sorted(losses)
        assert [ranked[0][0], len(ranked)] == [scene.model.name, 3]
        assert ranked[1][1].unexplained - ranked[0][1].unexplained > 0.1
        assert all(fit.loss <= fit.start_loss for _, fit in ranked)


def test_all_models_are_judged_on_the_same_pixels_and_a_region_cuts_them(scene, others):
    opened = open_all(scene, [scene.model, *others])

    def weights(settings: FitSettings) -> list[np.ndarray]:
        shared = settings_for_all(opened, settings)
        problems = (make_problem(one.with_object(0, settings=shared)) for one in opened)
        return [problem.photo.weights for problem, _ in problems]

    for mine, one in zip(whole := weights(FitSettings()), opened, strict=True):
        np.testing.assert_array_equal(mine, whole[0])
        assert np.all(mine[make_problem(one)[0].photo.weights > 0.0] > 0.0)
    cut = weights(FitSettings(region=Rectangle(0, 0, 80, 200)))[0]
    assert np.any(cut > 0.0)
    assert not np.any(cut[:, 80:])
    assert np.all(weights(FitSettings(pixels="whole"))[0] == 1.0)


def test_what_cannot_be_compared_is_refused(scene, others):
    with pytest.raises(SettingsError, match="two or more"):
        identify(open_all(scene, [scene.model]), BRIEFLY)
    with pytest.raises(SettingsError, match='pixels="clip"'):
        identify(open_all(scene, [scene.model, *others]), FitSettings(pixels="clip"))


def test_the_command_prints_a_table(scene, others, capsys):
    files = scene.photo, others[0], scene.model, "--start", scene.start
    assert run("identify --evaluations 100 --quiet", *files) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    lines = printed.out.splitlines()
    assert lines[1].split()[:2] == ["1", scene.model.name]
    assert lines[2].split()[:2] == ["2", "box.ply"]
