"""Search for the pose."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import TYPE_CHECKING

from poseviewer.cli import options as table
from poseviewer.cli.case import open_scene
from poseviewer.cli.terminal import progress_bar, require_writable, say
from poseviewer.errors import EXIT_INTERRUPTED, PhotoFileError, PoseFileError

if TYPE_CHECKING:
    from poseviewer.api import Scene
    from poseviewer.fit.progress import FitProgress

_PROJECTIONS = ("perspective", "parallel")
OPTIONS = {
    "": (
        *table.FILES,
        table.option("--out POSE.json", "of a scene: SCENE.json", required=True, is_output=True),
        table.option("--overlay OVERLAY.png", "draw the pose found", is_output=True),
        table.LOOK,
    ),
    "start, one of": (
        table.STARTS,
        table.OBJECT,
        table.BOX,
        table.INSTANCES,
        table.option(
            "--projection", "where no pose file says it", _PROJECTIONS, default=_PROJECTIONS[0]
        ),
        table.FOCAL,
    ),
    **table.SCENE,
    "search": (
        *table.LIMITS,
        *table.METHODS,
        table.option("--lock NAME,...", "parameters of the chart to hold"),
        table.option("--seed SEED"),
        table.KEEP_START,
    ),
}


def run(options: Namespace) -> int:
    """Write the pose found, or the scene, and an overlay, or one for each photo, if wanted."""
    _require_writable(options)
    scene = open_scene(options)
    _require_writable(options)  # now the files that its own name are known
    result = search(scene, options.quiet).whole
    if options.instances:
        result = without_lost(result, options.instances)
    result.save(options.out)
    say(f"{'scene' if result.index is None else 'pose'}: {options.out}")
    for path in result.draw(options.overlay, options.look) if options.overlay else ():
        say(f"overlay: {path}")
    return EXIT_INTERRUPTED if result.stopped else 0


def without_lost(scene: Scene, wanted: int) -> Scene:
    """Hide lost instances beside others, which are no instances; say how many are left."""
    words = [end.verdict.label if end.verdict else "" for end in scene.placings.values()]
    lost = [index for index, word in zip(scene.placings, words, strict=True) if word == "lost"]
    data = scene.data
    for index in lost if len(lost) < len(words) else ():
        data = data.with_object(index, hidden=True)
    if len(words) - len(lost) < wanted:
        say(f"{len(words) - len(lost)} of {wanted} instances are found or doubtful")
    return replace(scene, data=data)


def _require_writable(options: Namespace) -> None:
    require_writable(options.out, PoseFileError)
    if options.overlay:
        require_writable(options.overlay, PhotoFileError)


def search(scene: Scene, quiet: bool) -> Scene:
    """Fit to the end, or to Ctrl-C, which keeps the best pose so far; print how it ended."""
    from poseviewer.render.pool import processors

    with progress_bar(None, quiet) as bar:

        def watch(progress: FitProgress) -> None:
            text = f"restart {progress.restart}, {progress.loss_text}"
            bar.set_description_str(text, refresh=False)
            bar.update()

        result = scene.fit(watch=watch, threads=processors(), interruptible=True)
    shares = result.visibility.shares if len(result.objects) > 1 else ()
    for index, each in enumerate(result.objects):
        if result.index not in (None, index):
            continue
        if len(shares):
            say(f"{each.label} (seen to {shares[index]:.0%})")
        if index in result.placings:
            _print_end(result[each.id])
        else:
            say("Not searched for: it stands wholly behind others; its pose is as it was.")
    return result


def _print_end(scene: Scene) -> None:
    """Print how the search for an object ended."""
    progress, verdict = scene.progress, scene.verdict
    assert progress is not None  # it was searched for
    say(
        f"{progress.status.value}\n"
        f"{progress.loss_text} (start {progress.scale.shown(progress.start_loss):.3f})\n"
        f"{progress.evaluations} evaluations, {progress.restart} restarts, {progress.seconds:.1f} s"
    )
    if len(scene.views) > 1:
        for view in scene.view_results:
            word = "" if view.verdict is None else f", {view.verdict.label} by it alone"
            share = "" if view.seen is None else f", {view.seen:.0%} of the model seen"
            say(f"{view.view.name}: {view.scale.text(view.loss)}{share}{word}")
    else:
        if parts := scene.parts.parts_text:
            say(f"unexplained by part: {parts}")
        if scene.hidden is not None:
            say(
                "something in front was taken to hide a part of the model: "
                f"{scene.seen:.0%} of it is seen, and the rest was left out"
            )
    if scene.data.free_scale:
        scale = 1.0 / scene.object.world_from_model.scale
        say(f"scale: {scale:.6g} lengths of the model's unit in one of the set's")
    if verdict is None:
        return
    say(f"verdict: {verdict.label} ({verdict.share_right})")
    notes = () if scene.object.result is None else scene.object.result.notes
    for reason in (*verdict.reasons, *notes):
        say(f"  {reason}")
    if scene.covariance is not None:
        say(f"how sure, as standard deviations: {scene.covariance.words(scene.mesh.unit)}")
