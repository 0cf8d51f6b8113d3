"""From a set of photos, a model and its pose in one of them to a registration in each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.files.formats.conversion import METRES
from poseviewer.files.photo import matched
from poseviewer.files.pose import PoseRecord, check_against, load_pose, recorded_size
from poseviewer.files.view_set import recorded_masks
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.view_set import ViewSet
from poseviewer.starts.registration import registered


@dataclass(frozen=True, slots=True, eq=False)
class SetRegistration:
    """A model in all photos of a set that see it."""

    views: ViewSet
    """Those that are compared; the first is the reference, whose pose the search moves."""
    registrations: tuple[Registration, ...]
    """Of each; their starts are one pose in the set's frame."""
    scale: float
    """How many lengths of the model's unit one of the set's is."""
    free_size: bool
    """Whether that is a guess, and is to be searched for."""
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class StartInSet:
    """A pose in one of a set's photos."""

    index: int
    """Of the photo."""
    pose: Pose
    scale: float
    """How many lengths of the model's unit one of the set's is."""
    free_size: bool
    """Whether that is a guess, and is to be searched for."""
    notes: tuple[str, ...] = ()
    masks: Mapping[int, Mask] = field(default_factory=dict)
    """What counts of photos, by their numbers, as far as the pose file says it."""


def start_in_set(
    views: ViewSet,
    model: LoadedModel,
    start: str | Path | Pose,
    view: str | None = None,
    scale: float | None = None,
) -> StartInSet:
    """A start pose, in the photo ``view``, else in that which the pose file names; ``scale``: in
    place of the set's own.

    Raises:
        PoseViewerError: the pose file cannot be used, or not with these photos; it is not known in
            which of them it is; nothing tells the scale.
    """
    if isinstance(start, Pose):
        record = PoseRecord(start)
    else:
        record = load_pose(start, *recorded_size(Path(start)))
    reference = _reference(views, record, view)
    own = views.views[reference]
    notes: list[str] = []
    if not isinstance(start, Pose):
        record = load_pose(start, own.photo.width, own.photo.height)
        notes += [*record.warnings, *check_against(record, own.photo.sha256, model.sha256)]
    if not isinstance(record.pose.camera, Perspective):
        raise SettingsError(
            f"{own.name}: a start under parallel projection, and the set's cameras are "
            "perspective; start from a perspective pose."
        )
    if record.undistortion is not None and own.photo.undistortion is None:
        raise SettingsError(
            f"{own.name}: the start was found on the photo undistorted by a lens that the set does "
            "not have; give the set that lens, or start from a pose by the set's camera."
        )
    _, record, of_camera = matched(own.photo, record)
    known = scale or known_scale(views, model.mesh)
    found = (
        known
        or _recorded_scale(record)
        or scale_by_sight(views, reference, model.mesh, record.pose)
    )
    masks = {} if isinstance(start, Pose) else recorded_masks(Path(start), record, views)
    said = (*notes, *of_camera)
    return StartInSet(reference, record.pose, found, known is None, said, masks)


def known_scale(views: ViewSet, mesh: Mesh) -> float | None:
    """How many lengths of the model's unit one of the set's is, by what both say; None: they do
    not.
    """
    return views.scale or _by_units(views.unit, mesh.unit)


def place_in_views(
    views: ViewSet,
    model: LoadedModel,
    start: str | Path | Pose,
    view: str | None = None,
    scale: float | None = None,
) -> SetRegistration:
    """The model in each view, from its pose in one; arguments as of ``start_in_set``. Views that
    do not see the model there are left out, with a note.

    Raises:
        PoseViewerError: as of ``start_in_set``; or fewer than two views see the model.
    """
    found = start_in_set(views, model, start, view, scale)
    reference, notes = found.index, list(found.notes)
    poses = views.posed(reference, found.pose, found.scale)
    kept, registrations = [], []
    for index in (reference, *(i for i in range(len(poses)) if i != reference)):
        other, pose = views.views[index], poses[index]
        if index != reference and not is_seen(model.mesh, pose):
            notes.append(f"{other.name} does not see the model where it starts, and is left out.")
            continue
        kept.append(other)
        mask = found.masks.get(index, other.mask)
        registrations.append(registered(other.photo, model, pose, (), mask))
    require_several(views, [view.name for view in kept])
    of_photos = [note for one in registrations for note in one.warnings]
    said = tuple(dict.fromkeys([*of_photos, *notes]))
    seen = replace(views, views=tuple(kept))
    return SetRegistration(seen, tuple(registrations), found.scale, found.free_size, said)


def require_several(views: ViewSet, seen: Sequence[str]) -> None:
    """Two photos at least see the model; ``seen``: the names of those that do.

    Raises:
        SettingsError: they do not.
    """
    if len(seen) < 2:
        alone = f"{seen[0]} alone" if seen else "none"
        raise SettingsError(
            f"{views.name}: of {len(views.views)} photos, {alone} sees the model where it "
            "starts; bring the start nearer, or check the set's scale (--scale)."
        )


def _reference(views: ViewSet, record: PoseRecord, view: str | None) -> int:
    names = [one.name for one in views.views]
    wanted = view or (record.photo.file if record.photo else None)
    found = [i for i, name in enumerate(names) if wanted in (name, Path(name).name)]
    if len(found) == 1:
        return found[0]
    found = f"there is no photo {wanted}" if wanted else "the start does not say in which photo"
    raise PoseFileError(
        f"{views.name}: {found}; name the photo that the start is a pose in with --view, one of "
        f"{_some(names)}."
    )


def _some(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _by_units(unit: str | None, of_model: str | None) -> float | None:
    if unit is None:
        return None
    if of_model is None or of_model == unit:
        return 1.0
    return METRES[unit] / METRES[of_model] if {unit, of_model} <= set(METRES) else None


def _recorded_scale(record: PoseRecord) -> float | None:
    """That of the pose's own set, where it was found in one."""
    of_set = (record.in_set or {}).get("set_from_model")
    size = of_set.get("size") if isinstance(of_set, dict) else None
    if not isinstance(size, int | float) or isinstance(size, bool) or not size > 0.0:
        return None
    return 1.0 / size


def scale_by_sight(views: ViewSet, reference: int, mesh: Mesh, pose: Pose) -> float:
    """The scale by which what view ``reference`` sees of the model, at a pose there, is where the
    others look.

    Raises:
        SettingsError: they do not look at one place.
    """
    centre = pose.camera_from_model.apply(mesh.centre)
    found = None
    if centre[2] > 0.0:
        found = views.scale_by_sight(reference, centre / centre[2], float(centre[2]))
    if found is None:
        raise SettingsError(
            f"{views.name}: its scale is not known, and its cameras do not look at one place, "
            "which would tell it about; give --scale, lengths of the model's unit in one of the "
            "set's."
        )
    return found


def is_seen(mesh: Mesh, pose: Pose) -> bool:
    """Whether the model's centre is in front of the camera, and some of it in the picture."""
    seen = pose.project(hull_points(mesh))
    size = np.array([pose.camera.width, pose.camera.height])
    inside = np.all((seen >= 0.0) & (seen < size), axis=1)
    return bool(pose.camera_from_model.apply(mesh.centre)[2] > 0.0 and inside.any())
