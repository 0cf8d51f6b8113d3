"""Cameras by features: some pictures are reconstructed by COLMAP, the others are placed by the
points of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError, list_names
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Undistortion
from poseviewer.geometry.transform import RigidTransform, nearest_rotation
from poseviewer.still.pictures import (
    MIN_PICTURES,
    Grey,
    Pictures,
    Placed,
    Placement,
    Tell,
    resized,
)

if TYPE_CHECKING:
    import pycolmap

MAX_WHOLE = 60
"""Pictures of which all are reconstructed, each matched with each."""
CHOSEN = 40
"""Pictures, about, that are chosen of more to be reconstructed."""
MAX_STEP = 25
"""Largest step between chosen pictures: a second of a film, in which things stay in sight."""
NEIGHBOURS = 10
"""Chosen frames, before and after, that each is matched with."""
SPREAD = 20
"""Chosen frames, about, that are matched each with each: a film may come back."""
LONGEST_PX = 1600
"""Longer side at which features are looked for: finer ones seldom match."""
MAX_FEATURES = 4000
"""Features of a picture, the strongest: more take longer."""
CONTRAST = 0.02
"""Smallest contrast of a feature, COLMAP's own."""
FEW_FEATURES = 50
"""Features below which a picture shows no texture."""
PAIRS_AT_ONCE = 60
"""Pairs that are matched between two lines on how far that is."""
SEED = 1
RATIO = 0.8
"""Largest distance of the nearest descriptor, by that of the second (D. Lowe)."""
BESIDE = 4
"""Chosen pictures nearest in order, by whose points another is placed."""
MIN_INLIERS = 20
"""Points that place a picture at least."""
MISFIT = 0.93
"""Residual by a camera that is found, in that by the given one, from which this does not fit: by
right ones both are alike to 2 %."""
MAX_ERROR_PX = 4.0
"""Residual of an inlier at most, px at ``LONGEST_PX``."""
INIT_ANGLE_DEG = 6.0
"""Angle of the rays of the first two pictures: COLMAP's own takes long to be given up in a clip."""
FOCALS = tuple(np.geomspace(0.4, 4.0, 24).tolist())
"""Focal lengths of a turn, in the picture's longer side."""
MIN_PARALLAX = 0.005
"""Motion of points, in the picture's longer side, that a turn leaves unexplained, at least."""
MIN_ANGLE_DEG = 3.0
"""Median angle between the viewing rays of a point below which nothing tells depth."""
MAX_ZOOM = 1.05
"""Ratio of the focal lengths of single pictures from which they may have been zoomed."""
ROUGH_PX = 0.3
"""Median residual of pictures that do not quite fit together, px."""
NO_PYCOLMAP = (
    "cameras by features need pycolmap; pip install 'poseviewer[cameras]', or use markers."
)
NO_MOTION = (
    "the camera turned on the spot or stood still, or the scene is flat, so that nothing tells "
    "depth; wanted a camera that moves about the scene by a tenth of its distance or more."
)


@dataclass(frozen=True, slots=True)
class FeaturePoints:
    """Features of a picture."""

    at: NDArray[np.float32]
    """(n, 2) px, as of ``Pictures.straighten``."""
    descriptors: NDArray[np.uint8]
    """(n, 128)."""


