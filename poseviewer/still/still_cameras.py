"""Cameras of pictures of a scene that stands still, as views of a scene."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from poseviewer.errors import SettingsError, list_names
from poseviewer.files.image_sequence import ImageSequence
from poseviewer.files.marker_board import NO_BOARD, MarkerBoard
from poseviewer.files.scene_assets import view_of_file
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Undistortion
from poseviewer.processes import iterate_in_subprocess
from poseviewer.scene.types import Scene, View
from poseviewer.still.features import place_by_features
from poseviewer.still.marker_scale import scale_by_markers
from poseviewer.still.markers import MIN_SHARE, place_by_markers, survey_markers
from poseviewer.still.pictures import MIN_PICTURES, Placement, Tell

By = Literal["auto", "features", "markers"]
MAX_NAMED = 5
UNSURE_TIMES = 3.0
"""Residual of a picture, in those of most, from which it is named."""
UNSURE_PX = 1.0
"""And in px."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundCameras:
    """Cameras that a process found, before they are views."""

    by: Literal["features", "markers"]
    placement: Placement


@dataclass(frozen=True, eq=False)
class StillCameras:
    """Pictures of a still scene with their cameras."""

    name: str
    """Of the clip or the folder; "": not known."""
    by: Literal["features", "markers", "object"]
    views: tuple[View, ...]
    """In the order of the pictures, in one world."""
    unit: str | None = None
    """Unit of the world; None: not said."""
    is_scale_known: bool = False
    """Whether the world's lengths are those of ``unit``, or of the model."""
    residual_px: Mapping[str, float] | None = None
    """Median residual of each picture by the views' names, px; None: not measured."""
    left_out: Mapping[str, str] | None = None
    """Reasons, by the names of the pictures that have no camera."""
    exif_focals_px: tuple[float, ...] = ()
    """Focal lengths that EXIF says, px, each once."""
    notes: tuple[str, ...] = ()
    """Sentences on what moved, or does not hang together."""

    @property
    def scene(self) -> Scene:
        """The set of photos: a scene without objects."""
        return Scene(
            views=self.views, unit=self.unit, free_scale=not self.is_scale_known, name=self.name,
            notes=self.notes,
        )  # fmt: skip

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """What was found, in words, a line each."""
        out = self.left_out or {}
        total = len(self.views) + len(out)
        said = [f"{len(self.views)} of {total} pictures have cameras, by {self.by}"]
        if self.residual_px:
            worst = max(self.residual_px, key=self.residual_px.__getitem__)
            usual = float(np.median([*self.residual_px.values()]))
            said.append(
                f"residual: {usual:.2f} px (median), {self.residual_px[worst]:.2f} px in {worst}, "
                "the worst picture"
            )
        cameras = [view.camera for view in self.views]
        focals = {f"{c.fx:.1f}": None for c in cameras if isinstance(c, Perspective)}
        exif = ", ".join(f"{focal:.1f}" for focal in self.exif_focals_px)
        beside = f" (EXIF: {exif} px)" if exif else ""
        said.append(f"focal length: {', '.join(focals)} px{beside}")
        lenses = {view.file.undistortion.lens for view in self.views if view.file.undistortion}
        said += [
            "lens: " + ", ".join(f"{number:.4g}" for number in lens.coefficients) for lens in lenses
        ]
        known = f"known, in {self.unit or 'units of the model'}"
        unknown = "not known; with `marker_size` it is, where markers are seen"
        said.append(f"scale: {known if self.is_scale_known else unknown}")
        reasons = dict[str, list[str]]()
        for name, reason in out.items():
            reasons.setdefault(reason, []).append(name)
        said += [
            f"left out: {list_names(names, MAX_NAMED)}: {why}" for why, names in reasons.items()
        ]
        return (*said, *(f"note: {note}" for note in self.notes))


