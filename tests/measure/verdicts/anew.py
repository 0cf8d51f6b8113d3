"""The evidence at the ends of earlier trials, gathered again: without fitting again."""

from __future__ import annotations

import csv
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import numpy as np

from poseviewer.confidence.features import gather_features
from poseviewer.confidence.model import judge
from poseviewer.errors import SettingsError
from poseviewer.files.writing import write_whole
from poseviewer.fit.problem import make_problem
from poseviewer.fit.settings import FitSettings
from poseviewer.study.real_cases import load_cases, load_starts
from poseviewer.study.trials import RealTask, features_as_text


def gather_anew(table: Path, folder: Path, tell: Callable[[str], object]) -> Path:
    """A table like that of a ``study --real FOLDER``, with fresh evidence; its path.

    It is written beside the old one as soon as all rows are done.

    Raises:
        SettingsError: the table cannot be read, or is not one of real trials.
        PoseFileError: the folder does not hold its cases.
    """
    try:
        with table.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        wanted = [(row["case"], int(row["degrees"]), int(row["draw"])) for row in rows]
    except (OSError, KeyError, ValueError) as error:
        raise SettingsError(
            f"{table}: is not a table of study --real ({error}); name one of its trials.csv"
        ) from None
    cases = {case.name: case for case in load_cases(folder)}
    degrees, draws = {found[1] for found in wanted}, max((found[2] for found in wanted), default=0)
    starts = {
        (start.case, start.degrees, start.draw): start
        for start in load_starts(folder, sorted(degrees), draws + 1)
    }
    for index, (row, key) in enumerate(zip(rows, wanted, strict=True), 1):
        if not row["end"]:
            continue
        settings = FitSettings(row["method"], "free-body", pixels=row["pixels"])  # type: ignore[arg-type]
        _gather_row(row, RealTask(cases[key[0]], starts[key], settings))
        tell(f"{index} of {len(rows)}: {row['case']}, {row['verdict']}\n")
    return _save(table.with_name(f"{table.stem}-anew.csv"), rows)


def _gather_row(row: dict[str, str], task: RealTask) -> None:
    registration, renderer = task.open()
    problem, _ = make_problem(registration, task.settings)
    pose = problem.chart.to_pose(np.array(row["end"].split(), float))
    features = gather_features(problem, registration.mesh, renderer, pose)
    row["evidence"], row["verdict"] = features_as_text(features), judge(features).word


def _save(path: Path, rows: list[dict[str, str]]) -> Path:
    text = StringIO()
    table = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue().encode(), SettingsError)
    return path