def place_by_features(
    tell: Tell, paths: Sequence[Path], known: Perspective | Undistortion | None, folder: Path
) -> Placement:
    """Find the cameras of pictures.

    Args:
        tell: takes lines on how far it is.
        paths: the pictures, in order where they are frames.
        known: their camera, with its lens; None: found with them.
        folder: where COLMAP keeps what it needs, an empty one.

    Raises:
        SettingsError: pycolmap is not installed; the pictures show too little texture, or nothing
            of their cameras' motion; they do not hang together.
    """
    try:
        import pycolmap
    except ImportError:
        raise SettingsError(NO_PYCOLMAP) from None
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    pycolmap.set_random_seed(SEED)
    pictures = Pictures(paths, known)
    chosen = _choose(len(paths))
    features = dict[int, FeaturePoints]()
    for count, index in enumerate(chosen):
        tell(f"features {count + 1} of {len(chosen)}")
        found = _features_in(pictures, index)
        if found is not None:
            features[index] = found
    if len(features) < MIN_PICTURES:
        raise SettingsError(_too_few(pictures, len(chosen)))
    database = folder / "features.db"
    numbers = _write_features(database, pictures, features)
    pairs = _pairs([*features], is_whole=len(paths) <= MAX_WHOLE)
    _match(tell, database, folder / "pairs.txt", pairs)
    tell("comparing motions")
    _refuse_turns(database, pictures, features, numbers)
    is_fixed = pictures.pinhole is not None
    model, others = _reconstruct(tell, database, folder / "models", numbers, is_fixed)
    solved = _Solved(pictures, model, numbers)
    rest = sorted({*range(len(paths))} - {*chosen})
    for index in features.keys() - solved.placed.keys():
        solved.place(index, features[index], features)
    for count, index in enumerate(rest):
        tell(f"placed {count + 1} of the {len(rest)} between")
        found = _features_in(pictures, index)
        if found is not None:
            solved.place(index, found, features)
    note = _misfit(tell, database, folder / "free", model, numbers) if is_fixed else ""
    return solved.placement(others, note)


def _choose(count: int) -> list[int]:
    step = 1 if count <= MAX_WHOLE else min(max(1, round(count / CHOSEN)), MAX_STEP)
    return sorted({*range(0, count, step), count - 1})


def _features_in(pictures: Pictures, index: int) -> FeaturePoints | None:
    grey = pictures.read(index)
    if grey is None:
        return None
    at, descriptors = _sift(grey)
    if len(at) < FEW_FEATURES:
        pictures.left_out[index] = f"{len(at)} features, too little texture"
        return None
    return FeaturePoints(pictures.straighten(at).astype(np.float32), descriptors)


