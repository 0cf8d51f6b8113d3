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

FRONT_LEFT, FRONT_RIGHT, REAR_LEFT, REAR_RIGHT = range(4)
# In metres; front is +x, left is +y, up is +z.
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


def a_car(
    names: tuple[str, str, str, str],
    extra: dict[str, trimesh.Trimesh] | None = None,
    model_from_car: RigidTransform | None = None,
) -> Mesh:
    pieces = dict(BODY) | (extra or {})
    parts = [(name, piece) for name, piece in pieces.items()]
    parts += [(name, a_wheel(centre)) for name, centre in zip(names, CENTRES, strict=True)]
    move = model_from_car or RigidTransform.identity()
    return as_mesh("car", [Part(n, move.apply(p.vertices), p.faces) for n, p in parts], [])


def assert_right(keypoints: VehicleKeypoints | None, move: RigidTransform | None = None) -> None:
    assert keypoints is not None
    move = move or RigidTransform.identity()
    outer = move.apply(CENTRES + np.array([[0, s * WIDTH / 2, 0] for s in (1, -1, 1, -1)]))
    left, right = keypoints.left, keypoints.right
    np.testing.assert_allclose(left.front_wheel, outer[FRONT_LEFT], atol=0.01)
    np.testing.assert_allclose(left.rear_wheel, outer[REAR_LEFT], atol=0.01)
    np.testing.assert_allclose(right.front_wheel, outer[FRONT_RIGHT], atol=0.01)
    np.testing.assert_allclose(right.rear_wheel, outer[REAR_RIGHT], atol=0.01)
    np.testing.assert_allclose(left.axle, move.rotation @ [0, 1, 0], atol=0.01)
    np.testing.assert_allclose(right.axle, move.rotation @ [0, -1, 0], atol=0.01)


@pytest.mark.parametrize(
    "names",
    [
        ("wheel FL", "wheel FR", "wheel RL", "wheel RR"),
        ("WheelFrontLeft", "WheelFrontRight", "WheelRearLeft", "WheelRearRight"),
        ("Rad_vorne_links", "Rad_vorne_rechts", "Rad_hinten_links", "Rad_hinten_rechts"),
        ("wheels", "wheels", "wheels", "wheels"),
    ],
)
def test_wheels_of_many_habits_of_naming_are_found(names: tuple[str, str, str, str]) -> None:
    assert_right(find_wheels(a_car(names)))


@pytest.mark.parametrize("seed", range(5))
def test_wheels_are_found_however_the_model_lies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    move = RigidTransform.from_rotation_vector(rng.normal(size=3), rng.normal(size=3))
    car = a_car(("Wheel1", "Wheel2", "Wheel3", "Wheel4"), model_from_car=move)
    assert_right(find_wheels(car), move)


def test_names_of_wheels_outweigh_the_roof_and_lamps_outweigh_names() -> None:
    turned = ("wheel RR", "wheel RL", "wheel FR", "wheel FL")
    by_names = find_wheels(a_car(turned))
    assert by_names is not None
    assert by_names.left.front_wheel[0] < 0.0
    lamps = {
        "headlight glass": a_box([2.15, -0.6, 0.6], [2.25, 0.6, 0.7]),
        "rear view mirror": a_box([0.9, -0.1, 1.2], [1.0, 0.1, 1.3]),
    }
    assert_right(find_wheels(a_car(turned, lamps)))


def test_anything_but_four_wheels_is_no_car() -> None:
    six = {
        "wheel 5": a_wheel(np.array([0.0, 0.7, 0.3])),
        "wheel 6": a_wheel(np.array([0, -0.7, 0.3])),
    }
    names = ("Wheel1", "Wheel2", "Wheel3", "Wheel4")
    assert find_wheels(a_car(names, six)) is None
    assert find_wheels(a_car(("Wheel1", "Wheel2", "c", "d"))) is None
    assert find_wheels(a_car(("Wheel1", "Wheel2", "Wheel3", "d"))) is None
    assert find_wheels(a_car(("a", "b", "c", "d"))) is None


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Mesh1 Component_2_1 Component_7_1 Wheel1 Model", True),
        ("wheel FL_tire", True),
        ("frontwheel", True),
        ("Räder", True),
        ("alloy_rim", True),
        ("steering_wheel", False),
        ("wheelarch left", False),
        ("wheel arch", False),
        ("trim", False),
        ("entire body", False),
        ("Radkasten", False),
        ("Ersatzrad", False),
        ("", False),
    ],
)
def test_names(name: str, expected: bool) -> None:
    assert is_wheel_name(name) is expected


def test_wheels_of_the_bmw(shared_data: Path) -> None:
    """Its wheels are named the wrong way round: "wheel FL" is at the tail lamps' end."""
    keypoints = find_wheels(load_mesh(shared_data / "mesh_bmw_e34" / "car.glb"))
    assert keypoints is not None
    np.testing.assert_allclose(keypoints.left.front_wheel, [-0.9, 0.338, -1.413], atol=0.015)
    np.testing.assert_allclose(keypoints.right.rear_wheel, [0.9, 0.338, 1.387], atol=0.015)
