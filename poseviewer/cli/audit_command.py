"""Search from every given pose of a BOP scene, a batch, a sequence, several photos or a table of
jobs, and list the poses that seem wrong: those from which the search moved farther than its pose is
uncertain, and those that the photo does not explain. The same command continues an audit that was
stopped; review shows it.
"""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.batch_command import BOP_SCENE, OUT, run_rows
from poseviewer.cli.terminal import GOES_ON

GIVEN = (
    "folder of a BOP scene or a batch's results, scene file of a sequence or of several photos, or "
    "table of jobs"
)
OPTIONS = {
    "": (table.option("jobs BOP_SCENE|BATCH|SCENE.json|JOBS.csv", GIVEN), *OUT),
    "BOP scene": BOP_SCENE,
    "comparison": table.COMPARED,
    "search": table.LIMITS,
}
EXAMPLES = (
    "poseviewer audit test/000002 --models models --out audit",
    "poseviewer audit results --out audit",
)
STOPPED = GOES_ON


def run(options: Namespace) -> int:
    """Write the pose found and a picture for each row, a table and a report."""
    return run_rows(options, is_audit=True)
