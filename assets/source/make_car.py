"""Build the demo car and write `demo_car.glb` and `demo_car.keypoints.json`.

    python make_car.py [--out DIR]

Only numpy and trimesh are used; nothing is copied from any other model. The skin is an
implicit surface (`body_surface`), sampled on a ray grid (`shell`), cut along the outlines of
windows, lamps and panel gaps (`panels`); wheels and fittings are made apart. Metres, x forward,
y left, z up, origin on the ground under the car's centre.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path

import body_surface as body
import fittings
import numpy as np
import panels
import trimesh
from shell import Shell, half_body, join, rim_wall, split, weld
from trimesh.visual.material import PBRMaterial

# linear base colour (glTF's convention), metallic, roughness
MATERIALS: dict[str, tuple[tuple[float, float, float], float, float]] = {
    "paint": ((0.030, 0.120, 0.310), 0.0, 0.35),
    "plastic": ((0.028, 0.028, 0.030), 0.0, 0.7),
    "trim": ((0.016, 0.016, 0.018), 0.0, 0.4),
    "grille": ((0.012, 0.012, 0.013), 0.0, 0.6),
    "glass": ((0.020, 0.026, 0.030), 0.0, 0.08),
    "mirror": ((0.30, 0.33, 0.36), 0.6, 0.1),
    "lamp clear": ((0.36, 0.38, 0.40), 0.0, 0.15),
    "lamp bright": ((0.88, 0.88, 0.84), 0.0, 0.15),
    "lamp red": ((0.33, 0.010, 0.012), 0.0, 0.2),
    "lamp red bright": ((0.62, 0.030, 0.025), 0.0, 0.2),
    "chrome": ((0.62, 0.62, 0.63), 0.8, 0.2),
    "plate": ((0.80, 0.80, 0.77), 0.0, 0.5),
    "rubber": ((0.020, 0.020, 0.021), 0.0, 0.85),
    "rim": ((0.56, 0.57, 0.59), 0.7, 0.3),
    "dark metal": ((0.060, 0.060, 0.063), 0.5, 0.6),
}
# painted pieces between the gaps are named after the piece found at these (x, y, z)
PAINTED = {
    "door front": (0.2, 0.87, 0.6),
    "door rear": (-0.7, 0.87, 0.6),
    "wing front": (1.1, 0.86, 0.72),
    "bonnet": (1.4, 0.2, 0.85),
    "bumper front": (1.9, 0.5, 0.5),
    "bumper rear": (-1.95, 0.4, 0.5),
    "tailgate": (-1.96, 0.35, 0.68),
    "fuel flap": (-1.46, 0.86, 0.79),
    "body": (-0.3, 0.1, 1.46),
}
CENTRAL_PAINT = {"bonnet", "bumper front", "bumper rear", "tailgate", "body"}


def _pieces(shell: Shell) -> np.ndarray:
    """Label (m,) of each face's connected piece."""
    parent = np.arange(len(shell.vertices))
    while True:  # every vertex takes the least label among its faces' corners, until steady
        low = parent[shell.faces].min(axis=1)
        new = parent.copy()
        np.minimum.at(new, shell.faces.ravel(), np.repeat(low, 3))
        new = new[new]
        if (new == parent).all():
            return parent[shell.faces[:, 0]]
        parent = new


def _painted(shell: Shell) -> dict[str, Shell]:
    """The painted skin's pieces by name; pieces without a name go to `body`."""
    label = _pieces(shell)
    middle = shell.vertices[shell.faces].mean(axis=1)
    names = dict.fromkeys(np.unique(label).tolist(), "body")
    for name, place in PAINTED.items():
        names[int(label[np.argmin(((middle - place) ** 2).sum(1))])] = name
    face_name = np.array([names[int(v)] for v in label])
    return {str(name): shell.pick(face_name == name) for name in np.unique(face_name)}


