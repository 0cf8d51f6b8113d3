"""Batches of photos that differ in name alone, and fits of their rows."""

import shutil
from pathlib import Path

from poseviewer.batch.result_folder import Batch
from poseviewer.batch.run import save_summaries
from poseviewer.batch.run_row import run_row
from tests.scene import Scene


def write_table(scene: Scene, folder: Path, rows: int, more: str = "") -> Path:
    """Write photos and a table of ``rows`` rows, and some lines ``more``; returns the table."""
    lines = ["photo,model,start,box"]
    for number in range(rows):
        shutil.copy(scene.photo, folder / f"photo{number}.png")
        lines.append(f"photo{number}.png,{scene.model},{scene.start}")
    table = folder / "jobs.csv"
    table.write_text("\n".join(lines) + "\n" + more, encoding="utf-8")
    return table


def fit_all(batch: Batch) -> None:
    """Fit in this process: how jobs are handed out is tested without this."""
    for job in batch.to_do():
        run_row(job, batch)
    save_summaries(batch)
