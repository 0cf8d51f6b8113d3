"""Fits from starts that are far off: how many end right, and how many are wrongly called found.

``python -m tests.measure.far_starts OUT.csv [FOLDER ...]``. Each photo with a known pose is fitted
from poses turned by 15, 45, 60 and 90 degrees about a random axis, from one shifted by half the
object's size, and from a model that nobody placed, in the photo's middle; each by the model's own
colours and by the bare model. Starts follow from the case's name. Rows that OUT.csv has are not
fitted again, so that a run goes on where it stopped. ``--judge TABLE`` judges the ends of another
table anew, as the verdict is now, and fits nothing.
"""

import argparse
import hashlib
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from assets.source.data_folder import DATA
from poseviewer.api import make_registration
from poseviewer.errors import PoseViewerError
from poseviewer.evaluation.cases import Case, load_cases
from poseviewer.evaluation.trials import fetch_photo
from poseviewer.files.scene_assets import load_model
from poseviewer.files.table import append_row, load_rows
from poseviewer.fit.judge import judge_end
from poseviewer.fit.occlusion import find_occluded
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.processes import run_in_processes
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import processors
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import View, scene_at
from poseviewer.starts.sides import look_from
from tests.measure.real import is_tuning

TURNS_DEG = 15, 45, 60, 90
KINDS = (*(f"{turn} degrees" for turn in TURNS_DEG), "shifted by half", "unplaced")
SHIFT = 0.5
"""Length of the shift across the line of sight, by the model's diameter."""
WRONG_PERCENT = 2.0
"""Error beyond the truth's accuracy from which a pose is wrong, as in ``tests.measure.real``."""
MIN_SEEN = 0.5
"""Share of the model that a photo shows at least."""
MAX_SECONDS = 600.0


@dataclass(frozen=True, slots=True)
class FarTrial:
    """A fit from a start that is far off."""

    case: str
    set: str
    kind: str
    """One of ``KINDS``."""
    model: str
    """``own`` colours, or ``bare``."""
    accuracy_percent: float
    """That of the truth."""
    error_percent_start: float
    error_percent_end: float
    """Mean distance of the vertices in the photo, by the object's size there."""
    degrees: float
    verdict: str
    probability: float
    is_right: bool
    unexplained: float
    seconds: float
    evidence: str
    """Features of the verdict, as JSON."""
    deviations: str
    """Standard deviations of the pose, as JSON."""
    reasons: str
    end: str
    """Pose at the end, camera from model, 3 rows of 4 with blanks between."""

    @property
    def evidence_by_name(self) -> dict[str, float]:
        """The verdict's features; none where the model is not visible."""
        return json.loads(self.evidence)

    @property
    def key(self) -> tuple[str, str, str]:
        """What tells it from the other trials."""
        return self.case, self.kind, self.model


@dataclass(frozen=True)
class FarTask:
    """A fit to make."""

    case: Case
    kind: str
    model: str

    @property
    def key(self) -> tuple[str, str, str]:
        """That of its trial."""
        return self.case.name, self.kind, self.model


def make_start(case: Case, model: ModelFile, kind: str) -> Pose:
    """Make the start of a kind, the same for a name each time."""
    digest = hashlib.sha256(f"{case.name} {kind}".encode()).digest()
    random = np.random.default_rng(int.from_bytes(digest[:8], "big"))
    truth, mesh = case.truth, model.mesh
    place = truth.camera_from_model
    if kind == "unplaced":
        return look_from("three-quarter", mesh, model.keypoints, truth.camera)
    if kind == "shifted by half":
        angle = random.uniform(0.0, 2.0 * math.pi)
        length = SHIFT * mesh.diameter
        shift = length * np.array([math.cos(angle), math.sin(angle), 0.0])
        return replace(
            truth, camera_from_model=RigidTransform(place.rotation, place.translation + shift)
        )
    axis = random.normal(size=3)
    axis *= math.radians(float(kind.split()[0])) / np.linalg.norm(axis)
    turn = RigidTransform.from_rotation_vector(axis, np.zeros(3)).rotation
    centre = place.apply(mesh.centre)
    rotation = turn @ place.rotation
    # As far off as the turn is large: the centre by a tenth of the diameter for 45 degrees.
    off = random.normal(size=3) * mesh.diameter * np.linalg.norm(axis) / 7.9 * [1.0, 1.0, 2.0]
    return replace(
        truth, camera_from_model=RigidTransform(rotation, centre + off - rotation @ mesh.centre)
    )


@lru_cache(maxsize=16)
def fetch(path: Path, model: str) -> tuple[ModelFile, Renderer]:
    """Load a model, with its colours or bare, and make its renderer, once."""
    file = load_model(path)
    if model == "bare":
        mesh = file.mesh
        bare = replace(
            mesh,
            colours=np.full_like(mesh.colours, 0.7),
            textures=(),
            face_texture=np.full_like(mesh.face_texture, -1),
            has_reflectance=False,
        )
        file = file.with_content(mesh=bare)
    return file, make_renderer(file.mesh)