def _sift(grey: Grey) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Points (n, 2), OpenCV's pixels, with RootSIFT descriptors of bytes, as COLMAP has them."""
    small, scale = resized(grey, LONGEST_PX)
    sift = cv2.SIFT.create(MAX_FEATURES, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    points, descriptors = sift.detectAndCompute(small, None)
    if not len(points):
        return np.zeros((0, 2)), np.zeros((0, 128), np.uint8)
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    at = (np.array([point.pt for point in points]) + 0.5) / scale - 0.5
    return at, np.clip(np.rint(512.0 * np.sqrt(shares)), 0, 255).astype(np.uint8)


def _too_few(pictures: Pictures, count: int) -> str:
    names = [f"{pictures.paths[i].name}: {why}" for i, why in pictures.left_out.items()]
    found = f"{count - len(names)} of {count} pictures can be used ({list_names(names, 3)})"
    return f"{found}; wanted two or more that show the scene's texture."


def _write_features(
    database: Path, pictures: Pictures, features: Mapping[int, FeaturePoints]
) -> dict[int, int]:
    """Write COLMAP's file of features; return the images' numbers in it, by index."""
    import pycolmap

    with pycolmap.Database.open(database) as opened:
        cameras = list[Any]()
        for guess in pictures.cameras:
            camera = pictures.pinhole or guess
            is_known = pictures.pinhole is not None
            values = [camera.fx, camera.fy] if is_known else [camera.fx]
            values += [camera.cx, camera.cy] if is_known else [camera.cx, camera.cy, 0.0]
            one = pycolmap.Camera(
                model="PINHOLE" if is_known else "SIMPLE_RADIAL",
                width=camera.width,
                height=camera.height,
                params=values,
            )
            one.has_prior_focal_length = is_known or guess.fx in pictures.focals_px.values()
            one.camera_id = opened.write_camera(one)
            rig = pycolmap.Rig()
            rig.add_ref_sensor(one.sensor_id)
            rig.rig_id = opened.write_rig(rig)
            cameras.append((one, rig))
        numbers = dict[int, int]()
        for index, own in features.items():
            camera, rig = cameras[pictures.camera_of[index]]
            image = pycolmap.Image(name=f"{index}", camera_id=camera.camera_id)
            numbers[index] = image.image_id = opened.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig.rig_id
            frame.add_data_id(image.data_id)
            opened.write_frame(frame)
            opened.write_keypoints(image.image_id, own.at)
            descriptors = pycolmap.FeatureDescriptors(
                pycolmap.FeatureExtractorType.SIFT, own.descriptors
            )
            opened.write_descriptors(image.image_id, descriptors)
    return numbers


def _pairs(indices: Sequence[int], is_whole: bool) -> list[tuple[int, int]]:
    """Pairs of pictures to match: all, or of frames neighbours, and some that are evenly spread."""
    step = 1 if is_whole else -(-len(indices) // SPREAD)
    return [
        (indices[a], indices[b])
        for a, b in combinations(range(len(indices)), 2)
        if b - a <= NEIGHBOURS or not (a % step or b % step)
    ]


def _match(tell: Tell, database: Path, file: Path, pairs: Sequence[tuple[int, int]]) -> None:
    import pycolmap

    matching = pycolmap.FeatureMatchingOptions()
    matching.use_gpu = False
    geometry = pycolmap.TwoViewGeometryOptions()
    geometry.ransac.random_seed = SEED
    for start in range(0, len(pairs), PAIRS_AT_ONCE):
        tell(f"matched {start} of {len(pairs)} pairs")
        some = pairs[start : start + PAIRS_AT_ONCE]
        file.write_text("".join(f"{a} {b}\n" for a, b in some))
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = file
        pycolmap.match_image_pairs(database, matching, pairing, geometry)


def _refuse_turns(
    database: Path, pictures: Pictures, features: Mapping[int, FeaturePoints],
    numbers: Mapping[int, int],
) -> None:  # fmt: skip
    """Raise where a camera that only turns explains what all pairs of pictures have in common.

    COLMAP finds cameras for such pictures, too: a wrong focal length looks like parallax.
    """
    import pycolmap

    index_of = {number: index for index, number in numbers.items()}
    with pycolmap.Database.open(database) as opened:
        ids, geometries = opened.read_two_view_geometries()
    pairs = list[tuple[NDArray[Any], NDArray[Any]]]()
    for number, geometry in zip(ids, geometries, strict=True):
        matches = np.asarray(geometry.inlier_matches, int)
        if len(matches) >= FEW_FEATURES:
            pair = [index_of[one] for one in pycolmap.pair_id_to_image_pair(number)]
            camera = pictures.pinhole or pictures.cameras[pictures.camera_of[pair[0]]]
            middle = np.array([camera.cx, camera.cy], np.float32)
            side = max(camera.width, camera.height)
            a, b = (features[i].at[matches[:, k]] - middle for k, i in enumerate(pair))
            pairs.append((a / side, b / side))
    if not pairs:
        return
    known = pictures.pinhole
    focals = FOCALS if known is None else (known.fx / max(known.width, known.height),)
    # Few pairs may be of wrong matches, which nothing explains.
    off = min(np.percentile([_off_turn(a, b, focal) for a, b in pairs], 90) for focal in focals)
    if off < MIN_PARALLAX:
        found = f"A camera that only turns explains all but {100.0 * off:.2f} % of a side"
        raise SettingsError(f"{found} of the pictures' motion: {NO_MOTION}")


def _off_turn(a: NDArray[Any], b: NDArray[Any], focal: float) -> float:
    """Return the median distance of points ``b`` (n, 2) from where a turn of the camera takes
    ``a``, both about the picture's middle in its longer side, as the focal length is.
    """
    one, other = (np.column_stack([at, np.full(len(at), focal)]) for at in (a, b))
    lengths = [np.linalg.norm(at, axis=1, keepdims=True) for at in (one, other)]
    turn = nearest_rotation((other / lengths[1]).T @ (one / lengths[0]))
    turned = one @ turn.T
    shown = focal * turned[:, :2] / np.maximum(turned[:, 2:], 1e-6)
    return float(np.median(np.linalg.norm(shown - b, axis=1)))


def _reconstruct(
    tell: Tell, database: Path, out: Path, numbers: Mapping[int, int], is_fixed: bool
) -> tuple[pycolmap.Reconstruction, list[list[int]]]:
    """Return the largest reconstruction, and the indices of the pictures in each of the others; a
    camera that ``is_fixed`` stays as it is.
    """
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = min(3, len(numbers))
    options.extract_colors = False
    options.mapper.init_min_tri_angle = INIT_ANGLE_DEG
    options.random_seed = options.mapper.random_seed = options.triangulation.random_seed = SEED
    if is_fixed:
        options.ba_refine_focal_length = options.ba_refine_extra_params = False
        options.mapper.abs_pose_refine_focal_length = False
        options.mapper.abs_pose_refine_extra_params = False
    if len(numbers) == MIN_PICTURES:
        options.triangulation.ignore_two_view_tracks = False
        options.ba_refine_focal_length = options.ba_refine_extra_params = False
    count = MIN_PICTURES

    def show_first() -> None:
        nonlocal count
        count = MIN_PICTURES
        tell(f"placed {count} of {len(numbers)}")

    def show_next() -> None:
        nonlocal count
        count += 1
        tell(f"placed {min(count, len(numbers))} of {len(numbers)}")

    out.mkdir()
    models = pycolmap.incremental_mapping(
        database, out.parent, out, options, initial_image_pair_callback=show_first,
        next_image_callback=show_next,
    )  # fmt: skip
    by_size = sorted(models.values(), key=lambda model: -model.num_reg_images())
    if not by_size:
        raise SettingsError(f"The pictures' cameras were not found: {NO_MOTION}")
    others = [[int(image.name) for image in _images(model)] for model in by_size[1:]]
    return by_size[0], others


def _misfit(
    tell: Tell, database: Path, out: Path, fixed: pycolmap.Reconstruction,
    numbers: Mapping[int, int],
) -> str:  # fmt: skip
    """Say that a given camera does not fit, where pictures fit far better by one that is found; "":
    it does. A wrong one can show up as cameras that stand on the wrong side.
    """
    import pycolmap

    if len(numbers) <= MIN_PICTURES:
        return ""
    tell("comparing with a camera that is found")
    with pycolmap.Database.open(database) as opened:
        for camera in opened.read_all_cameras():
            fx, fy, cx, cy = camera.params
            camera.model = pycolmap.CameraModelId.SIMPLE_RADIAL
            camera.params = [(fx + fy) / 2.0, cx, cy, 0.0]
            opened.update_camera(camera)
    try:
        free, _ = _reconstruct(tell, database, out, numbers, is_fixed=False)
    except SettingsError:
        return ""
    before, after = (model.compute_mean_reprojection_error() for model in (fixed, free))
    if after > MISFIT * before or free.num_reg_images() < fixed.num_reg_images():
        return ""
    camera = next(iter(free.cameras.values()))
    found = f"{after:.2f} px off by focal length {camera.params[0]:.1f} px, lens "
    return (
        f"The given camera does not fit: the pictures are {before:.2f} px off by it, and only "
        f"{found}{camera.params[3]:.4f}; leave it out, then the camera is found with the pictures."
    )


def _images(model: pycolmap.Reconstruction) -> Iterator[pycolmap.Image]:
    return (model.image(number) for number in model.reg_image_ids())


class _Solved:
    """A reconstruction, and pictures that are placed by its points."""

    def __init__(
        self, pictures: Pictures, model: pycolmap.Reconstruction, numbers: Mapping[int, int]
    ) -> None:
        self.pictures = pictures
        self.model = model
        self.points = dict[int, tuple[NDArray[np.intp], FloatArray]]()
        """By picture: indices of the features that are points, and the points (n, 3)."""
        self.placed = dict[int, Placed]()
        self.zooms = list[float]()
        """Focal lengths by which single pictures fit best, in that of all."""
        where = {number: point.xyz for number, point in model.points3D.items()}
        for image in _images(model):
            index = int(image.name)
            seen = image.get_observation_point2D_idxs()
            keypoints = image.points2D
            points = np.array([where[keypoints[at].point3D_id] for at in seen]).reshape(-1, 3)
            self.points[index] = np.array(seen, int), points
            pixels = np.array([keypoints[at].xy for at in seen]).reshape(-1, 2)
            pose = image.cam_from_world()
            residuals = _residuals(model.camera(image.camera_id), pose, points, pixels)
            self._add(index, image.camera_id, pose, float(np.median(residuals)))
            if pictures.pinhole is None and len(points) >= MIN_INLIERS:
                self.zooms.append(_zoom(model.camera(image.camera_id), pose, points, pixels))
        self.numbers = {index: int(number) for index, number in numbers.items()}
        angle = self._angle_deg()
        if angle < MIN_ANGLE_DEG:
            found = f"The pictures show points at angles of {angle:.1f} degrees"
            raise SettingsError(f"{found}: {NO_MOTION}")

    def _add(self, index: int, camera_id: int, pose: Any, residual_px: float) -> None:
        camera = self.model.camera(camera_id)
        fx, fy = camera.focal_length_x, camera.focal_length_y
        own = Perspective(
            fx, fy, camera.principal_point_x, camera.principal_point_y, camera.width, camera.height
        )
        known = self.pictures.pinhole
        coefficients = () if known is not None else tuple(camera.params[3:])
        place = RigidTransform(pose.rotation.matrix(), pose.translation)
        self.placed[index] = self.pictures.placed(known or own, coefficients, place, residual_px)

    def _angle_deg(self) -> float:
        """Median, over the points, of the largest angle between two of its viewing rays."""
        centres = {image.image_id: image.projection_center() for image in _images(self.model)}
        largest = []
        for point in self.model.points3D.values():
            rays = [point.xyz - centres[seen.image_id] for seen in point.track.elements]
            rays = np.array(rays) / np.linalg.norm(rays, axis=1, keepdims=True)
            largest.append(float((rays @ rays.T).min()))
        return float(np.degrees(np.arccos(np.clip(np.median(largest or [1.0]), -1.0, 1.0))))

    def place(
        self, index: int, found: FeaturePoints, features: Mapping[int, FeaturePoints]
    ) -> None:
        """Place a picture by the points of those beside it, or else of all."""
        import pycolmap

        order = sorted(self.points, key=lambda other: abs(other - index))
        camera = self._camera_of(index)
        if camera is None:
            self.pictures.left_out[index] = "no other picture of its size was placed"
            return
        scale = max(1.0, max(camera.width, camera.height) / LONGEST_PX)
        estimation = pycolmap.AbsolutePoseEstimationOptions()
        estimation.ransac.max_error = MAX_ERROR_PX * scale
        estimation.ransac.random_seed = SEED
        most = 0
        for beside in (order[:BESIDE], order):
            pixels, points = self._matches(found, features, beside)
            if len(pixels) >= MIN_INLIERS:
                answer = pycolmap.estimate_and_refine_absolute_pose(
                    pixels, points, camera, estimation
                )
                most = max(most, int(answer["num_inliers"]) if answer else 0)
                if answer and most >= MIN_INLIERS:
                    inside, pose = answer["inlier_mask"], answer["cam_from_world"]
                    residuals = _residuals(camera, pose, points[inside], pixels[inside])
                    self._add(index, camera.camera_id, pose, float(np.median(residuals)))
                    return
        wanted = f"wanted {MIN_INLIERS}"
        self.pictures.left_out[index] = f"{most} points of the others are in it; {wanted}"

    def _camera_of(self, index: int) -> pycolmap.Camera | None:
        group = self.pictures.camera_of[index]
        alike = (image for image in _images(self.model)
                 if self.pictures.camera_of[int(image.name)] == group)  # fmt: skip
        image = next(alike, None)
        return None if image is None else self.model.camera(image.camera_id)

    def _matches(
        self, found: FeaturePoints, features: Mapping[int, FeaturePoints], beside: Sequence[int]
    ) -> tuple[FloatArray, FloatArray]:
        """Pixels (n, 2), and points (n, 3) that look so in other pictures."""
        own, pixels, points = found.descriptors.astype(np.float32), [], []
        for other in beside:
            at, known = self.points[other]
            if len(at) < 2:
                continue
            mine, theirs = _alike(own, features[other].descriptors[at].astype(np.float32))
            pixels.append(found.at[mine])
            points.append(known[theirs])
        if not pixels:
            return np.zeros((0, 2)), np.zeros((0, 3))
        pairs = np.column_stack([np.concatenate(pixels).astype(float), np.concatenate(points)])
        pairs = np.unique(pairs, axis=0)
        return pairs[:, :2], pairs[:, 2:]

    def placement(self, others: Sequence[Sequence[int]], note: str) -> Placement:
        """Return what was found, with a note, and say what did not hang together."""
        left_out, notes = self.pictures.left_out, [note] if note else []
        if len(self.numbers) == MIN_PICTURES and self.pictures.pinhole is None:
            notes.append("The focal length is assumed: two pictures do not tell it; take more.")
        residual = float(np.median([own.residual_px for own in self.placed.values()]))
        if self.zooms and max(self.zooms) > MAX_ZOOM * min(self.zooms) and residual > ROUGH_PX:
            found = f"from {min(self.zooms):.2f} to {max(self.zooms):.2f} times"
            why = f"Single pictures fit best with {found} the focal length of all"
            notes.append(f"{why}: were they zoomed? Then their cameras are wrong.")
        for group in others:
            own = [index for index in group if index not in self.placed]
            names = [self.pictures.paths[index].name for index in own]
            if not own:
                continue
            found = f"{len(self.placed)} pictures hang together, {len(own)} others among themselves"
            notes.append(f"{found}: {list_names(names, 4)}.")
            left_out |= dict.fromkeys(own, "hangs together with others, not with most")
        for index in self.numbers:
            if index not in self.placed:
                left_out.setdefault(index, "too few of its features are in the others")
        return Placement(
            self.placed,
            left_out,
            self.pictures.sha256s,
            self.pictures.focals_px,
            notes=tuple(notes),
        )


def _alike(
    own: NDArray[np.float32], others: NDArray[np.float32]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where descriptors (n, 128) are far nearer to one of others (m, 128), m > 1, than to
    the next, and to which. A product of matrices takes a third of the time of OpenCV's matcher.
    """
    squares = (-2.0 * own) @ others.T
    squares += np.sum(own**2, axis=1)[:, None]
    squares += np.sum(others**2, axis=1)
    rows, nearest = np.arange(len(own)), squares.argmin(axis=1)
    least = squares[rows, nearest]
    squares[rows, nearest] = np.inf
    good = least < RATIO**2 * squares.min(axis=1)
    return rows[good], nearest[good]


def _zoom(camera: Any, pose: Any, points: FloatArray, pixels: FloatArray) -> float:
    """Return the focal length by which a picture fits best, in its camera's."""
    import pycolmap

    free = pycolmap.Camera(camera.todict())
    options = pycolmap.AbsolutePoseRefinementOptions()
    options.refine_focal_length = True
    inside = np.ones(len(points), bool)
    answer = pycolmap.refine_absolute_pose(pose, pixels, points, inside, free, options)
    return float(free.focal_length_x / camera.focal_length_x) if answer else 1.0


def _residuals(camera: Any, pose: Any, points: FloatArray, pixels: FloatArray) -> FloatArray:
    """(n,) px."""
    if not len(points):
        return np.zeros(1)
    shown = camera.img_from_cam(points @ pose.rotation.matrix().T + pose.translation)
    return np.linalg.norm(np.asarray(shown) - pixels, axis=1)
