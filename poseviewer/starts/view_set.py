"""From a set of photos, a model and its pose in one of them to a registration in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import PoseFileError, SettingsError
from poseviewer.files.formats.conversion import METRES
from poseviewer.files.photo import matched
from poseviewer.files.pose import PoseRecord, check_against, load_pose, recorded_size
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.mesh import hull_points
from poseviewer.geometry.transform import RigidTransform
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


def place_in_views(
    views: ViewSet,
    model: LoadedModel,
    start: str | Path | Pose,
    view: str | None = None,
    scale: float | None = None,
) -> SetRegistration:
    """The model in each view, from its pose in one: in ``view``, else in that of the photo which
    the pose file names. ``scale``: in place of the set's own. Views that do not see the model
    there are left out, with a note.

    Raises:
        PoseViewerError: the pose file cannot be used, or not with these photos; it is not known in
            which of them it is; fewer than two see the model; nothing tells the scale.
    """
    record = PoseRecord(start) if isinstance(start, Pose) else _recorded(start)
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
    place, notes = record.pose.camera_from_model, [*notes, *of_camera]
    known = scale or views.scale or _by_units(views.unit, model.mesh.unit)
    found = known or _recorded_scale(record) or _guessed(views, reference, model, place)
    order = [reference, *(i for i in range(len(views.views)) if i != reference)]
    kept, registrations = [], []
    for index in order:
        other = views.views[index]
        moved = other.camera_from_set @ own.camera_from_set.inverse()
        moved = RigidTransform(moved.rotation, found * moved.translation)
        pose = Pose(other.camera, place if index == reference else moved @ place)
        if index != reference and not _is_seen(model, pose):
            notes.append(f"{other.name} does not see the model where it starts, and is left out.")
            continue
        kept.append(other)
        registrations.append(registered(other.photo, model, pose, (), other.mask))
    if len(kept) < 2:
        raise SettingsError(
            f"{views.name}: of {len(views.views)} photos, {own.name} alone sees the model where it "
            "starts; bring the start nearer, or check the set's scale (--scale)."
        )
    of_photos = [note for one in registrations for note in one.warnings]
    said = tuple(dict.fromkeys([*of_photos, *notes]))
    seen = replace(views, views=tuple(kept))
    return SetRegistration(seen, tuple(registrations), found, known is None, said)


def _recorded(path: str | Path) -> PoseRecord:
    return load_pose(path, *recorded_size(Path(path)))


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


def _guessed(views: ViewSet, reference: int, model: LoadedModel, place: RigidTransform) -> float:
    centre = place.apply(model.mesh.centre)
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


def _is_seen(model: LoadedModel, pose: Pose) -> bool:
    """Whether the model's centre is in front of the camera, and some of it in the picture."""
    seen = pose.project(hull_points(model.mesh))
    size = np.array([pose.camera.width, pose.camera.height])
    inside = np.all((seen >= 0.0) & (seen < size), axis=1)
    return bool(pose.camera_from_model.apply(model.mesh.centre)[2] > 0.0 and inside.any())
