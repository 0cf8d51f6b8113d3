"""Parts set onto the skin: mirrors, handles, plates, wipers, spoiler, arch liners, wheels."""

from __future__ import annotations

import body_surface as body
import numpy as np
import wheels
from shell import Shell, join
from solids import moved, rounded_block, shade, sheet, slab, turn, turned

RIM_FACE_Y = 0.858  # outer face plane of the rims
Part = tuple[str, Shell, str]  # name, shape, material


def _skin_y(x: float, z: float) -> float:
    """Y of the left skin at a side-view position."""
    hit = body.cast(np.array([[x, 0.0, z]]), np.array([[0.0, 1.0, 0.0]]))
    return float(hit[0, 1])


def mirror() -> list[Part]:
    """Left door mirror: painted cap, dark foot, glass facing back."""
    block = rounded_block((0.15, 0.225, 0.145), 3.2, 12)
    v = block.vertices.copy()
    v[:, 0] *= np.where(v[:, 0] > 0, 1.0, 0.55)  # flat towards the back
    v[:, 2] *= 1 - 0.22 * (v[:, 1] / 0.11)  # lower towards its tip
    v[:, 0] -= 0.20 * np.maximum(v[:, 1] + 0.11, 0) ** 1.2
    cap = moved(shade(v, block.faces, 50), np.eye(3), (0.60, 0.945, 1.005))
    glass = rounded_block((0.012, 0.185, 0.112), 4.0, 6)
    glass = moved(glass, turn("z", 14), (0.543, 0.945, 1.005))
    foot = moved(rounded_block((0.085, 0.16, 0.035), 4.0, 6), turn("x", 22), (0.615, 0.83, 0.945))
    return [
        ("mirror cap", cap, "paint"),
        ("mirror glass", glass, "mirror"),
        ("mirror foot", foot, "trim"),
    ]


def handle(x: float, z: float) -> list[Part]:
    """Door handle with a dark hollow behind it."""
    y = _skin_y(x, z)
    bar = rounded_block((0.185, 0.026, 0.030), 3.5, 8)
    v = bar.vertices.copy()
    v[:, 1] -= 1.3 * v[:, 0] ** 2  # bowed, so its ends meet the door
    bar = moved(shade(v, bar.faces, 50), turn("x", -6), (x, y + 0.020, z))
    cup = moved(
        rounded_block((0.12, 0.006, 0.050), 3.0, 6), turn("x", -6), (x + 0.005, y, z - 0.006)
    )
    return [("handle", bar, "paint"), ("handle hollow", cup, "trim")]


def plate(front: bool) -> list[Part]:
    """Number plate in its dark frame, with made-up dark characters drawn as bars."""
    tilt, x, z = (4.0, 1.996, 0.497) if front else (7.0, -1.984, 0.705)
    out: list[Part] = []
    end = "front" if front else "rear"
    frame = rounded_block((0.014, 0.545, 0.132), 14, 6)
    face = rounded_block((0.010, 0.520, 0.108), 14, 6)
    turn_it = turn("y", -tilt) if front else turn("z", 180) @ turn("y", -tilt)
    out.append((f"plate frame {end}", moved(frame, turn_it, (x, 0, z)), "trim"))
    ahead = turn_it @ np.array([0.005, 0, 0])
    shift = (x + ahead[0], ahead[1], z + ahead[2])
    out.append((f"number plate {end}", moved(face, turn_it, shift), "plate"))
    signs = []
    for i, glyph in enumerate(("71", "47", "17", "", "742", "124", "711")):
        for k, stroke in enumerate(glyph):  # seven-segment-like strokes, no real number
            wide = stroke in "14"
            bar = rounded_block((0.004, 0.009 if wide else 0.036, 0.066 if wide else 0.010), 12, 4)
            y = 0.205 - 0.068 * i - 0.013 * (k - 1)
            dz = {"1": 0.0, "4": 0.0, "7": 0.028, "2": -0.028}[stroke]
            at = turn_it @ np.array([0.0095, y, dz])
            signs.append(moved(bar, turn_it, (x + at[0], at[1], z + at[2])))
    out.append((f"plate characters {end}", join(signs), "trim"))
    return out


def wipers() -> list[Part]:
    """Two wiper blades lying on the foot of the windscreen."""
    out = []
    for start, end in ((-0.56, 0.02), (0.0, 0.55)):
        y = np.linspace(start, end, 14)
        height = 0.945 + 0.055 * np.linspace(0, 1, 14) ** 0.8 - 0.02 * (y / 0.6) ** 2
        flat = body.cast(np.stack([0 * y + 0.3, y, height], 1), np.tile([1.0, 0, 0], (14, 1)))
        n = body.normals(flat)
        up = np.cross(n, np.gradient(flat, axis=0))
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        grid = [
            flat + 0.012 * up + 0.004 * n,
            flat + 0.006 * up + 0.020 * n,
            flat - 0.006 * up + 0.020 * n,
            flat - 0.012 * up + 0.004 * n,
        ]
        out.append(sheet(np.stack(grid[::-1])))
    return [("wipers", join(out), "trim")]


