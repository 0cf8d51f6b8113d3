"""Poses of the demo: pose files, the vehicle chart's six numbers, and starts 8 % off.

    python poses.py            # remakes the two start files beside the true ones

Camera frame: x right, y down, z forward (OpenCV); pixel centres at integers; metres.
A pose takes model points to camera points, `p_camera = R p_model + t`.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ASSETS = HERE.parent
START_ERROR = 0.08
SEEDS = {"demo_photo.jpg": 11, "demo_photo_parallel.jpg": 5}


@dataclass(frozen=True)
class Pose:
    """A camera and the model's place in front of it; `camera` as in the pose file."""

    projection: str  # "perspective" or "parallel"
    camera: dict[str, float]
    rotation: np.ndarray
    translation: np.ndarray

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (n,2) of model points (n,3)."""
        p = points @ self.rotation.T + self.translation
        centre = np.array([self.camera["cx"], self.camera["cy"]])
        if self.projection == "parallel":
            return self.camera["scale"] * p[:, :2] + centre
        return np.array([self.camera["fx"], self.camera["fy"]]) * p[:, :2] / p[:, 2:] + centre


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def _frame(along: np.ndarray, axle: np.ndarray) -> np.ndarray:
    """Right-handed frame (columns) from the rear-to-front direction and the axle."""
    along, axle = _unit(along), _unit(axle)
    return np.stack([along, axle, np.cross(along, axle)], 1)


def to_chart(pose: Pose, wheels: dict[str, list[float]], size: tuple[int, int]) -> np.ndarray:
    """(mu_x, mu_y, delta_x, delta_y, psi_x, psi_y); lengths over the photo's width and height."""
    rear, front = pose.project(np.array([wheels["rear_wheel"], wheels["front_wheel"]]))
    psi = pose.rotation @ np.array(wheels["axle"])
    return np.concatenate([rear / size, (front - rear) / size, psi[:2]])


def from_chart(
    theta: np.ndarray, like: Pose, wheels: dict[str, list[float]], size: tuple[int, int]
) -> Pose:
    """The pose with these chart numbers; perspective: with the camera of `like`, known."""
    rear, delta = theta[:2] * size, theta[2:4] * size
    psi = np.array([*theta[4:], -np.sqrt(max(1 - theta[4] ** 2 - theta[5] ** 2, 0.0))])
    model_rear, model_front = np.array(wheels["rear_wheel"]), np.array(wheels["front_wheel"])
    base = float(np.linalg.norm(model_front - model_rear))
    cam = like.camera
    centre = np.array([cam["cx"], cam["cy"]])
    if like.projection == "parallel":
        along = np.array([*delta, -(psi[:2] @ delta) / psi[2]])
        scale = float(np.linalg.norm(along)) / base
        at_rear = np.array([*((rear - centre) / scale), 0.0])
        cam = {**cam, "scale": scale}
    else:
        focal = np.array([cam["fx"], cam["fy"]])
        r1, r2 = (np.array([*((p - centre) / focal), 1.0]) for p in (rear, rear + delta))
        ratio = (r1 @ psi) / (r2 @ psi)  # both wheels lie in one plane across the axle
        z1 = base / np.linalg.norm(ratio * r2 - r1)
        along, at_rear = ratio * r2 - r1, z1 * r1
    rotation = _frame(along, psi) @ _frame(model_front - model_rear, np.array(wheels["axle"])).T
    translation = at_rear - rotation @ model_rear
    if like.projection == "parallel":
        translation[2] = like.translation[2]  # depth is without effect: keep it
    return replace(like, camera=cam, rotation=rotation, translation=translation)


