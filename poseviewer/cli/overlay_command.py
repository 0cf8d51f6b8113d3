"""Draw the model over the photo at a pose, over several photos, or all objects of a scene."""

from argparse import Namespace

from poseviewer.cli import options as table
from poseviewer.cli.case import load_named
from poseviewer.cli.terminal import require_writable, say
from poseviewer.errors import PhotoFileError

OPTIONS = {
    "": (
        *table.FILES,
        table.POSE,
        table.option("--out OVERLAY.png", "draw to this file", required=True, is_output=True),
        table.LOOK,
    ),
    **table.SCENE,
}
EXAMPLES = (
    "poseviewer overlay photo.jpg car.glb --pose pose.json --out overlay.png",
    "poseviewer overlay shelf.scene.json --out residual.png --look residual",
)


def run(options: Namespace) -> int:
    """Write the picture, or one for each photo."""
    require_writable(options.out, PhotoFileError)
    for path in load_named(options).draw(options.out, options.look):
        say(f"overlay: {path}")
    return 0
