"""The benchmark goes every path for real, and says of each what it says it does."""

import pytest

from poseviewer.evaluation import speed
from poseviewer.render.pool import processors
from tests.renderers import require_gpu, require_opengl

MAP_SIZE = 3


@pytest.mark.slow
def test_a_report_has_each_path_both_methods_and_the_maps():
    require_opengl()
    report = speed.measure_speed(True, lambda _: None, MAP_SIZE)
    assert [path.name for path in report.paths] == ["a", "d", "e"]
    for path in report.paths:
        assert min(path.seconds) > 0.0
        assert path.threads == (processors() if path.name == "e" else 1)
    default, paper, maps = report.wholes
    assert "loss default" in default.name
    assert "loss paper" in paper.name
    assert f"{15 * MAP_SIZE**2} points" in maps.end
    text = report.as_markdown()
    for words in ("| a  pyrender", "software, all cores", "machine of 2010", "numba", "15 maps of"):
        assert words in text, words


@pytest.mark.slow
def test_a_gpu_is_timed(monkeypatch):
    require_gpu(monkeypatch)
    work = speed.make_workload(speed.load_demo(), 5_000, 320)
    assert [path.name for path in speed.time_paths(work, "f", 1)] == ["f"]
