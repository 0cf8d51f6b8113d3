"""Search for the pose of a model in a photo, in several photos, or of all objects of a scene."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import load_named
from poseviewer.cli.terminal import progress_bar, require_writable, say
from poseviewer.errors import EXIT_INTERRUPTED, PhotoFileError, PoseFileError

if TYPE_CHECKING:
    from poseviewer.api import FitResult, Registration
    from poseviewer.fit.progress import FitProgress

_PROJECTIONS = ("perspective", "parallel")
OPTIONS = {
    "": (
        *table.FILES,
        table.option("--out POSE.json", "write pose or scene here", required=True, is_output=True),
        table.option(
            "--overlay OVERLAY.png", "draw the result here (default: none)", is_output=True
        ),
        table.LOOK,
    ),
    "start": (
        table.STARTS,
        table.OBJECT,
        table.BOX,
        table.INSTANCES,
        table.FEATURES,
        table.option(
            "--projection",
            "set the projection if no pose file does (default: perspective)",
            _PROJECTIONS,
            default=_PROJECTIONS[0],
        ),
        table.FOCAL,
    ),
    **table.SCENE,
    "search": (
        *table.LIMITS,
        *table.METHODS,
        table.option("--lock NAME,...", "keep these pose parameters at the start (default: none)"),
        table.option("--seed SEED", "seed the random numbers (default: 0)"),
        table.KEEP_START,
    ),
}
EXAMPLES = (
    "poseviewer fit photo.jpg car.glb --pose start.json --out pose.json",
    "poseviewer fit photo.jpg can.ply --start auto --box 310,120,90,160 --out pose.json",
)


def run(options: Namespace) -> int:
    """Write the pose or the scene, and an overlay of each photo if wanted."""
    _require_writable(options)
    registration = load_named(options)
    _require_writable(options)  # again: the scene's files are known now
    result = search(registration, options.quiet).whole
    if options.instances:
        result = without_lost(result, options.instances)
    result.save(options.out)
    say(f"{'scene' if result.object_index is None else 'pose'}: {options.out}")
    for path in result.draw(options.overlay, options.look) if options.overlay else ():
        say(f"overlay: {path}")
    return EXIT_INTERRUPTED if result.stopped else 0


def without_lost(result: FitResult, wanted: int) -> FitResult:
    """Hide lost instances unless all are lost; print how many are left."""
    ends, scene = result.progress_by_object, result.scene
    lost = [i for i, end in ends.items() if end.verdict and end.verdict.label == "lost"]
    for object_index in lost if len(lost) < len(ends) else ():
        scene = scene.with_object(object_index, hidden=True)
    if len(ends) - len(lost) < wanted:
        say(f"{len(ends) - len(lost)} of {wanted} instances are found or doubtful")
    return replace(result, scene=scene)


def _require_writable(options: Namespace) -> None:
    require_writable(options.out, PoseFileError)
    if options.overlay:
        require_writable(options.overlay, PhotoFileError)


def search(registration: Registration, quiet: bool) -> FitResult:
    """Search and print the result; Ctrl-C ends the search with the best pose so far."""
    from poseviewer.render.pool import processors

    with progress_bar(None, quiet) as bar:

        def watch(progress: FitProgress) -> None:
            text = f"restart {progress.restart}, {progress.loss_text}"
            bar.set_description_str(text, refresh=False)
            bar.update()

        result = registration.fit(watch=watch, threads=processors(), interruptible=True)
    visible = result.visibility.visible_fractions if len(result.objects) > 1 else ()
    for object_index, each in enumerate(result.objects):
        if object_index not in result.indices:
            continue
        if not each.is_placed:
            continue  # a note says so
        if len(visible):
            say(f"{each.label} (seen to {visible[object_index]:.0%})")
        if object_index in result.progress_by_object:
            _print_end(result[each.id])
        else:
            say("Not searched for: it stands wholly behind others; its pose is as it was.")
    return result


def _print_end(result: FitResult) -> None:
    """Print the end of the search for an object."""
    progress, verdict = result.progress, result.verdict
    assert progress is not None  # it was searched for
    say(
        f"{table.in_options(progress.status.value, OPTIONS)}\n"
        f"{progress.loss_text} (start {progress.scale.as_shown(progress.start_loss):.3f})\n"
        f"{progress.evaluations} evaluations, {progress.restart} restarts, {progress.seconds:.1f} s"
    )
    if len(result.views) > 1:
        for view in result.view_results:
            text = f"{view.view.name}: {view.scale.text(view.loss)}"
            if view.visible_fraction is not None:
                text += f", {view.visible_fraction:.0%} of the model seen"
            say(text + (f", {view.verdict.label} by it alone" if view.verdict else ""))
    else:
        if parts := result.parts.parts_text:
            say(f"unexplained by part: {parts}")
        if result.hidden is not None:
            say(
                "something in front was taken to hide a part of the model: "
                f"{result.seen:.0%} of it is seen, and the rest was left out"
            )
    if result.scene.free_scale:
        scale = 1.0 / result.object.world_from_model.scale
        say(f"scale: {scale:.6g} lengths of the model's unit in one of the set's")
    if verdict is None:
        return
    say(f"verdict: {verdict.label} ({verdict.share_right})")
    notes = () if result.object.result is None else result.object.result.notes
    for reason in (*verdict.reasons, *notes):
        say(f"  {reason}")
    if result.covariance is not None:
        say(f"how sure, as standard deviations: {result.covariance.words(result.mesh.unit)}")
