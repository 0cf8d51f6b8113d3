"""Turn options into settings, a calibrated camera, files and a scene."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.terminal import progress_bar, tell, tell_of_compiling
from poseviewer.errors import SettingsError
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.losses.known_losses import LOSSES
from poseviewer.scene.settings import FitSettings, Limits

if TYPE_CHECKING:  # help texts come before all that
    from poseviewer.api import Registration
    from poseviewer.files.cameras import Calibration
    from poseviewer.files.image_sequence import ImageSequence
    from poseviewer.files.masks import MaskFile
    from poseviewer.opening.sources import Sources
    from poseviewer.starts.instances import AutoStart
    from poseviewer.starts.start import FindStart

SAYS = "with {}, which says it itself; leave it out"
"""Reason for refusing an option whose value the named file has."""


def refuse_beside_loss(options: Namespace) -> None:
    """Refuse settings that do not go with the loss."""
    loss = LOSSES[getattr(options, "loss", None) or DEFAULT.name]
    pixels = getattr(options, "pixels", None) or loss.pixels[0]
    if pixels not in loss.pixels:
        has = f"it has {' and '.join(loss.pixels)} alone"
        raise SettingsError(f"--loss {loss.name} with --pixels {pixels}; {has}")
    if loss.is_grey:
        compares_grey = f"with --loss {loss.name}, which compares grey; leave one of them out"
        table.refuse(options, (table.REFLECTANCE,), compares_grey)


def make_settings(options: Namespace) -> FitSettings:
    """Make the settings of a fit."""
    refuse_beside_loss(options)
    return table.make(
        FitSettings,
        options,
        mask=options.mask.name if options.mask else None,
        without=tuple(options.without) if options.without else None,
        limits=table.make(Limits, options),
    )


def mask_of(options: Namespace) -> MaskFile | None:
    """Return the mask that the options name; None without one."""
    if options.mask is None:
        table.refuse(options, (table.MASK_LABEL,), "without --mask; name its file")
        return None
    from poseviewer.files.masks import MaskFile

    return MaskFile(options.mask, options.label or "")


def calibration_of(options: Namespace) -> Calibration | None:
    """Return the calibration that the options name; None without one."""
    if options.calibration is None:
        table.refuse(options, table.OF_CALIBRATION, "without --calibration; name its file")
        return None
    from poseviewer.files.cameras import Calibration

    return table.make(Calibration, options, path=options.calibration)


def name_files(options: Namespace) -> Sources:
    """Return the files that the options name, and refuse those that exclude each other."""
    from poseviewer.opening.photo_sets import SetChoice
    from poseviewer.opening.sources import Sources, is_pose_file, is_scene_file, name_sources

    photo, model, views = options.photo, options.model, options.views
    if views is not None:
        table.refuse(options, (table.OBJECT, *table.OF_A_PHOTO), SAYS.format("--views"))
        if model is not None or photo is None:
            raise SettingsError("--views SET wants MODEL alone: the set says the photos")
        return name_sources(views, photo, options.pose, choice=table.make(SetChoice, options))
    table.refuse(options, table.OF_VIEWS, "without --views; leave it out, or name a set of photos")
    is_json = model is None and photo is not None and photo.suffix.lower() == ".json"
    if photo is not None and (is_json or is_scene_file(photo)):
        if is_json and is_pose_file(photo):
            found = f"{photo}: a pose file, which does not say its photo and model"
            raise SettingsError(f"{found}; name them: PHOTO MODEL --pose {photo.name}")
        table.refuse(options, (*table.STARTS, *table.OF_A_PHOTO), SAYS.format(photo.name))
        if model is not None:
            raise SettingsError(f"{photo}: a scene file says its models; leave out MODEL")
        return Sources(scene=photo)
    table.refuse(options, (table.OBJECT,), "without a scene; leave it out, or name a scene file")
    if photo is None or model is None:
        return Sources(photo, start=options.pose)
    return name_sources(photo, model, options.pose)


def load_named_sequence(
    options: Namespace, frames: Sequence[Path] | ImageSequence
) -> ImageSequence:
    """Load the frames of a sequence, or of its video, by the options of ``table.SEQUENCE``."""
    from poseviewer.files.image_sequence import load_sequence

    with progress_bar(100, getattr(options, "quiet", False)) as bar:

        def show(share: float) -> None:
            bar.update(round(100.0 * share) - bar.n)

        return load_sequence(frames, options.every or 1, options.frames, show)


def load_named(options: Namespace) -> Registration:
    """Load the files that the options name, and choose the object."""
    from poseviewer.api import make_registration
    from poseviewer.opening.scenes import open_scene
    from poseviewer.starts.instances import AutoStart
    from poseviewer.starts.start import StartCamera

    settings = make_settings(options)
    files = name_files(options)
    given = vars(options)
    if settings.renderer != "opengl":
        tell_of_compiling()
    if files.scene is not None:
        table.refuse(options, (table.FEATURES,), SAYS.format(files.scene.name))
    if given.get("box") or settings.region is not None:
        unused = "with --box or --region, where it is not used; leave one of them out"
        table.refuse(options, (table.FEATURES,), unused)
    parallel = given.get("projection") == "parallel"
    camera = StartCamera(parallel, given.get("focal"), options.free_focal)
    with progress_bar(None, options.quiet) as bar:
        number, features = given.get("instances") or 1, given.get("features")
        auto = AutoStart(given.get("box"), number, camera, bar.update, features)
        start = None if files.scene else _start_of(options, auto)
        more = {"calibration": calibration_of(options), "mask": mask_of(options)}
        sources = replace(files, start=start, settings=settings, **more)
        registration = make_registration(open_scene(sources))
    if files.scene is not None and given.get("object"):
        registration = registration[options.object]
    for note in () if options.quiet else registration.notes:
        tell(f"note: {table.in_options(note, table.SCENE)}")
    return registration


def _start_of(options: Namespace, auto: AutoStart) -> Path | FindStart:
    """Return a pose file, or a function that finds a start: automatically, or from marks."""
    given = table.values(options, table.STARTS)
    if options.views is None and (options.photo is None or options.model is None):
        raise SettingsError("PHOTO and MODEL are wanted, or a scene file; name them")
    if given["start"] is not None and options.views is None:
        return auto
    table.refuse(
        options,
        (table.BOX, table.INSTANCES, table.FEATURES),
        "without --start auto; leave it out, or add --start auto",
    )
    if options.pose is not None:
        return options.pose
    if options.views is not None:
        raise SettingsError("--views wants a start with --pose: a pose in one of the photos")
    if not any(given.values()):
        wanted = ", ".join(start.flag for start in table.STARTS if start.name in options)
        raise SettingsError(f"a start is wanted: give {wanted}")
    from poseviewer.files.marks import load_pairs, wheels_from_text
    from poseviewer.starts.point_pairs import start_from_pairs
    from poseviewer.starts.wheels import start_from_found_wheels, start_from_wheels

    camera = auto.camera
    if options.pairs is not None:
        return lambda inputs: start_from_pairs(inputs, load_pairs(options.pairs), camera)
    if options.find_wheels is not None:
        return lambda inputs: start_from_found_wheels(inputs, options.find_wheels, camera)
    return lambda inputs: start_from_wheels(inputs, wheels_from_text(options.wheels), camera)
