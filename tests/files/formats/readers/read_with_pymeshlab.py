"""MeshLab's reader: PROJECT.mlp OUT.json.

Writes the camera as MeshLab says it again, in the formats of two other tools, and the model's
vertices and the colours that MeshLab fetches for them from the photo; null where it has no
display to do so (it is aborted by Qt then, so a process of its own tries).
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pymeshlab  # pyright: ignore[reportMissingImports]

BUNDLER, AGISOFT = 0, 1
project, out = (Path(argument).resolve() for argument in sys.argv[1:3])
document = pymeshlab.MeshSet()
document.load_project(str(project))
if sys.argv[3:] == ["colours"]:
    document.compute_color_from_current_raster_projection(usedepth=False)
    mesh = document.current_mesh()
    answer = {
        "vertices": mesh.vertex_matrix().tolist(),
        "colours": np.rint(mesh.vertex_color_matrix()[:, :3] * 255).astype(int).tolist(),
    }
else:
    os.chdir(project.parent)  # MeshLab writes these where it stands
    for kind in (BUNDLER, AGISOFT):
        document.save_active_raster_cameras(exportfile=kind, newname="again")
    colours = out.with_name("colours.json")
    command = [sys.executable, __file__, str(project), str(colours), "colours"]
    done = subprocess.run(command, capture_output=True, check=False).returncode == 0
    answer = {
        "rasters": document.raster_number(),
        "bundler": Path("again.out").read_text(),
        "agisoft": Path("again.xml").read_text(),
        "seen": json.loads(colours.read_text()) if done else None,
    }
out.write_text(json.dumps(answer))
