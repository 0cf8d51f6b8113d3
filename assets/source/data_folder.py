"""Folder of photos with known poses, models and films, which lies beside the clone, not in it."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("POSEVIEWER_DATA") or ROOT.parent / "shared" / "data")
