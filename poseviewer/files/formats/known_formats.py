"""The formats by name; what their files hold stands in ``assets/docs/formats.md``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from msgspec import structs

from poseviewer.files.checks import Reading
from poseviewer.files.formats.bop import BOP
from poseviewer.files.formats.conversion import (
    ConvertOptions,
    Format,
    Written,
    refuse_existing,
    size_of,
)
from poseviewer.files.formats.gltf import GLTF, write_gltf_scene
from poseviewer.files.formats.meshlab import MESHLAB, write_meshlab_scene
from poseviewer.files.formats.opencv import OPENCV
from poseviewer.files.formats.reconstructions import COLMAP, NERFSTUDIO
from poseviewer.files.pose import PhotoReference, PoseRecord, record_from_json, save_pose


def write_own(record: PoseRecord, out: Path, request: ConvertOptions) -> Written:
    """Write a pose file of our own."""
    refuse_existing(request, out)
    save_pose(out, record)
    return Written((out,))


def read_own(path: Path, request: ConvertOptions) -> PoseRecord:
    """Read a pose file, which often says the photo's size; if not, the request must."""
    reading = Reading(path)
    data = reading.load_object()
    photo = data.get("photo")
    photo = photo if isinstance(photo, dict) else {}
    width, height = size_of(reading, request, photo.get("width"), photo.get("height"))
    record = record_from_json(reading, data, width, height)
    known = record.photo or PhotoReference()
    return replace(record, photo=structs.replace(known, width=width, height=height))


FORMATS = {
    "poseviewer": Format(write_own, read_own, both_photos=True),
    "opencv": OPENCV,
    "bop": BOP,
    "colmap": COLMAP,
    "nerfstudio": NERFSTUDIO,
    "gltf": GLTF,
    "meshlab": MESHLAB,
}
OF_SCENES = {"gltf": write_gltf_scene, "meshlab": write_meshlab_scene}
"""Those that one file holds all objects of a scene in."""
