"""Lens distortion in other tools' words: the same polynomials under their own names.

OpenCV's order is k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty; the fisheye's is k1 k2 k3 k4.
COLMAP: https://github.com/colmap/colmap/blob/main/src/colmap/sensor/models.h. nerfstudio hands its
``k1 k2 k3 p1 p2`` (or the fisheye's ``k1 .. k4``) to OpenCV: its ``_undistort_image``.
"""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from poseviewer.files.formats.request import require_perspective
from poseviewer.files.pose.file import PoseRecord
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens

SAME = 1e-9
"""Relative: files round cameras in their last digit."""
MOST = 14


def seen_as_taken(record: PoseRecord, tool: str) -> tuple[Perspective, Lens | None]:
    """Camera (pixel centres at i + 0.5) and lens of the photo as taken; None for a pinhole.

    Raises:
        PoseFileError: the projection is parallel, which this tool's files cannot say.
    """
    camera = require_perspective(record, tool)
    if record.undistortion is None:
        return camera, None
    return record.undistortion.taken, record.undistortion.lens


def colmap_lens(lens: Lens | None) -> tuple[str, tuple[float, ...]] | None:
    """COLMAP's model, with two focal lengths, and its distortion parameters; None: it has none."""
    if lens is None:
        return "PINHOLE", ()
    if lens.model == "fisheye":
        return "OPENCV_FISHEYE", lens.coefficients
    k = _all(lens)
    if any(k[8:]):
        return None
    return ("FULL_OPENCV", k[:8]) if any(k[4:8]) else ("OPENCV", k[:4])


def nerfstudio_lens(lens: Lens | None) -> tuple[str, dict[str, float]] | None:
    """Nerfstudio's model and its parameters; None: it has none. Its fourth ``k`` is another."""
    if lens is not None and lens.model == "fisheye":
        return "OPENCV_FISHEYE", dict(zip(("k1", "k2", "k3", "k4"), lens.coefficients, strict=True))
    k = (0.0,) * MOST if lens is None else _all(lens)
    if any(k[5:]):
        return None
    named = {"k1": k[0], "k2": k[1], "p1": k[2], "p2": k[3]}
    return "OPENCV", named | ({"k3": k[4]} if k[4] else {})


def held_whole(record: PoseRecord) -> str | None:
    """For files that say of both photos, as taken and undistorted, what belongs to which."""
    return None if record.undistortion is None else "both"


def held_by_opencv(record: PoseRecord) -> str | None:
    """The lens model's name in OpenCV; None where its files cannot say camera and lens."""
    lens = _lens_of(record)
    return None if lens is None else {"opencv": "OpenCV", "fisheye": "OpenCV fisheye"}[lens.model]


def held_by_colmap(record: PoseRecord) -> str | None:
    """The lens model's name in COLMAP; None where its files cannot say camera and lens."""
    lens = _lens_of(record)
    found = None if lens is None else colmap_lens(lens)
    return None if found is None else found[0]


def held_by_nerfstudio(record: PoseRecord) -> str | None:
    """The lens model's name in nerfstudio; None where its files cannot say camera and lens."""
    lens = _lens_of(record)
    found = None if lens is None else nerfstudio_lens(lens)
    return None if found is None else found[0]


def held_by_none(record: PoseRecord) -> str | None:
    """For files of pinhole cameras alone."""
    del record


def _lens_of(record: PoseRecord) -> Lens | None:
    """The lens before the camera as taken; None where the pose has another camera than that of the
    undistorted photo (a focal length that was found): no lens model says that.
    """
    undistortion, camera = record.undistortion, record.pose.camera
    if undistortion is None or not isinstance(camera, Perspective):
        return None
    same = np.allclose(astuple(camera), astuple(undistortion.camera), rtol=SAME)
    return undistortion.lens if same else None


def _all(lens: Lens) -> tuple[float, ...]:
    return (*lens.coefficients, *(0.0,) * (MOST - len(lens.coefficients)))