def spoiler() -> list[Part]:
    """Roof-end spoiler: a thin wing that carries the roof line past the hatch glass."""
    y = np.linspace(-0.575, 0.575, 33)
    s = np.linspace(0, 1, 8)
    bow = 0.10 * y**2 + 0.20 * y**4
    yy, ss = np.meshgrid(y, s, indexing="ij")
    start, reach = -1.42, 0.275
    x = start - reach * ss + bow[:, None] * ss
    z = body.ROOF(x) - 0.085 * yy**2 - 0.10 * yy**4 - 0.010 + 0.018 * ss
    z -= 0.06 * (np.abs(yy) / 0.575) ** 8
    top = np.stack([x, yy, z], 2)
    thick = 0.012 + 0.030 * np.sin(np.pi * np.clip(ss, 0, 0.9)) ** 1
    bottom = top - np.stack([0 * x, 0 * x, thick], 2)
    return [("spoiler", slab(top, bottom), "paint")]


def aerial() -> list[Part]:
    """Shark-fin aerial on the roof."""
    block = rounded_block((0.15, 0.042, 0.11), 2.2, 10)
    v = block.vertices.copy()
    v[:, 0] -= 0.55 * np.maximum(v[:, 2], 0)
    x = -1.28
    return [
        (
            "aerial",
            moved(shade(v, block.faces, 50), np.eye(3), (x, 0, float(body.ROOF(x)) - 0.012)),
            "trim",
        )
    ]


def badges() -> list[Part]:
    """Plain round badges, of no maker."""
    disc = turned(
        np.array([(0.001, 0.006), (0.026, 0.006), (0.030, 0.010), (0.036, 0.010), (0.040, 0.0)])[
            ::-1
        ],
        40,
    )
    to_front = turn("z", -90)
    out = []
    for name, rotation, origin, way in (
        ("badge front", turn("y", -18) @ to_front, (0.0, 0.0, 0.690), 1.0),
        ("badge rear", turn("z", 180) @ turn("y", -18) @ to_front, (0.0, 0.0, 0.925), -1.0),
    ):
        hit = body.cast(np.array([origin]), np.array([[way, 0.0, 0.0]]))[0]
        out.append((name, moved(disc, rotation, (hit[0] - way * 0.002, 0.0, hit[2])), "chrome"))
    return out


def liner(axle_x: float) -> Shell:
    """Dark inside of a left wheel arch: a strip from the skin inwards and an end wall."""
    t = np.linspace(np.radians(-26), np.radians(206), 61)
    x = axle_x + body.ARCH_RADIUS * np.cos(t)
    z = body.WHEEL_Z + body.ARCH_RADIUS * np.sin(t)
    outer = np.array([_skin_y(a, max(b, 0.2)) for a, b in zip(x, z, strict=True)])
    rows = [np.stack([x, y, z], 1) for y in (outer, outer - 0.03, 0 * x + 0.58)]
    strip = sheet(np.stack(rows))
    centre = np.tile([axle_x, 0.58, 0.30], (61, 1))
    wall = sheet(np.stack([rows[-1], centre]))
    return join([strip, wall])


def wheel_parts() -> list[Part]:
    """All four wheels, named `wheel FL tyre` and so on; right wheels are mirror images."""
    kinds = (
        ("tyre", wheels.tyre(), "rubber"),
        ("rim", wheels.rim(), "rim"),
        ("barrel", wheels.inner(), "dark metal"),
        ("brake", wheels.brake(), "dark metal"),
    )
    out = []
    for end, x, spin in (("F", body.FRONT_AXLE_X, 17.0), ("R", body.REAR_AXLE_X, -8.0)):
        for kind, shape, material in kinds:
            left = moved(shape, turn("y", spin), (x, RIM_FACE_Y, body.WHEEL_Z))
            out.append((f"wheel {end}L {kind}", left, material))
            out.append((f"wheel {end}R {kind}", left.mirrored(), material))
    return out


def paired_parts() -> list[Part]:
    """Parts of the left side that have a mirror image on the right."""
    out = mirror()
    for door, x, z in (("front", -0.185, 0.835), ("rear", -0.945, 0.855)):
        out += [(f"{name} {door}", shape, material) for name, shape, material in handle(x, z)]
    out.append(("arch liner front", liner(body.FRONT_AXLE_X), "plastic"))
    out.append(("arch liner rear", liner(body.REAR_AXLE_X), "plastic"))
    return out


def central_parts() -> list[Part]:
    """Parts on the middle line."""
    pipe = turned(
        np.array([(0.026, -0.10), (0.026, 0.0), (0.029, 0.004), (0.033, 0.0), (0.033, -0.10)])[
            ::-1
        ],
        32,
    )
    exhaust = moved(pipe, turn("z", 90), (-1.935, -0.42, 0.235))
    return [
        *plate(True),
        *plate(False),
        *wipers(),
        *spoiler(),
        *aerial(),
        *badges(),
        ("exhaust", exhaust, "chrome"),
    ]
