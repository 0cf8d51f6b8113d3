"""The curve of a search, and the ends of two methods, as the step "Fit" shows them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import viser

from poseviewer.app.below_viser.guard import serve
from poseviewer.app.page.controls import Controls
from poseviewer.app.page.handles import handles_of, path_of
from poseviewer.app.page.panels import STEPS, curve_of
from poseviewer.app.page.texts import ends_table
from poseviewer.app.state.results import LossComparison, SearchRequest
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import search_edits
from poseviewer.geometry.charts import short_name
from poseviewer.geometry.pose_error import pose_error
from poseviewer.scene.settings import FitSettings, Limits
from tests.app.state import edits as c
from tests.app.state.documents import after, open_files
from tests.app.state.sets import make_set_session


@pytest.fixture(scope="module")
def comparison(scene) -> LossComparison:
    """The ends of a search by each method."""
    document, limits = open_files(scene.photo, scene.model, scene.start), Limits(600)
    methods: Any = ("paper", "default")
    settings = tuple(FitSettings(method, limits=limits) for method in methods)
    *_, last = search_edits(SearchRequest(document, settings, (0,)))
    return last.arguments[2]


def test_every_number_of_a_pose_has_its_unit_and_every_parameter_a_lock():
    """Most have charts of several photos, where size and camera are searched for."""
    session = make_set_session(free_scale=True)
    free = {"free_focal": True, "free_principal_point": True}
    session = after(session, c.alter_settings(lambda now: replace(now, **free)))
    names = [short_name(name) for name in session.document.chart.names]
    assert names[-4:] == ["log focal", "principal x", "principal y", "log size"]
    guarded = serve("127.0.0.1", 0)
    try:
        gui = guarded.server.gui
        controls = Controls(gui, lambda _: 0, session)
        for add_controls in STEPS.values():
            add_controls(controls)
        controls.show(session, 0)
        inputs = [one for one in gui._gui_input_handle_from_uuid.values() if one.visible]
        fields = [one.label for one in inputs if isinstance(one, viser.GuiNumberHandle)]
        locks = [one.label for one in inputs if isinstance(one, viser.GuiCheckboxHandle)]
    finally:
        guarded.stop()
    numbers = {f"{name} (unit)" for name in "XYZ"} | {f"turn {axis} (°)" for axis in "xyz"}
    assert numbers | {"size (x start)"} <= set(fields)
    assert all(text.endswith(")") for text in fields if text not in ("Max evaluations", "Seed"))
    assert set(names) <= set(locks)


def test_the_curve_goes_down_and_has_a_line_at_each_restart(comparison):
    for update in comparison.ends:
        evaluations, best, begun = curve_of(update)
        assert np.all(np.diff(evaluations) > 0.0)
        assert np.all(np.diff(best) <= 0.0)
        scale = update.progress.scale
        assert best[-1] == pytest.approx(scale.as_shown(update.progress.loss))
        restarts = [step.evaluations for step in update.restarts]
        assert list(evaluations[begun == 1.0]) == restarts
        assert len(restarts) > 0
        for step in update.improvements:
            shown = best[list(evaluations).index(step.evaluations)]
            assert shown == pytest.approx(scale.as_shown(step.loss))


def test_the_table_has_the_loss_of_each_end_by_each_method(comparison):
    table, said = ends_table(comparison).split("\n\n")
    cells = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()]
    assert cells[0] == ["", "Default", "Paper"]
    rows = {row[0]: row[1:] for row in cells}
    assert rows["Paper: loss (of 1)"] == [f"{loss:.3f}" for loss in comparison.losses[:, 1]]
    assert "Default: unexplained" in rows
    ours, paper = (end.progress for end in comparison.ends)
    assert rows["evaluations"] == [f"{fit.evaluations:,}" for fit in (ours, paper)]
    apart = pose_error(ours.problem.mesh, paper.pose, ours.pose)
    assert f"Paper ends {apart.reprojection_px:.1f} px from Default" in said


def test_both_ends_are_drawn_until_the_pose_is_another(scene, comparison):
    def drawn(session: Session) -> list[bool]:
        return [path_of(outline) in handles_of(session) for outline in comparison.outlines]

    session = c.compare_losses()(Session(open_files(scene.photo, scene.model, scene.start)))
    assert session.search is not None
    compared = c.search_advanced(session.search, comparison.ends[1], comparison)(session)
    assert drawn(compared) == [True, False]  # the one that is not at hand
    other = c.take_end(0)(compared)
    assert drawn(other) == [False, True]
    assert drawn(c.nudge("move", 1.0)(other)) == [False, False]
