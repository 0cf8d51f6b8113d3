"""Fit the rows of a table in several processes: batch.py TABLE.csv FOLDER.

The table has the columns photo, model and start. The same call goes on with a stopped batch.
"""

import sys

from poseviewer.batch.result_folder import worst_first
from poseviewer.batch.run import open_batch, run_batch, save_summaries
from poseviewer.scene.settings import FitSettings, Limits


def main() -> None:
    """Fit what is still to be done, and print the rows, the worst first."""
    table, folder = sys.argv[1:]
    batch = open_batch(table, folder, FitSettings(limits=Limits(seconds=60)))
    for result in run_batch(batch, batch.to_do(), processes=2):
        print("failed:" if result.failed else "fitted:", result.reason or result.pose)
    for row in worst_first(save_summaries(batch)):
        print(row.job.photo, row.result.verdict, row.result.unexplained)


if __name__ == "__main__":  # each process imports this file
    main()
