"""The curve of a search, and the ends of two methods, as a page shows them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lxml import html

from poseviewer.app.page.comparisons import ends_table
from poseviewer.app.page.panels import curve_of
from poseviewer.app.state.session import SearchUpdate
from poseviewer.app.workers.jobs import ends_of, search
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_registration


@pytest.fixture(scope="module")
def ended(scene) -> list[SearchUpdate]:
    """The last update of a search by each method."""
    own = load_registration(scene.photo, scene.model, scene.start)
    renderer, limits = SoftwareRenderer(own.mesh), Limits(evaluations=600)
    methods: Any = ("paper", "default")
    return [
        list(search(own, own.start, FitSettings(method, limits=limits), renderer))[-1]
        for method in methods
    ]


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


def test_the_table_has_the_loss_of_each_end_by_each_method(ended):
    ours, paper = ends = ends_of(ended)
    page = html.fromstring(ends_table(ends))
    assert [cell.text_content() for cell in page.xpath("//th")] == [
        "",
        "classes and edges",
        "Jayawardena 2010",
    ]
    rows = {row[0].text_content(): row for row in page.xpath("//tbody/tr")}
    shown = [cell.text_content() for cell in rows["Jayawardena 2010: loss (of 1)"]][1:]
    assert shown == [f"{ours.losses[1]:.3f}", f"{paper.losses[1]:.3f}"]
    assert "classes and edges: unexplained" in rows
    for what, read in (("evaluations", lambda p: f"{p.evaluations:,}"), ("seconds", seconds)):
        assert [cell.text_content() for cell in rows[what]][1:] == [
            read(end.update.progress) for end in ends
        ]
    mesh = ours.update.case.registration.mesh
    apart = pose_error(mesh, paper.update.progress.pose, ours.update.progress.pose)
    assert f"{apart.reprojection_px:.1f} px apart" in page.text_content()


def seconds(progress: Any) -> str:
    """As the table has them."""
    return f"{progress.seconds:.1f}"
