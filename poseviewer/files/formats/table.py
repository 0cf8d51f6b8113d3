"""The formats: what each is called, how it counts, and who writes and reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from poseviewer.files.formats.blender_script import write_blender
from poseviewer.files.formats.bop_scene import read_bop, write_bop
from poseviewer.files.formats.colmap_model import read_colmap, write_colmap
from poseviewer.files.formats.gltf_camera import read_gltf
from poseviewer.files.formats.gltf_file import write_gltf
from poseviewer.files.formats.lens_models import (
    held_by_colmap,
    held_by_nerfstudio,
    held_by_none,
    held_by_opencv,
    held_whole,
)
from poseviewer.files.formats.matrices_file import read_matrices, write_matrices
from poseviewer.files.formats.meshlab_project import read_meshlab, write_meshlab
from poseviewer.files.formats.nerfstudio_file import read_nerfstudio, write_nerfstudio
from poseviewer.files.formats.opencv_file import read_opencv, write_opencv
from poseviewer.files.formats.own_file import read_own, write_own
from poseviewer.files.formats.request import Request, Written
from poseviewer.files.pose.file import PoseRecord


@dataclass(frozen=True, slots=True)
class Format:
    """One format, in the words of the documentation's table."""

    out: str
    """What OUT is."""
    pose: str
    """What is said of the pose."""
    camera_axes: str
    unit: str
    pixel_centre: str
    """Where the centre of the upper left pixel is."""
    parallel: bool
    """Whether it can say parallel projection."""
    lens: str
    """Which lens models it has."""
    held: Callable[[PoseRecord], str | None]
    """What the format calls the lens of a pose's photo; None where it cannot say it."""
    write: Callable[[PoseRecord, Path, Request], Written]
    read: Callable[[Path, Request], PoseRecord] | None


DOWN, UP = "x right, y down, z forward", "x right, y up, z backward"
MODEL_UNIT = "the model's"
INTEGERS, HALVES = "(0, 0)", "(0.5, 0.5)"
BOTH, NONE = "all, in words of our own", "none"

FORMATS = {
    "poseviewer": Format(
        "`.json`",
        "camera from model",
        DOWN,
        MODEL_UNIT,
        INTEGERS,
        True,
        BOTH,
        held_whole,
        write_own,
        read_own,
    ),
    "opencv": Format(
        "`.yml`, `.yaml` or `.json`",
        "camera from model: `rvec`, `tvec`",
        DOWN,
        MODEL_UNIT,
        INTEGERS,
        False,
        "all of OpenCV's",
        held_by_opencv,
        write_opencv,
        read_opencv,
    ),
    "matrices": Format(
        "`.json`",
        "both ways, 4x4, row-major",
        f"both: {DOWN}; {UP}",
        MODEL_UNIT,
        INTEGERS,
        True,
        BOTH,
        held_whole,
        write_matrices,
        read_matrices,
    ),
    "bop": Format(
        "a scene's folder",
        "camera from model",
        DOWN,
        "mm",
        INTEGERS,
        False,
        NONE,
        held_by_none,
        write_bop,
        read_bop,
    ),
    "colmap": Format(
        "a folder",
        "camera from world: quaternion, w first",
        DOWN,
        MODEL_UNIT,
        HALVES,
        False,
        "`OPENCV`, `FULL_OPENCV`, `OPENCV_FISHEYE`",
        held_by_colmap,
        write_colmap,
        read_colmap,
    ),
    "nerfstudio": Format(
        "`transforms.json`",
        "world from camera, 4x4, row-major",
        UP,
        MODEL_UNIT,
        HALVES,
        False,
        "`OPENCV` (k1 k2 k3 p1 p2), `OPENCV_FISHEYE`",
        held_by_nerfstudio,
        write_nerfstudio,
        read_nerfstudio,
    ),
    "gltf": Format(
        "`.glb`",
        "world from camera, 4x4, column-major",
        UP,
        "m",
        "none: a field of view",
        True,
        NONE,
        held_by_none,
        write_gltf,
        read_gltf,
    ),
    "blender": Format(
        "`.py`",
        "world from camera, 4x4, row-major",
        UP,
        MODEL_UNIT,
        "none: lens and shift",
        True,
        NONE,
        held_by_none,
        write_blender,
        None,
    ),
    "meshlab": Format(
        "`.mlp`",
        "rotation of camera from world, and minus the camera's place",
        UP,
        MODEL_UNIT,
        "(0.5, height - 0.5), y up",
        False,
        NONE,
        held_by_none,
        write_meshlab,
        read_meshlab,
    ),
}

HEADINGS = (
    "format", "OUT", "pose", "camera axes", "handed", "unit", "centre of the upper left pixel",
    "parallel", "lens", "read",
)  # fmt: skip


def formats_as_markdown() -> str:
    """The documentation's table."""
    rows = [HEADINGS, ("---",) * len(HEADINGS)]
    for name, known in FORMATS.items():
        rows.append(
            (
                f"`{name}`",
                known.out,
                known.pose,
                known.camera_axes,
                "right",
                known.unit,
                known.pixel_centre,
                "yes" if known.parallel else "no",
                known.lens,
                "yes" if known.read else "no",
            )
        )
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)
