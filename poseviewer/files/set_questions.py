"""What of a set of files is to be opened, and the questions that only the user can answer."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from poseviewer.files.cameras import Calibration
from poseviewer.files.file_set import FileSet, KnownCameras, ModelFiles, model_files
from poseviewer.files.keypoints import keypoints_path
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import ENDINGS
from poseviewer.files.view_set import SetChoice
from poseviewer.geometry.transform import RigidTransform

ALL_OBJECTS = "all: the photo shows each"
"""The answer that makes every model an object."""
ANOTHER_OBJECT = "another object in the photo"
ALL_PHOTOS = "all {}: one pose in all of them"
"""The answer that makes photos with known cameras a set."""
MOST_NAMED = 3
"""Missing files that are asked for."""
MOST_SHOWN = 5
"""Names in one sentence."""


@dataclass(frozen=True, slots=True)
class Question:
    """One thing that the files do not say."""

    text: str
    options: tuple[str, ...]
    """What can be answered; the last one: nothing of these."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """What is to be opened; None: what is at hand stays."""

    photo: Path | None = None
    calibration: Calibration | None = None
    """The photo's camera, or that of the one at hand."""
    model: ModelFiles | None = None
    others: tuple[ModelFiles, ...] = ()
    """Further models that the photo may show."""
    objects: tuple[ModelFiles, ...] = ()
    """Further models that the photo shows as well."""
    pose: Path | None = None
    place: RigidTransform | None = None
    """The start as a scene has it, camera from model."""
    notes: tuple[str, ...] = ()
    scene: Path | None = None
    """A scene file, which says all by itself."""
    views: Path | None = None
    """A set of photos, for ``model`` or the one at hand, with ``pose``."""
    choice: SetChoice = field(default_factory=SetChoice)
    """What the set's file leaves open."""


Choosing = Generator[Question, str | None, Chosen]
"""Gives questions, takes answers (None at first, then one of the options each), returns what is to
be opened."""


def choose(found: FileSet, placed: str = "") -> Choosing:
    """What is to be opened of a set; ``placed``: what the model at hand is called, where someone
    has put it in its place: then another model may be another object.

    Raises:
        PoseViewerError: a scene in it is damaged.
    """
    if found.scene_files:
        file = yield from _one(found, "scene files", "is to be opened", found.scene_files)
        return Chosen(scene=file)
    if found.set_files:
        file = yield from _one(found, "sets of photos", "is to be opened", found.set_files)
        return (yield from _views(found, Chosen(views=file)))
    photo, pictures, is_known = None, found.pictures, bool(found.scenes or found.known_cameras)
    if is_known:
        photo = yield from _photo(found, ())
    if isinstance(photo, KnownCameras):
        return (yield from _photos(found, photo))
    model, others, objects = yield from _model(found, photo)
    if model is not None and not (others or objects):
        model = yield from _completed(found, model)
        pictures = tuple(path for path in pictures if path not in model.named.values())
    if not is_known:
        photo = yield from _photo(found, pictures)
    assert not isinstance(photo, KnownCameras)  # there is none
    scene, calibration, place = found.scene_of(photo), None, None
    if scene is not None and photo is not None:
        calibration = Calibration(scene.cameras)
        place = None if model is None or others or objects else scene.place(photo, model.path)
    elif found.cameras:
        file = yield from _one(found, "files of cameras", "has the photo's camera", found.cameras)
        calibration = None if file is None else Calibration(file)
    if placed and photo is None and not others and model is not None:
        if not objects:
            text = (
                f"{placed} is in its place. Is {found.label(model.path)} another object, or to be "
                "opened instead?"
            )
            beside, instead = ANOTHER_OBJECT, f"in place of {placed}"
            answer = yield Question(text, (beside, instead, "none: open no model"))
            objects = (model,) if answer == beside else ()
            model = model if answer == instead else None
        else:
            objects, model = (model, *objects), None
    poses = () if objects else found.poses  # of which object would it be?
    pose = yield from _one(found, "pose files", "is the start", poses)
    opened = (*objects,) if model is None else (model, *objects)
    used = {photo, *(path for one in opened for path in one.named.values())}
    unasked = found.pictures if found.photos else ()  # else they were asked about
    left = *found.leftovers, *unasked, *(found.poses if objects else ())
    notes = _not_used(found, [path for path in left if path not in used])
    return Chosen(photo, calibration, model, others, objects, pose, place, notes)


def _views(found: FileSet, views: Chosen) -> Choosing:
    """A set of photos with its model and its start."""
    model, others, objects = yield from _model(found, views.photo)
    pose = yield from _one(found, "pose files", "is the start", found.poses)
    unused = [one.path for one in (*others, *objects)]
    return replace(views, model=model, pose=pose, notes=_not_used(found, unused))


