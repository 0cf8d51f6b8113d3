"""The time line below the photo: frames of a sequence, keys, buttons, and a motion graph; or the
photos of a scene of many views.
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import htpy as h
import numpy as np
from numpy.typing import NDArray

from poseviewer.app.page.controls import as_html, memoize, on_press
from poseviewer.app.page.texts import pace_text
from poseviewer.app.state.document import label_of
from poseviewer.app.state.frame_edits import FrameCommand, view_verdicts
from poseviewer.app.state.session import Session
from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import list_names
from poseviewer.geometry.arrays import FloatArray
from poseviewer.scene.types import Frame, FramePose, SceneObject

STATES = ("off", "found", "placed", "none", "doubtful", "lost")
"""States of an object in a frame: the verdict, or placed by hand, or no pose; the worst last. Off:
the view is not compared.
"""
MAX_SEGMENTS = 2000
"""Parts into which the time line is divided; of several frames in one part, the worst is shown."""
MAX_CURVE_POINTS = 300
"""Frames of the motion graph; of more, some are left out."""
AXIS_COLOURS = "#ff6b6b", "#7ad151", "#5aa9ff"
"""Colours of x, y and z, by which most tools show axes."""
AXES = [(" ", h.b(style=f"color:{c}")[n]) for n, c in zip("xyz", AXIS_COLOURS, strict=True)]
BUTTONS: dict[FrameCommand, tuple[str, str]] = {
    "to start": ("⇤ to start", "Propagate the poses of this frame back to the first one"),
    "to next key": ("to next key", "Propagate the pose of this frame up to the next key"),
    "to end": ("to end ⇥", "Propagate the poses of this frame to the last one"),
    "between keys": ("between keys", "Propagate anew between the keys before and after this frame"),
    "clear between": ("clear between", "Remove what was propagated between these keys"),
    "keep keys": ("keep keys", "Remove all propagated poses of this object"),
    "remove key": ("remove key", "Remove this object's pose in this frame"),
}
"""Text and tooltip of each button."""
STILL = (
    "it stands still ...",
    "Nothing moves but the camera: find where it stood in each frame; then each object is placed "
    "once for all",
)
LEAVE_OUT = "leave out", "Do not compare the chosen object with this photo in the next search"
TAKE_IN = "compare", "Compare the chosen object with this photo again in the next search"
WHOSE = "Whose poses go to start and to end: press to choose all objects, or the picked one alone"


def time_line(session: Session) -> str:
    """HTML of the time line; "" for a still scene of few views."""
    document, scene = session.document, session.document.scene
    count, object_id = len(document.stepped), document.object.id
    if not count:
        return ""
    shown = document.step_index if session.wanted_frame is None else session.wanted_frame
    what = "frame" if scene.frames else "photo"
    box = {"viewBox": f"0 0 {count} 1", "preserveAspectRatio": "none"}
    box |= {"data-slides": str(count), "data-at": str(shown), "data-what": what}
    box |= on_press("frame")
    at = h.path(".pv-here", d=f"M{shown} 0h1v1h-1Z")
    if not scene.frames:
        line = h.svg(".pv-frames", box)[_view_segments(document.object), at]
        texts = f"of {count}", scene.views[shown].name, said_of_view(session, shown)
        said = h.span[h.b[f"photo {shown + 1}"], " ", " · ".join(filter(None, texts))]
        below = h.div[said, *_view_buttons(session, shown)]
        return as_html(h.div(".pv-time")[line, below])
    graph = _motion_graph(session, box) if session.display.motion_graph else None
    line = h.svg(".pv-frames", box)[_segments(scene.frames, object_id), at]
    buttons = [_button(what, *own) for what, own in BUTTONS.items()]
    buttons.append(h.button(on_press("still"), type="button", title=STILL[1])[STILL[0]])
    if len(scene.objects) > 1:
        is_alone = session.display.propagates_alone
        whose = f"of {label_of(document.object)}" if is_alone else "of all objects"
        buttons.insert(0, _button("alone", whose, WHOSE))
    if session.is_propagating:
        buttons = [_button("stop", "Stop (Esc)", "Keep what is propagated, and stop")]
    said = h.span[h.b[f"frame {shown + 1}"], f" of {count}{_frame_text(session, shown)}"]
    progress = h.span(".pv-end")[_progress_text(session)]
    shows_graph = _button("graph", "graph", "Show rotation and translation over the frames")
    below = h.div[said, shows_graph]
    return as_html(h.div(".pv-time")[graph, line, below, h.div[buttons, progress]])


def _button(what: FrameCommand, text: str, tooltip: str) -> h.Element:
    return h.button(on_press("frames", what=what), type="button", title=tooltip)[text]


@lru_cache(maxsize=1)
def frame_times(frames: tuple[Frame, ...]) -> list[float | None]:
    """Time stamps of all frames, s; None: not known."""
    return [frame.time_s for frame in frames]


@lru_cache(maxsize=1)
def _segments(frames: tuple[Frame, ...], object_id: str) -> h.Node:
    """The states of all frames, each a unit wide, and the keys, drawn once."""
    poses = [frame.poses.get(object_id) for frame in frames]
    keys = "".join(f"M{i + 0.5} .5h0" for i, p in enumerate(poses) if p and p.source == "key")
    return _draw_states([(_state(p), bool(p and p.is_stale)) for p in poses], keys)


@lru_cache(maxsize=1)
def _view_segments(item: SceneObject) -> h.Node:
    """Verdicts of many views on an object, drawn once."""
    verdicts, states = view_verdicts(item), list[tuple[str, bool]]()
    for index, own in enumerate(item.in_views):
        verdict = verdicts.get(index)
        known = "none" if verdict is None else verdict.label
        states.append((known if own.is_compared else "off", False))
    return _draw_states(states, "")


def _draw_states(states: Sequence[tuple[str, bool]], keys: str) -> h.Node:
    """States, each a unit wide, and whether they are stale; over them the path of the keys."""
    count = len(states)
    codes = np.array([2 * STATES.index(state) + is_stale for state, is_stale in states])
    parts = np.linspace(0, count, min(count, MAX_SEGMENTS), endpoint=False).astype(int)
    codes = np.maximum.reduceat(codes, parts)
    begins = np.flatnonzero(np.diff(codes, prepend=-1))
    ends = [*parts[begins[1:]].tolist(), count]
    drawn = list[h.Element]()
    for begin, end in zip(begins.tolist(), ends, strict=True):
        left, (state, is_stale) = parts[begin], divmod(int(codes[begin]), 2)
        name = f"pv-{STATES[state]}{' pv-stale' * is_stale}"
        drawn.append(h.path(class_=name, d=f"M{left} 0H{end}V1H{left}Z"))
    whole = h.fragment[drawn, h.path(".pv-halo", d=keys), h.path(".pv-key-at", d=keys)]
    return str(whole)  # markup, which is not escaped again


def _state(pose: FramePose | None) -> str:
    verdict = None if pose is None or pose.result is None else pose.result.verdict
    return "none" if pose is None else "placed" if verdict is None else verdict.label


def _frame_text(session: Session, index: int) -> str:
    """Time stamp, photo and state of a frame."""
    document, frame = session.document, session.document.scene.frames[index]
    pose = frame.poses.get(document.object.id)
    time = "" if frame.time_s is None else f"{frame.time_s:.2f} s"
    state = "no pose"
    if pose is not None:
        verdict = _state(pose)
        state = pose.source + f", {verdict}" * (verdict != "placed") + ", stale" * pose.is_stale
    return "".join(f" · {text}" for text in (time, frame.file.name, state) if text)


def said_of_view(session: Session, index: int) -> str:
    """Say what a photo leaves unexplained, and its own verdict; "": neither is known."""
    verdict = view_verdicts(session.document.object).get(index)
    texts = _loss_of_view(session, index), "" if verdict is None else verdict.label
    return " · ".join(filter(None, texts))


def _loss_of_view(session: Session, index: int) -> str:
    """Say what a photo leaves unexplained at the current pose, or why that is not known."""
    losses, item = session.results.losses, session.document.object
    if not item.in_views[index].is_compared:
        return "not compared"
    if session.is_searching or not item.is_placed or losses is None or not losses.by_view:
        return ""
    is_before = losses.at_pose != session.at_pose or index != session.document.view_index
    if session.document.stepped and is_before:
        return ""  # of the photo before
    result = losses.by_view.get(index)
    return "not seen" if result is None else f"{result.scale.as_shown(result.loss):.3f}"


def _view_buttons(session: Session, index: int) -> list[h.Element]:
    """A button that leaves a view out of the comparison, or takes it in again."""
    is_compared = session.document.object.in_views[index].is_compared
    press = on_press("compare photo", view_index=index, on=not is_compared)
    text, hint = LEAVE_OUT if is_compared else TAKE_IN
    return [h.button(press, type="button", title=hint)[text]]


def _progress_text(session: Session) -> str:
    """Say how far a propagation is, or how it ended; else which keys the model is painted from."""
    progress, painting = session.propagation, session.document.object.painting
    if progress is None:
        return "" if painting is None else f"painted from {list_names(painting.photos, 3)}"
    if session.preparation is not None:
        return "waiting to begin"
    mends = progress.request.key is not None
    if not progress.is_over:
        pace = pace_text(progress.pace)
        return ("mending" if mends else "propagating") + f": {pace}" * bool(pace)
    number = len(progress.frames)
    done = "mended" if mends else "propagated"
    count = "1 frame" if number == 1 else f"{number:,} frames"
    return "; ".join((f"{count} {done}", *progress.notes[-2:]))


def _motion_graph(session: Session, box: Mapping[str, str]) -> h.Node:
    """Rotation and translation over the frames, with their standard deviations."""
    at = h.path(".pv-here", d=f"M{session.document.scene.frame_index + 0.5} 0v1")
    drawn = [h.div(".pv-motion")[head, h.svg(box)[curves, at]] for head, curves in _curves(session)]
    return drawn or h.div["the graph comes with the first pose"]


def _draw_curves(session: Session) -> list[tuple[h.Node, h.Node]]:
    """Heading and curves of rotation, and of translation."""
    unit = session.document.model.unit or "units"
    frames, values, deviations = _measure_motion(session)
    drawn = []
    for name, part in (("rotation, °", slice(0, 3)), (f"translation, {unit}", slice(3, 6))):
        own, spread = values[:, part], deviations[:, part]
        if len(frames):
            low, high = float((own - spread).min()), float((own + spread).max())
            scale = 0.9 / max(high - low, 1e-9)
            middle, half = 0.95 - scale * (own - low), scale * spread
            curves = [*map(_curve, [frames] * 3, middle.T, half.T, AXIS_COLOURS)]
            head = h.span[f"{name}:", AXES], h.span[f"{low:.3g} to {high:.3g}"]
            drawn.append((head, curves))
    return drawn


_curves = memoize(
    lambda s: (s.document.scene.frames, s.document.object.id, s.document.mesh), _draw_curves
)


def _measure_motion(session: Session) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """(n,), (n, 6), (n, 6): frames with poses, these relative to the first key, and deviations, in
    degrees and the model's unit.
    """
    document, object_id = session.document, session.document.object.id
    frames = enumerate(document.scene.frames)
    poses = [(i, frame.poses[object_id]) for i, frame in frames if object_id in frame.poses]
    firsts = [*(p for _, p in poses if p.source == "key"), *(p for _, p in poses[:1])]
    poses = poses[:: max(1, -(-len(poses) // MAX_CURVE_POINTS))]
    values, deviations = np.zeros((2, len(poses), 6))
    before, view = np.zeros(3), document.view
    zero = [view.pose(p.world_from_model) for p in firsts[:1]]
    about = [PoseCovariance(pose, document.mesh.centre, np.eye(6)) for pose in zero]
    for row, (_, pose) in enumerate(poses):
        values[row] = about[0].deviation(view.pose(pose.world_from_model))[:6]
        # Of the equal rotations, a full turn apart, the one nearest to the frame before.
        turn = values[row, :3]
        angle = float(np.linalg.norm(turn)) or 1.0
        turns = round(float((before - turn) @ turn) / (math.tau * angle))
        before = values[row, :3] = turn * (1.0 + turns * math.tau / angle)
        if pose.result is not None and pose.result.covariance is not None:
            deviations[row] = np.sqrt(pose.result.covariance.matrix.diagonal()[:6])
    units = np.repeat([math.degrees(1.0), 1.0], 3)
    return np.array([i for i, _ in poses], np.intp), units * values, units * deviations


def _curve(frames: NDArray[np.intp], middle: FloatArray, half: FloatArray, colour: str) -> h.Node:
    """A curve (n,) with its band of +-``half``, broken where frames have no pose."""
    drawn, gap = list[h.Node](), 1.5 * float(np.median(np.diff(frames))) if len(frames) > 1 else 1.0
    for part in np.split(np.arange(len(frames)), 1 + np.flatnonzero(np.diff(frames) > gap)):
        x, y = frames[part].astype(float) + 0.5, middle[part]
        off = half[part]
        line = _points(x, y)
        band = f"{_points(x, y - off)}L{_points(x[::-1], (y + off)[::-1])[1:]}Z"
        drawn += h.path(fill=colour, d=band), h.path(stroke=colour, d=f"{line}h0")
    return drawn


def _points(x: FloatArray, y: FloatArray) -> str:
    return "M" + "L".join(f"{a:.1f} {b:.3f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