def _both_sides(name: str, shell: Shell, central: bool, inset: float) -> list[tuple[str, Shell]]:
    """Mirror a piece of the left half; sink it if it is inset, with a wall around it."""
    if central:
        whole = [(name, weld(join([shell, shell.mirrored()])))]
    else:
        whole = [(f"{name} left", shell), (f"{name} right", shell.mirrored())]
    if not inset:
        return whole
    out = []
    for label, piece in whole:
        low = piece.moved(-inset)
        out += [(label, low), (f"{label} edge", rim_wall(piece, low))]
    return out


def skin_parts(stations: int = 103, around: int = 61) -> list[fittings.Part]:
    """All parts cut from the skin."""
    regions = panels.regions()
    half = half_body(stations, around)
    for region in regions:
        if region.spine is not None:
            half = split(half, region.spine, reach=0.12)
        half = split(half, region.field)
    middle = half.vertices[half.faces].mean(axis=1)
    owner = np.full(len(half.faces), -1)
    for i, region in enumerate(regions):
        owner[(owner < 0) & (region.field(middle) < 0)] = i
    out: list[fittings.Part] = []
    for name, piece in _painted(half.pick(owner == -1)).items():
        out += [(n, s, "paint") for n, s in _both_sides(name, piece, name in CENTRAL_PAINT, 0.0)]
    gaps = np.array([i for i, r in enumerate(regions) if r.name == "panel gaps"])
    out += [
        (n, s, "trim")
        for n, s in _both_sides("panel gaps", half.pick(np.isin(owner, gaps)), True, 0.0)
    ]
    for name in dict.fromkeys(r.name for r in regions):
        same = [i for i, r in enumerate(regions) if r.name == name]
        region, mine = regions[same[0]], np.isin(owner, same)
        if region.material == "none" or name == "panel gaps" or not mine.any():
            continue
        for n, s in _both_sides(name, half.pick(mine), region.central, region.inset):
            out.append((n, s, "trim" if n.endswith(" edge") else region.material))
    return out


def all_parts() -> list[fittings.Part]:
    """Every part of the car: (name, shape, material)."""
    out = skin_parts() + fittings.central_parts() + fittings.wheel_parts()
    for name, shape, material in fittings.paired_parts():
        out += [(f"{name} left", shape, material), (f"{name} right", shape.mirrored(), material)]
    return out


def keypoints() -> dict[str, object]:
    """Wheel points (centres on the rims' outer face plane) and outward axles, both sides."""
    out: dict[str, object] = {"format": "poseviewer-keypoints", "version": 1, "unit": "m"}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        y = sign * fittings.RIM_FACE_Y
        out[side] = {
            "rear_wheel": [body.REAR_AXLE_X, y, body.WHEEL_Z],
            "front_wheel": [body.FRONT_AXLE_X, y, body.WHEEL_Z],
            "axle": [0.0, sign, 0.0],
        }
    return out


def main() -> None:
    """Write the files and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent.parent)
    out = parser.parse_args().out
    materials = {
        name: PBRMaterial(
            name=name,
            baseColorFactor=[*(round(255 * c) for c in colour), 255],
            metallicFactor=metal,
            roughnessFactor=rough,
        )
        for name, (colour, metal, rough) in MATERIALS.items()
    }
    scene = trimesh.Scene()
    counts: dict[str, int] = defaultdict(int)
    everywhere = []
    for name, shape, material in all_parts():
        mesh = trimesh.Trimesh(
            shape.vertices, shape.faces, vertex_normals=shape.normals, process=False
        )
        mesh.visual = trimesh.visual.TextureVisuals(material=materials[material])
        scene.add_geometry(mesh, node_name=name, geom_name=name)
        counts[name.split()[0]] += len(shape.faces)
        everywhere.append(np.round(shape.vertices, 6))
    (out / "demo_car.glb").write_bytes(scene.export(file_type="glb", include_normals=True))
    (out / "demo_car.keypoints.json").write_text(json.dumps(keypoints(), indent=2) + "\n")
    merged = len(np.unique(np.vstack(everywhere), axis=0))
    print(
        f"{len(scene.geometry)} parts, {sum(counts.values())} triangles, {merged} merged vertices"
    )
    print(dict(counts))


if __name__ == "__main__":
    main()
