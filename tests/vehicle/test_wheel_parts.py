from pathlib import Path

import numpy as np
import pytest
import trimesh

from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.mesh.parts import Part
from poseviewer.files.mesh.surface import as_mesh
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints
from poseviewer.vehicle.wheel_parts import find_wheels, is_wheel_name

# In metres; front is +x, left is +y, up is +z. Front left, front right, rear left, rear right.
CENTRES = np.array([[1.4, 0.7, 0.3], [1.4, -0.7, 0.3], [-1.3, 0.7, 0.3], [-1.3, -0.7, 0.3]])
WIDTH, RADIUS = 0.2, 0.3


def a_wheel(centre: np.ndarray) -> trimesh.Trimesh:
    wheel = trimesh.creation.cylinder(RADIUS, WIDTH, sections=32)
    wheel.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    wheel.apply_translation(centre)
    return wheel


def a_box(low: list[float], high: list[float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


BODY = {
    "shell": a_box([-2.2, -0.8, 0.3], [2.2, 0.8, 0.9]),
    "cabin": a_box([-1.6, -0.7, 0.9], [0.6, 0.7, 1.5]),
}
NUMBERED = ("Wheel1", "Wheel2", "Wheel3", "Wheel4")
STANDING = RigidTransform.identity()


def a_car(names, extra=None, move: RigidTransform = STANDING) -> Mesh:
    parts = [*(BODY | (extra or {})).items()]
    parts += [(name, a_wheel(centre)) for name, centre in zip(names, CENTRES, strict=True)]
    return as_mesh("car", [Part(n, move.apply(p.vertices), p.faces) for n, p in parts], [])


def assert_right(keypoints: VehicleKeypoints | None, move: RigidTransform = STANDING) -> None:
    for side, sign, front, rear in (("left", 1.0, 0, 2), ("right", -1.0, 1, 3)):
        found, outwards = getattr(keypoints, side), np.array([0.0, sign, 0.0])
        outer = move.apply(CENTRES[[front, rear]] + 0.5 * WIDTH * outwards)
        np.testing.assert_allclose([found.front_wheel, found.rear_wheel], outer, atol=0.01)
        np.testing.assert_allclose(found.axle, move.rotation @ outwards, atol=0.01)


@pytest.mark.parametrize(
    "names",
    [
        ("wheel FL", "wheel FR", "wheel RL", "wheel RR"),
        ("WheelFrontLeft", "WheelFrontRight", "WheelRearLeft", "WheelRearRight"),
        ("Rad_vorne_links", "Rad_vorne_rechts", "Rad_hinten_links", "Rad_hinten_rechts"),
        ("wheels", "wheels", "wheels", "wheels"),
    ],
)
def test_wheels_of_many_habits_of_naming_are_found(names) -> None:
    assert_right(find_wheels(a_car(names)))


@pytest.mark.parametrize("seed", range(5))
def test_wheels_are_found_however_the_model_lies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    move = RigidTransform.from_rotation_vector(rng.normal(size=3), rng.normal(size=3))
    assert_right(find_wheels(a_car(NUMBERED, move=move)), move)


def test_names_of_wheels_outweigh_the_roof_and_lamps_outweigh_names() -> None:
    turned = ("wheel RR", "wheel RL", "wheel FR", "wheel FL")
    assert find_wheels(a_car(turned)).left.front_wheel[0] < 0.0
    lamps = {
        "headlight glass": a_box([2.15, -0.6, 0.6], [2.25, 0.6, 0.7]),
        "rear view mirror": a_box([0.9, -0.1, 1.2], [1.0, 0.1, 1.3]),
    }
    assert_right(find_wheels(a_car(turned, lamps)))


def test_anything_but_four_wheels_is_no_car() -> None:
    six = {f"wheel {y}": a_wheel(np.array([0.0, y, 0.3])) for y in (0.7, -0.7)}
    assert find_wheels(a_car(NUMBERED, six)) is None
    for named in (0, 2, 3):
        assert find_wheels(a_car((*NUMBERED[:named], *"abcd"[named:]))) is None


def test_names() -> None:
    wheels = ("Mesh1 Component_2_1 Component_7_1 Wheel1 Model", "wheel FL_tire", "frontwheel",
              "Räder", "alloy_rim")  # fmt: skip
    others = ("steering_wheel", "wheelarch left", "wheel arch", "trim", "entire body", "Radkasten",
              "Ersatzrad", "")  # fmt: skip
    assert [name for name in wheels + others if is_wheel_name(name)] == [*wheels]


def test_wheels_of_the_bmw(shared_data: Path) -> None:
    """Its wheels are named the wrong way round: "wheel FL" is at the tail lamps' end."""
    keypoints = find_wheels(load_mesh(shared_data / "mesh_bmw_e34" / "car.glb"))
    np.testing.assert_allclose(keypoints.left.front_wheel, [-0.9, 0.338, -1.413], atol=0.015)
    np.testing.assert_allclose(keypoints.right.rear_wheel, [0.9, 0.338, 1.387], atol=0.015)
