"""A shape seen by three cameras whose poses to one another are known: in memory, and as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.files.photo import save_image
from poseviewer.files.pose import PhotoReference, PoseRecord, save_pose, transform_as_json
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_set import View, ViewSet
from poseviewer.render.software.renderer import SoftwareRenderer
from tests.meshes import make_bumpy
from tests.several import coloured, save_model

CAMERA = Perspective(600.0, 600.0, 160.5, 120.5, 320, 240)
MESH = coloured(make_bumpy(3), (1.0, 0.8, 0.6))
NAMES = ("a.png", "b.png", "c.png")
DISTANCE = 12.0
SET_FROM_MODEL = RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [3.0, -1.0, 2.0])
OFF = np.array([0.15, -0.15, 0.12, 0.1, -0.08, 0.06])
"""Of the start: 14 degrees, an eighth of the radius, 6 % of the distance."""


def camera_from_set(turn_deg: float, tilt_deg: float, aside: float) -> RigidTransform:
    """Of a camera that looks past the model's centre, in the set's frame, from these angles."""
    turn = RigidTransform.from_rotation_vector([0.0, np.radians(turn_deg), 0.0], np.zeros(3))
    tilt = RigidTransform.from_rotation_vector([np.radians(tilt_deg), 0.0, 0.0], np.zeros(3))
    rotation = tilt.rotation @ turn.rotation
    centre = SET_FROM_MODEL.apply(MESH.centre)
    return RigidTransform(rotation, np.array([aside, 0.0, DISTANCE]) - rotation @ centre)


CAMERAS_FROM_SET = (
    camera_from_set(0.0, 0.0, 0.1),
    camera_from_set(35.0, -10.0, -0.15),
    camera_from_set(-30.0, 25.0, 0.0),
)
TRUTH = tuple(Pose(CAMERA, place @ SET_FROM_MODEL) for place in CAMERAS_FROM_SET)
START = FreeBodyChart.near(MESH, TRUTH[0]).to_pose(OFF)


def make_pixels(index: int, light: tuple[float, float, float]) -> NDArray[np.uint8]:
    """A photo of the shape on a dark ground with a blob beside it; smoothed and noisy."""
    pose = TRUTH[index].scaled(3.0)
    image = SoftwareRenderer(MESH).render(pose)
    shade = np.clip(0.5 + 0.45 * image.normals @ np.array(light), 0.03, 1.0)
    lit = np.full((*image.mask.shape, 3), 0.08)
    cv2.circle(lit, (200 + 250 * index, 120), 60, (0.5, 0.3, 0.4), -1)
    lit = np.where(image.mask[..., None], image.reflectance * shade[..., None], lit)
    small = cv2.resize(lit, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA)
    noisy = small + np.random.default_rng(index).normal(0.0, 0.01, small.shape)
    return np.rint(np.clip(noisy, 0.0, 1.0) * 255.0).astype(np.uint8)


LIGHTS = ((0.4, -0.7, -0.6), (-0.5, -0.5, -0.7), (0.1, -0.9, -0.4))
"""Unit: each photo has its own."""


def make_views(unit: float = 1.0, scale: float | None = 1.0) -> ViewSet:
    """The set in memory; its lengths are ``unit`` of the model's."""
    views = []
    for index, place in enumerate(CAMERAS_FROM_SET):
        pixels = make_pixels(index, LIGHTS[index])
        photo = Photo(pixels, NAMES[index], f"{index}" * 64, camera=CAMERA)
        moved = RigidTransform(place.rotation, place.translation / unit)
        views.append(View(NAMES[index], photo, moved))
    return ViewSet("set", tuple(views), None, scale)


def write_views(folder: Path) -> tuple[Path, Path, Path]:
    """Photos, model, start and our own set file; returns the set's, the model's and the start's."""
    entries: list[dict[str, Any]] = []
    for index, place in enumerate(CAMERAS_FROM_SET):
        save_image(folder / NAMES[index], make_pixels(index, LIGHTS[index]))
        camera = {"fx": 600.0, "fy": 600.0, "cx": 160.0, "cy": 120.0}
        view = {"photo": NAMES[index], "camera": camera}
        entries.append({**view, "camera_from_set": transform_as_json(place)})
    data = {"format": "poseviewer-views", "version": 1, "views": entries}
    (folder / "set.json").write_text(json.dumps(data))
    save_model(folder / "m.ply", MESH)
    save_pose(folder / "start.json", PoseRecord(START, PhotoReference(NAMES[0], 320, 240)))
    return folder / "set.json", folder / "m.ply", folder / "start.json"
