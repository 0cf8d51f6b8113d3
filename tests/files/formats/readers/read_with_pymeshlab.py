"""MeshLab's reader: PROJECT.mlp OUT.json.

Writes the camera as MeshLab says it again, in the formats of two other tools.
"""

import json
import os
import sys
from pathlib import Path

import pymeshlab  # pyright: ignore[reportMissingImports]

BUNDLER, AGISOFT = 0, 1
project, out = (Path(argument).resolve() for argument in sys.argv[1:3])
document = pymeshlab.MeshSet()
document.load_project(str(project))
os.chdir(project.parent)  # MeshLab writes these where it stands
for kind in (BUNDLER, AGISOFT):
    document.save_active_raster_cameras(exportfile=kind, newname="again")
answer = {
    "rasters": document.raster_number(),
    "bundler": Path("again.out").read_text(),
    "agisoft": Path("again.xml").read_text(),
}
out.write_text(json.dumps(answer))
