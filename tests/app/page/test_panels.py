"""The curve of a search, and the ends of two methods, as the step "Fit" shows them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from poseviewer.app.page.handles import handles_of, path_of
from poseviewer.app.page.panels import curve_of
from poseviewer.app.page.texts import ends_table
from poseviewer.app.state import commands as c
from poseviewer.app.state.session import SearchRequest, SearchUpdate, Session
from poseviewer.app.workers.jobs import ends_of, run_search
from poseviewer.app.workers.opening import open_files
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.starts.loading import load_model


def outline(end: SearchUpdate) -> str:
    return path_of(end.outline)


@pytest.fixture(scope="module")
def ended(scene) -> list[SearchUpdate]:
    """The last update of a search by each method."""
    document, limits = open_files(scene.photo, scene.model, scene.start), Limits(600)
    methods: Any = ("paper", "default")
    settings = tuple(FitSettings(method, limits=limits) for method in methods)
    *_, last = run_search(SearchRequest(document, settings, (0,)))
    return list(last.ends)


def test_the_curve_goes_down_and_has_a_line_at_each_restart(ended):
    for update in ended:
        evaluations, best, begun = curve_of(update)
        assert np.all(np.diff(evaluations) > 0.0)
        assert np.all(np.diff(best) <= 0.0)
        scale = update.progress.scale
        assert best[-1] == pytest.approx(scale.shown(update.progress.loss))
        restarts = [step.evaluations for step in update.restarts]
        assert list(evaluations[begun == 1.0]) == restarts
        assert len(restarts) > 0
        for step in update.improvements:
            shown = best[list(evaluations).index(step.evaluations)]
            assert shown == pytest.approx(scale.shown(step.loss))


def test_the_table_has_the_loss_of_each_end_by_each_method(scene, ended):
    mesh = load_model(scene.model).mesh
    ours, paper = ends = ends_of(ended, mesh, SoftwareRenderer(mesh))
    table, said = ends_table(ends, mesh).split("\n\n")
    cells = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()]
    assert cells[0] == ["", "Default", "Paper"]
    rows = {row[0]: row[1:] for row in cells}
    assert rows["Paper: loss (of 1)"] == [f"{ours.losses[1]:.3f}", f"{paper.losses[1]:.3f}"]
    assert "Default: unexplained" in rows
    assert rows["evaluations"] == [f"{end.progress.evaluations:,}" for end in ends]
    apart = pose_error(mesh, paper.progress.pose, ours.progress.pose)
    assert f"{apart.reprojection_px:.1f} px apart" in said


def test_both_ends_are_drawn_until_the_pose_is_another(scene, ended):
    document = open_files(scene.photo, scene.model, scene.start)
    ends = ends_of(ended, document.mesh, SoftwareRenderer(document.mesh))
    session = c.compare_losses()(Session(document))
    assert session.search is not None
    last = replace(ended[-1], is_over=True, ends=ends)
    compared = c.search_advanced(session.search.asked, last)(session)
    pink = [outline(end) in handles_of(compared) for end in ends]
    assert pink == [ends[0].settings.loss != last.settings.loss, last.settings.loss == "default"]
    other = c.take_end(pink.index(True))(compared)
    assert [outline(end) in handles_of(other) for end in ends] == [not is_pink for is_pink in pink]
    assert not any(outline(end) in handles_of(c.nudge("move", 1.0)(other)) for end in ends)
