"""``python -m blender FOLDER``: draw what ``job.json`` and ``arrays.npz`` there say."""

import sys
from pathlib import Path

from .drawing import draw

draw(Path(sys.argv[1]))