def _photos(found: FileSet, known: KnownCameras) -> Choosing:
    """All photos whose cameras are known as a set, with the model where a scene has it."""
    rig = None
    if len(known.rigs) > 1:
        by_label = {f"object {rig}, in {len(of)} photos": rig for rig, of in known.rigs.items()}
        text = (
            "The scene does not say how its camera moved. Which object stood still, so that its "
            "poses tell it?"
        )
        rig = by_label.get((yield Question(text, (*by_label, "none: open no photo"))) or "")
        if rig is None:
            return Chosen()
    elif known.rigs:
        (rig,) = known.rigs
    choice = known.choice(rig)
    photos = [photo for photo, name in known.photos.items() if name in choice.photos]
    views = Chosen(photo=photos[0], views=known.path, choice=choice)
    chosen = yield from _views(found, views)
    scene = found.scene_of(photos[0])
    if chosen.model is None or scene is None or not scene.images:
        return chosen  # the world of others is not the model's frame
    places = ((photo, scene.place(photo, chosen.model.path)) for photo in photos)
    photo, place = next((one for one in places if one[1] is not None), (photos[0], None))
    return replace(chosen, photo=photo, place=place)


def _photo(
    found: FileSet, pictures: Sequence[Path]
) -> Generator[Question, str | None, Path | KnownCameras | None]:
    if found.known_cameras:
        photos, sets = found.photos, {}
        for known in found.known_cameras:
            count = f"{len(known.photos)} photos"
            several = len(found.known_cameras) > 1
            of = f"{count} of {found.label(known.path)}" if several else count
            sets[ALL_PHOTOS.format(of)] = known
        by_label = {found.label(path): path for path in photos}
        text = f"{len(photos):,} photos. Which one is to be opened?"
        answer = yield Question(text, (*sets, *by_label, "none"))
        return by_label.get(answer or "") or sets.get(answer or "")
    if found.photos or not pictures:
        # What is left of the pictures is of no use beside a photo that a camera has taken.
        return (yield from _one(found, "photos", "is to be opened", found.photos))
    if len(pictures) == 1:
        text = f"No file names the picture {found.label(pictures[0])}. Is it the photo?"
    else:
        text = f"No file names these {len(pictures)} pictures. Which one is the photo?"
    return (yield from _asked(found, text, pictures, "none: the photo stays"))


def _model(
    found: FileSet, photo: Path | None
) -> Generator[
    Question, str | None, tuple[ModelFiles | None, tuple[ModelFiles, ...], tuple[ModelFiles, ...]]
]:
    """The model, further ones that it may be, and further ones that are there as well."""
    scene, models = found.scene_of(photo), found.models
    if scene is not None and photo is not None:
        seen = tuple(model for model in models if scene.has(photo, model.path))
        models = seen or models
    if len(models) < 2:
        return (models[0] if models else None), (), ()
    by_label = {found.label(model.path): model for model in models}
    text = f"{len(models)} models came together. Which one is to be opened?"
    answer = yield Question(text, (*by_label, ALL_OBJECTS, "none: the model stays"))
    if answer == ALL_OBJECTS:
        return models[0], (), models[1:]
    return by_label.get(answer or ""), (), ()


def _completed(found: FileSet, model: ModelFiles) -> Generator[Question, str | None, ModelFiles]:
    """The model with what the user says is a missing file of it under another name."""
    given: dict[str, Path] = {}
    others = (*found.pictures, *found.leftovers)
    for _ in range(MOST_NAMED):
        left = [path for path in others if path not in given.values()]
        asked = next(
            (
                (name, fit)
                for name in model.missing
                if name not in given and (fit := _of_same_kind(name, left))
            ),
            None,
        )
        if asked is None:
            break
        name, fit = asked
        text = (
            f"{model.path.name} names {bare_name(name)}, which did not come with it. "
            "Is it one of these?"
        )
        answer = yield from _asked(found, text, fit, "no")
        if answer is None:
            break
        given[name] = answer
        model = model_files(model.path, (*model.named.values(), *others), given)
    own = keypoints_path(model.path).name
    if found.keypoints and own not in model.named:
        text = f"No model is named like these key points. Are they those of {model.path.name}?"
        answer = yield from _asked(found, text, found.keypoints, "no")
        if answer is not None:
            given[own] = answer
            model = model_files(model.path, (*model.named.values(), *others), given)
    return model


def _of_same_kind(name: str, files: Sequence[Path]) -> tuple[Path, ...]:
    """The files that may be the one that is missing."""
    ending = Path(bare_name(name)).suffix.lower()
    endings = ENDINGS if ending in ENDINGS else (ending,)
    return tuple(path for path in files if path.suffix.lower() in endings)


def _one(
    found: FileSet, what: str, does: str, files: Sequence[Path]
) -> Generator[Question, str | None, Path | None]:
    if len(files) < 2:
        return files[0] if files else None
    return (yield from _asked(found, f"{len(files):,} {what}. Which one {does}?", files, "none"))


def _asked(
    found: FileSet, text: str, files: Sequence[Path], none: str
) -> Generator[Question, str | None, Path | None]:
    by_label = {found.label(path): path for path in files}
    answer = yield Question(text, (*by_label, none))
    return by_label.get(answer or none)


def _not_used(found: FileSet, left: Sequence[Path]) -> tuple[str, ...]:
    names = [found.label(path) for path in left]
    if not names:
        return ()
    more = f" and {len(names) - MOST_SHOWN:,} more" if len(names) > MOST_SHOWN else ""
    return (f"Not used: {', '.join(names[:MOST_SHOWN])}{more}.",)
