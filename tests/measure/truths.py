"""True poses of photos as a table of jobs, for an audit of exact poses.

``python -m tests.measure.truths FOLDER OUT`` writes ``OUT/jobs.csv`` and its pose files;
``poseviewer audit OUT/jobs.csv --out AUDIT`` then should list none.
"""

import argparse
import csv
from collections.abc import Sequence
from pathlib import Path

from poseviewer.batch.job_table import COLUMNS
from poseviewer.evaluation.cases import load_cases
from poseviewer.files.pose import PoseRecord, save_pose


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="holds cases.json")
    parser.add_argument("out", type=Path)
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "jobs.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for case in load_cases(options.folder):
            save_pose(options.out / f"{case.name}.json", PoseRecord.of(case.truth))
            table.writerow([case.photo.resolve(), case.mesh.resolve(), f"{case.name}.json"])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