def fit_parallel(points: np.ndarray, pixels: np.ndarray, near: Pose, size: tuple[int, int]) -> Pose:
    """Scaled-orthographic pose that best (least squares) sends points to pixels.

    Gauss-Newton over rotation vector, scale and shift, begun at the perspective pose `near`.
    """
    centre = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    rotation = near.rotation
    depth = float(near.translation[2])
    scale = near.camera["fx"] / depth
    shift = near.translation[:2].copy()

    def pose(w: np.ndarray, s: float, t: np.ndarray) -> Pose:
        angle = float(np.linalg.norm(w))
        k = np.zeros(3) if angle < 1e-15 else w / angle
        cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        camera = {"scale": float(s), "cx": float(centre[0]), "cy": float(centre[1])}
        return Pose("parallel", camera, turn @ rotation, np.array([*t, depth]))

    for _ in range(12):

        def residual(q: np.ndarray, s: float = scale, t: np.ndarray = shift) -> np.ndarray:
            return (pose(q[:3], s * np.exp(q[3]), t + q[4:]).project(points) - pixels).ravel()

        zero = np.zeros(6)
        jacobian = np.stack([(residual(h) - residual(-h)) / 2e-5 for h in 1e-5 * np.eye(6)], 1)
        step = np.linalg.lstsq(jacobian, -residual(zero), rcond=None)[0]
        moved = pose(step[:3], scale * np.exp(step[3]), shift + step[4:])
        rotation, scale, shift = moved.rotation, moved.camera["scale"], shift + step[4:]
    return pose(np.zeros(3), scale, shift)


def write(
    path: Path, pose: Pose, photo: str, size: tuple[int, int], model: str = "demo_car.glb"
) -> None:
    """Write a pose file (JSON, version 1)."""
    digest = {
        name: hashlib.sha256((path.parent / name).read_bytes()).hexdigest()
        for name in (photo, model)
    }
    data = {
        "format": "poseviewer-pose",
        "version": 1,
        "photo": {"file": photo, "width": size[0], "height": size[1], "sha256": digest[photo]},
        "model": {"file": model, "sha256": digest[model], "unit": "m"},
        "projection": pose.projection,
        "camera": pose.camera,
        "camera_from_model": {
            "rotation": pose.rotation.tolist(),
            "translation": pose.translation.tolist(),
        },
    }
    path.write_text(json.dumps(data, indent=2) + "\n")


def read(path: Path) -> tuple[Pose, str, tuple[int, int]]:
    """Pose, photo file name and photo size of a pose file."""
    data = json.loads(path.read_text())
    place = data["camera_from_model"]
    pose = Pose(
        data["projection"],
        data["camera"],
        np.array(place["rotation"]),
        np.array(place["translation"]),
    )
    return pose, data["photo"]["file"], (data["photo"]["width"], data["photo"]["height"])


def visible_wheels(pose: Pose, keypoints: dict) -> dict[str, list[float]]:
    """The key points of the side that faces the camera."""
    depth = {
        side: float((pose.rotation @ np.array(keypoints[side]["axle"]))[2])
        for side in ("left", "right")
    }
    return keypoints[min(depth, key=lambda side: depth[side])]


def main() -> None:
    """Make the start files."""
    keypoints = json.loads((ASSETS / "demo_car.keypoints.json").read_text())
    for true in ("demo_pose_true.json", "demo_parallel_pose_true.json"):
        pose, photo, size = read(ASSETS / true)
        wheels = visible_wheels(pose, keypoints)
        theta = to_chart(pose, wheels, size)
        again = from_chart(theta, pose, wheels, size)
        closes = float(np.abs(again.rotation - pose.rotation).max())
        signs = np.random.default_rng(SEEDS[photo]).choice([-1.0, 1.0], 6)
        start = from_chart(theta * (1 + START_ERROR * signs), pose, wheels, size)
        write(ASSETS / true.replace("true", "start"), start, photo, size)
        turn = np.degrees(np.arccos((np.trace(start.rotation @ pose.rotation.T) - 1) / 2))
        print(f"{photo}: theta {np.round(theta, 4)}, chart closes to {closes:.1e}")
        print(f"  start turned by {turn:.1f} deg")


if __name__ == "__main__":
    main()
