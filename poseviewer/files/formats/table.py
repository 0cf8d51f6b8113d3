"""The formats: who writes and reads each, and what it can say.

What their files hold stands in the documentation's table (``assets/docs/formats.md``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.files.checks import Reading
from poseviewer.files.formats.blender import write_blender
from poseviewer.files.formats.bop import read_bop, write_bop
from poseviewer.files.formats.colmap import read_colmap, write_colmap
from poseviewer.files.formats.gltf import read_gltf, write_gltf
from poseviewer.files.formats.lens import LensName, colmap_lens, lens_held, nerfstudio_lens
from poseviewer.files.formats.matrices import read_matrices, write_matrices
from poseviewer.files.formats.meshlab import read_meshlab, write_meshlab
from poseviewer.files.formats.nerfstudio import read_nerfstudio, write_nerfstudio
from poseviewer.files.formats.opencv import read_opencv, write_opencv
from poseviewer.files.formats.request import Request, Written, refuse_existing, size_of
from poseviewer.files.pose import PhotoReference, PoseRecord, record_from_json, save_pose


@dataclass(frozen=True, slots=True)
class Format:
    """One format. Both functions raise PoseFileError where a file cannot be used or written, or
    the format cannot say the pose.
    """

    write: Callable[[PoseRecord, Path, Request], Written]
    """Pose, where to, and what else is known."""
    read: Callable[[Path, Request], PoseRecord] | None
    parallel: bool = False
    """Whether it can say parallel projection."""
    lens: LensName | None = None
    """What it calls the lens models that it has; None: it has none."""
    both_photos: bool = False
    """Whether it says of the photo as taken and the undistorted one what belongs to which."""

    def held(self, record: PoseRecord) -> str | None:
        """What it calls the lens of a pose's photo; None where there is none, or it has not that
        lens.
        """
        if self.both_photos:
            return None if record.undistortion is None else "both"
        return None if self.lens is None else lens_held(record, self.lens)


def write_own(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write a pose file of our own."""
    refuse_existing(request, out)
    save_pose(out, record)
    return Written((out,))


def read_own(path: Path, request: Request) -> PoseRecord:
    """Read a pose file, which often says the photo's size; if not, the request must."""
    reading = Reading(path)
    data = reading.load_object()
    photo = data.get("photo")
    photo = photo if isinstance(photo, dict) else {}
    width, height = size_of(reading, request, photo.get("width"), photo.get("height"))
    record = record_from_json(reading, data, width, height)
    known = record.photo or PhotoReference()
    return replace(record, photo=replace(known, width=width, height=height))


FORMATS = {
    "poseviewer": Format(write_own, read_own, parallel=True, both_photos=True),
    "opencv": Format(
        write_opencv,
        read_opencv,
        lens=lambda lens: {"opencv": "OpenCV", "fisheye": "OpenCV fisheye"}[lens.model],
    ),
    "matrices": Format(write_matrices, read_matrices, parallel=True, both_photos=True),
    "bop": Format(write_bop, read_bop),
    "colmap": Format(
        write_colmap, read_colmap, lens=lambda lens: (colmap_lens(lens) or (None,))[0]
    ),
    "nerfstudio": Format(
        write_nerfstudio, read_nerfstudio, lens=lambda lens: (nerfstudio_lens(lens) or (None,))[0]
    ),
    "gltf": Format(write_gltf, read_gltf, parallel=True),
    "blender": Format(write_blender, None, parallel=True),
    "meshlab": Format(write_meshlab, read_meshlab),
}