def run(task: FarTask, threads: int = 1) -> FarTrial:
    """Fit, and compare the end with the truth."""
    case = task.case
    model, renderer = fetch(case.mesh, task.model)
    start = make_start(case, model, task.kind)
    view = View(PhotoFile.of(fetch_photo(case.photo)), start.camera)
    settings = FitSettings(limits=Limits(seconds=MAX_SECONDS))
    error = pose_error(model.mesh, start, case.truth, model.symmetry)
    known = (case.name, case.set, task.kind, task.model, case.accuracy_percent, error.percent)
    try:
        end = make_registration(scene_at(view, model, start, settings=settings), renderer, 0).fit(
            threads=threads
        )
    except PoseViewerError as failure:
        nothing = math.nan, math.nan, "", math.nan, False, math.nan, 0.0, "{}", "{}"
        return FarTrial(*known, *nothing, str(failure), "")
    error = pose_error(model.mesh, end.pose, case.truth, model.symmetry)
    verdict, progress = end.verdict, end.progress
    assert verdict is not None
    assert progress is not None
    sure = end.covariance
    return FarTrial(
        *known,
        error.percent,
        error.rotation_deg,
        verdict.label,
        verdict.probability,
        error.percent <= case.accuracy_percent + WRONG_PERCENT,
        end.unexplained,
        round(progress.seconds, 2),
        json.dumps({name: round(value, 4) for name, value in verdict.features.items()}),
        json.dumps({k: round(v, 6) for k, v in sure.deviations.items()} if sure else {}),
        " ".join(verdict.reasons),
        " ".join(
            f"{number:.9g}" for number in np.ravel(end.pose.camera_from_model.as_matrix()[:3])
        ),
    )


def judge(cases: Mapping[str, Case], trial: FarTrial) -> FarTrial:
    """Judge the end of a trial of one of the cases anew; its error and seconds stay."""
    case = cases[trial.case]
    model, renderer = fetch(case.mesh, trial.model)
    end = np.array(trial.end.split(), float).reshape(3, 4)
    pose = replace(case.truth, camera_from_model=RigidTransform(end[:, :3], end[:, 3]))
    view = View(PhotoFile.of(fetch_photo(case.photo)), pose.camera)
    problem = make_problem(scene_at(view, model, pose, settings=FitSettings()), 0)[0]
    hidden = find_occluded(problem.photo, renderer, pose)
    if hidden is not None:
        problem = replace(problem, views=(problem.views[0].without(hidden),))
    at = replace(FitProgress.at_start(problem), pose=pose, status=Status.CONVERGED)
    verdict = judge_end(at, renderer).verdict
    assert verdict is not None
    return replace(
        trial,
        verdict=verdict.label,
        probability=verdict.probability,
        evidence=json.dumps({name: round(value, 4) for name, value in verdict.features.items()}),
        reasons=" ".join(verdict.reasons),
    )


def summary(trials: Sequence[FarTrial]) -> str:
    """Lines of a table: by kind of start and model, numbers of fits and shares in per cent."""
    head = ("fits", "right %", "found %", "found", "wrong", "wrong %", "seconds")
    lines = [f"{'':28}" + "".join(f"{name:>10}" for name in head)]
    for model in ("own", "bare"):
        for kind in (*KINDS, "all"):
            some = [t for t in trials if t.model == model and kind in (t.kind, "all")]
            if not some:
                continue
            found = [t for t in some if t.verdict == "found"]
            wrong = sum(not t.is_right for t in found)
            cells = (
                f"{len(some)}",
                f"{100 * np.mean([t.is_right for t in some]):.0f}",
                f"{100 * len(found) / len(some):.0f}",
                f"{len(found)}",
                f"{wrong}",
                f"{100 * wrong / max(len(found), 1):.1f}",
                f"{np.median([t.seconds for t in some]):.1f}",
            )
            lines.append(f"{model + ', ' + kind:28}" + "".join(f"{cell:>10}" for cell in cells))
    return "\n".join(lines)


def tasks_of(options: argparse.Namespace) -> Iterator[FarTask]:
    """Yield what is to be fitted, the kinds of a case one after the other."""
    for folder in options.folders:
        for case in load_cases(folder, options.cases)[:: options.every]:
            if case.visible < MIN_SEEN:  # not where it is unknown
                continue
            if options.half and is_tuning(case.name) is not (options.half == "tuning"):
                continue
            for model in options.models.split(","):
                for kind in KINDS:
                    if options.kinds in kind:
                        yield FarTask(case, kind, model)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="table of trials")
    parser.add_argument("folders", type=Path, nargs="*", default=[DATA, DATA / "clutter"])
    parser.add_argument("--cases", default="", help="only those whose id matches")
    parser.add_argument("--kinds", default="", help="only kinds that contain this")
    parser.add_argument("--models", default="own,bare", help="own, bare (default: both)")
    parser.add_argument("--half", choices=("tuning", "other"), help="only this half of the cases")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only each N-th case")
    parser.add_argument("--judge", type=Path, metavar="TABLE", help="judge that table's ends anew")
    parser.add_argument("--processes", type=int, default=processors())
    options = parser.parse_args(arguments)
    done = load_rows(options.out, FarTrial) if options.out.exists() else []
    known = {trial.key for trial in done}
    count = options.processes
    if options.judge:
        cases = {case.name: case for folder in options.folders for case in load_cases(folder)}
        ends = [t for t in load_rows(options.judge, FarTrial) if t.end and t.key not in known]
        work = run_in_processes(partial(judge, cases), ends, count)
    else:
        tasks = [task for task in tasks_of(options) if task.key not in known]
        work = run_in_processes(run, tasks, count)
    for _, trial in work:
        if trial is not None:
            append_row(options.out, trial)
            done.append(trial)
            print(*astuple(trial)[:12], flush=True)
    print(summary(done))
    return 0


if __name__ == "__main__":
    sys.exit(main())