def find_cameras(
    pictures: Sequence[Path] | ImageSequence,
    by: By = "auto",
    *,
    camera: Perspective | Undistortion | None = None,
    marker_size: float | None = None,
    unit: str | None = None,
    board: MarkerBoard = NO_BOARD,
) -> Iterator[str | StillCameras]:
    """Find where cameras stood, in a process of its own, which ends when the iteration is closed.

    Args:
        pictures: of one scene that stands still; frames in order.
        by: features of the scene, markers in it, or markers where they are seen in most pictures.
        camera: the camera, or with its lens the map from the pictures as taken; None: EXIF's focal
            length is where the search for it begins.
        marker_size: side of the markers, black edge to black edge: with features the scale of the
            cameras is told by those that are seen.
        unit: of ``marker_size``.
        board: where some of the markers are, on a board whose frame is the world then.

    Yields:
        lines on how far it is, and at last the cameras.

    Raises:
        SettingsError: nothing tells the cameras; the sentence says why and what is wanted.
    """
    paths = [*(pictures.paths if isinstance(pictures, ImageSequence) else pictures)]
    name = pictures.name if isinstance(pictures, ImageSequence) else ""
    if len(paths) < MIN_PICTURES:
        count = f"{len(paths)} picture{'' if len(paths) == 1 else 's'}"
        raise SettingsError(f"{count}; wanted two or more of one scene.")
    if marker_size is not None and not 0.0 < marker_size < math.inf:
        raise SettingsError(f"a size of markers of {marker_size:g}; wanted a number above 0.")
    if unit is not None and marker_size is None:
        raise SettingsError("a unit without the markers' size, which it is of; give both.")
    if board.places and by == "features":
        raise SettingsError("a board of markers with features, which need none; leave it out.")
    if board.unit is not None:
        if marker_size is not None:
            raise SettingsError("a size of markers with a board that says it; leave the size out.")
        unit = board.unit
    with TemporaryDirectory(prefix="poseviewer-") as folder:
        given = paths, by, camera, marker_size, Path(folder), board
        try:
            found = yield from iterate_in_subprocess(place_pictures, *given)
        except subprocess.CalledProcessError:
            wanted = "is there enough memory? Take fewer pictures"
            raise SettingsError(f"The search for the cameras broke off; {wanted}.") from None
    yield _as_views(name, paths, found, unit)


def place_pictures(
    tell: Tell, paths: Sequence[Path], by: By, camera: Perspective | Undistortion | None,
    marker_size: float | None, folder: Path, board: MarkerBoard = NO_BOARD,
) -> FoundCameras:  # fmt: skip
    """Find the cameras, as ``find_cameras``, telling lines; ``folder``: an empty one."""
    family, by = board.family, "markers" if board.places else by
    if not family and (by != "features" or marker_size is not None):
        tell("looking for markers")
        family, share = survey_markers(paths)
        if not family and (by == "markers" or marker_size is not None):
            wanted = "wanted ArUco or AprilTag markers: whole, unmirrored, with a white margin"
            raise SettingsError(f"no marker in the pictures that were looked at; {wanted}.")
        if by == "auto":
            by = "markers" if share >= MIN_SHARE else "features"
    if by == "markers":
        placement = place_by_markers(tell, paths, camera, family, marker_size, board)
        return FoundCameras("markers", placement)
    placement = place_by_features(tell, paths, camera, folder)
    if marker_size is not None:
        placement = scale_by_markers(tell, placement, paths, family, marker_size)
    return FoundCameras("features", placement)


def _as_views(
    name: str, paths: Sequence[Path], found: FoundCameras, unit: str | None
) -> StillCameras:
    result = found.placement
    order = sorted(result.placed)
    views = tuple(
        view_of_file(
            paths[index], own.camera, result.sha256s[index], own.undistortion, own.camera_from_world
        )
        for index, own in ((index, result.placed[index]) for index in order)
    )
    residuals = {paths[index].name: result.placed[index].residual_px for index in order}
    usual = float(np.median([*residuals.values()]))
    bad = [n for n, off in residuals.items() if off > max(UNSURE_PX, UNSURE_TIMES * usual)]
    notes = result.notes
    if bad:
        found_px = f"{list_names(bad, MAX_NAMED)} disagree with the others"
        why = "something moved there, or the camera moved fast"
        notes += (f"{found_px} ({max(residuals[n] for n in bad):.1f} px): {why}.",)
    focals = tuple(dict.fromkeys(round(focal, 1) for focal in result.focals_px.values()))
    return StillCameras(
        name, found.by, views, unit if result.unit_known else None, result.unit_known, residuals,
        {paths[index].name: why for index, why in sorted(result.left_out.items())}, focals, notes,
    )  # fmt: skip
