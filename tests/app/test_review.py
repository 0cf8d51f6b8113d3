"""A review: each row of a batch is an ordinary document, and nothing of a person's is lost."""

import json
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.page.rows import row_text, rows_list
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state.edits import Edit, undo, update
from poseviewer.app.state.hiding import Stroke, paint
from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import prepare
from poseviewer.app.workers.opening import open_autosaved
from poseviewer.app.workers.saving import Autosaver
from poseviewer.app.workers.tasks import QueuedTask
from poseviewer.batch.run import open_batch
from poseviewer.errors import BatchError
from poseviewer.files.masks import masks_beside
from poseviewer.files.pose import load_pose
from poseviewer.files.state.session_file import load_autosave
from poseviewer.fit.progress import Status
from poseviewer.scene.settings import FitSettings, Limits
from tests.batches import fit_all, write_table
from tests.scene import make_scene

BRIEFLY = FitSettings(limits=Limits(10, 600.0), keep_start=True)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A batch of three rows, fitted a little, and one that failed for want of a photo."""
    folder = tmp_path_factory.mktemp("batch")
    scene = make_scene(folder)
    table = write_table(scene, folder, 3, f"gone.png,{scene.model},{scene.start}\n")
    fit_all(open_batch(table, folder / "out", BRIEFLY))
    return folder / "out"


class Review(Reviewer):
    """A review without its page: what is asked is done at once."""

    def __init__(self, out: Path) -> None:
        super().__init__(out)
        document = self.open_first()
        list(prepare(document.mesh))
        self.session = Session(document, saved=document)

    def do(self, *asked: Edit | QueuedTask) -> tuple[str, ...]:
        """Do what is asked, one after the other; gives the notes of the last one."""
        notes: tuple[str, ...] = ()
        for request in asked:
            if isinstance(request, Edit):
                self.session = update(self.session, request)
                continue
            result = request.run(self.session, self.queue.batch.folder, lambda *_: None)
            self.do(*result.edits)
            notes = result.notes
        return notes

    @property
    def at(self) -> int | None:
        return self.row_at(self.session.document)

    @property
    def words(self) -> list[str]:
        return [row.result.review for row in self.queue.rows]


@pytest.fixture
def out(results: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(results, tmp_path / "out"))


@pytest.fixture
def review(out: Path) -> Review:
    return Review(out)


def test_rows_are_opened_in_order_and_those_that_cannot_be_are_named(out: Path) -> None:
    first = Reviewer(out).open_first()
    assert "gone.png" in first.scene.notes[0]
    review = Review(out)
    assert review.at == 1
    review.do(review.step(1))
    assert review.at == 2
    review.do(review.open_row(3), review.step(-1))
    assert review.at == 2
    with pytest.raises(BatchError, match="last of 4 rows"):
        review.do(review.open_row(3), review.step(1))
    with pytest.raises(BatchError, match="gone"):
        review.do(review.open_row(0))
    assert review.at == 3


def test_verdicts_and_notes_are_kept(review: Review, out: Path) -> None:
    review.do(review.decide("accepted"))
    assert review.at == 2  # it goes on
    review.do(review.annotate(2, "blurred"), review.decide("rejected"))
    review.do(review.decide("accepted"), review.decide(""))  # the last one: there is no further row
    assert review.at == 3
    review.close()
    again = Review(out).queue
    said = {row.job.photo: (row.result.review, row.result.note) for row in again.rows}
    assert sorted(said.values()) == [("", ""), ("", ""), ("accepted", ""), ("rejected", "blurred")]
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "1 accepted and 1 rejected" in report


def test_a_changed_pose_is_kept_or_the_row_is_not_left(review: Review, out: Path) -> None:
    path = out / review.queue.rows[1].result.pose
    picture = out / review.queue.rows[1].result.picture
    fitted, drawn = path.read_bytes(), picture.read_bytes()
    review.do(nudge("move", 9.0))
    for leaving in (review.step(1), review.open_row(2), review.decide("rejected")):
        with pytest.raises(BatchError, match="pose is changed"):
            review.do(leaving)
    moved = review.session.document.pose.camera_from_model.translation
    review.do(review.decide("accepted"))
    assert review.at == 2
    assert review.words[1] == "mended"
    saved = json.loads(path.read_text())["camera_from_model"]["translation"]
    assert saved == pytest.approx(moved.tolist(), abs=1e-9)
    assert path.with_suffix(".fitted.json").read_bytes() == fitted
    assert picture.read_bytes() != drawn
    before = review.session.document
    review.do(undo())  # stays in the row
    assert review.session.document is before
    review.do(nudge("move", 9.0), review.decide("accepted", goes_on=False))
    assert review.at == 2
    assert not review.session.is_unsaved
    assert review.words[2] == "mended"
    review.do(review.open_row(1))
    assert review.session.document.pose.camera_from_model.translation == pytest.approx(moved)


def test_what_is_hidden_is_kept_with_the_row(review: Review, out: Path) -> None:
    points = np.array([[40.0, 60.0], [90.0, 60.0]])
    review.do(paint(Stroke("brush", points, 9.0, False)))
    mask = review.session.document.view.mask
    assert mask is not None
    review.do(review.decide("accepted"))
    path = out / review.queue.rows[1].result.pose
    saved, _, notes = masks_beside(path, load_pose(path, 160, 120), (160, 120))
    assert notes == ()
    assert saved is not None
    assert np.array_equal(saved.weights, mask.weights)
    review.do(review.open_row(1))
    assert review.session.document.view.mask is not None


def test_a_session_that_ended_in_a_row_comes_back_to_it(review: Review, tmp_path: Path) -> None:
    review.do(review.step(1), nudge("move", 9.0))
    Autosaver(tmp_path / "state").close(review.session)
    (path,) = (tmp_path / "state" / "sessions").iterdir()
    opened = open_autosaved(load_autosave(path))
    assert review.row_at(opened) == 2


def test_the_list_says_of_each_row_what_came_of_it(review: Review) -> None:
    review.do(review.decide("accepted"))
    content = rows_list(review.queue, review.at)
    assert "4 rows, 1 accepted, 0 rejected" in content
    assert content.count("data-report=") == 4
    assert content.count('class="pv-at"') == 1
    assert content.count("data:image/jpeg") == 3
    assert content.count(">failed</b>") == 1
    reasons = [row.result.reason for row in review.queue.rows if row.result.failed]
    assert reasons[0]
    assert f"<small>{reasons[0]}</small>" in unescape(content)
    row = review.queue.rows[2]
    assert "● pose changed" in row_text(row, unsaved=True)
    kept = replace(row.result, status=Status.KEPT.value, reasons="The start was kept: so it is.")
    assert "The start was kept" in row_text(replace(row, result=kept), unsaved=False)
    # The pose's loss is said once, by the page, about the pose at hand.
    assert "unexplained" not in row_text(row, unsaved=False)
    # What a person searches for is not given back.
    assert not review.session.document.settings.keep_start
