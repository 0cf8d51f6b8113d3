"""A small vehicle in a file: a lump of many greys with wheels said to be at its sides."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.meshes import make_bumpy
from tests.several import save_model

LENGTHS = np.array([2.0, 0.8, 0.6])


def save_vehicle(folder: Path) -> Path:
    """Write model and key points; x is forward and z up."""
    mesh, path = make_bumpy(3), folder / "vehicle.ply"
    save_model(path, replace(mesh, vertices=mesh.vertices * LENGTHS))
    sides = {
        name: {
            "rear_wheel": [-1.2, 0.7 * out, -0.4],
            "front_wheel": [1.2, 0.7 * out, -0.4],
            "axle": [0.0, out, 0.0],
        }
        for name, out in (("left", 1.0), ("right", -1.0))
    }
    data = {"format": "poseviewer-keypoints", "version": 1, **sides}
    (folder / "vehicle.keypoints.json").write_text(json.dumps(data))
    return path
