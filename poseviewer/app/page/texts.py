"""Texts of the page on a session: what is open, what to do next, how search and verdict stand."""

import math
import time

import numpy as np

from poseviewer.app.page.controls import plain
from poseviewer.app.page.result import deviations_of
from poseviewer.app.state import hiding as h
from poseviewer.app.state.document import MARKING, WHEELS, label_of, verdict_of
from poseviewer.app.state.dragging import radius_in_photo
from poseviewer.app.state.marking import pair_errors, pose_beside_wheels
from poseviewer.app.state.objects import symmetry_text
from poseviewer.app.state.results import LossComparison, Pace
from poseviewer.app.state.session import Session
from poseviewer.app.workers.opening import has_demo_model
from poseviewer.app.workers.tasks import LongVideo
from poseviewer.confidence.pose_covariance import short
from poseviewer.errors import percent
from poseviewer.files.mesh.named import missing_textures
from poseviewer.files.mesh.size import size_words
from poseviewer.files.state.session_file import AutosavedSession
from poseviewer.fit.progress import SearchProgress
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.pose_error import pose_error
from poseviewer.losses.loss import LossScale
from poseviewer.starts.point_pairs import fewest_pairs
from poseviewer.starts.wheels import LONGER_FOCALS
from poseviewer.vehicle.wheel_pose import MIN_RIM_POINTS

PROPAGATED_A_SECOND = 3.0
"""Frames through which a pose is propagated in a second, as results.md has it."""
PREPARING = "Preparing the first picture ..."
STOPPED = "Stopped: the best pose so far is shown."
USUAL_HINT = (
    '<span><i class="pv-plain">drag</i> move</span> '
    '<span><i class="pv-shift">shift</i> turn</span> '
    '<span><i class="pv-ctrl">ctrl</i> roll, scale</span> <span><b>wheel</b> zoom</span> '
    "<span><b>right drag</b> pan</span> <span><b>F</b> all</span> "
    "<span><b>space</b> search</span> <span><b>?</b> keys</span>"
)
"""Hint where a drag moves the model; the page's style marks what a drag does with the held keys."""
FRAMES_HINT = " <span><b>← →</b> frames</span> <span><b>↑ ↓</b> keys of the sequence</span>"
PHOTOS_HINT = " <span><b>, .</b> photos</span>"
ENDS = " &nbsp;·&nbsp; Esc: done"
DRAWING_ENDS = f" &nbsp;·&nbsp; <b>alt</b> erase{ENDS}"
TOOL_HINTS = {
    "brush": "<b>Brush:</b> paint over what is in front &nbsp;·&nbsp; <b>wheel</b> its size, "
    f"ctrl + wheel zoom{DRAWING_ENDS}",
    "polygon": "<b>Polygon:</b> click corners about what is in front, or drag around it "
    f"&nbsp;·&nbsp; <b>Enter</b> or double-click closes it{DRAWING_ENDS}",
    "scribble": "<b>Scribble:</b> draw a line along what is in front: all of it is hidden, to its "
    f"edge{DRAWING_ENDS}",
    "part": "<b>Part:</b> press a part of the model that is to be left out &nbsp;·&nbsp; "
    f"2 shows it solid{ENDS}",
    "measure": f"<b>Measure:</b> press two points of models; a third starts anew{ENDS}",
    "region": "drag a rectangle on the photo &nbsp;·&nbsp; Esc: leave it",
    "box": "drag a rectangle about the object: the model goes there, and starting poses will be "
    "proposed &nbsp;·&nbsp; Esc: leave it",
}
"""The line over the photo, by tool."""
PLACE_HINT = (
    "<b>press where the object is</b>: the model goes there &nbsp;·&nbsp; <b>Fit to box</b> "
    "proposes starting poses"
)
TEXTURE_BUTTON = "Missing texture ..."
"""Label of the button that takes it."""
TEXTURE_HINT = (
    "its texture <b>{}</b> is missing, by which it would be found: "
    f'<button type="button" data-presses="{TEXTURE_BUTTON}">Add it ...</button>'
    " &nbsp;·&nbsp; or {}"
)
"""Hint where the model names a picture that is not there."""
SIZE_HINT = (
    "<b>too large or too small?</b> &nbsp;·&nbsp; <b>Fit to box</b> takes the size from a "
    "rectangle &nbsp;·&nbsp; <b>ctrl + drag</b> scales &nbsp;·&nbsp; <b>space</b> search"
)
"""Hint once a press has placed the model, which keeps the size that it had by chance."""
SIZE_STEPS = 3
"""Undo steps after which the usual hint comes back."""
MODEL_HINT = "<b>now open the model of this photo</b>: Open, Model ..."
WHEELS_HINT = (
    "<b>Wheels</b>, at the left: mark the wheels of the model once, and cars are found by them"
)
"""Hint where the model looks like a car, and its wheels are not known."""
LOOKING_HINT = "<b>Looking for the object ...</b> &nbsp;·&nbsp; Esc stops"
PROPOSED_HINT = (
    "<b>the likeliest proposal is fitted ...</b> &nbsp;·&nbsp; or <b>press where the object is</b> "
    "&nbsp;·&nbsp; Esc stops"
)
UNSURE_HINT = "<b>which is it?</b> press a picture at the left, or <b>where the object is</b>"
SEARCHING_HINT = (
    "the best pose so far is shown &nbsp;·&nbsp; <b>space</b> stops the search and keeps it"
)
ASSUMED_HINT = (
    "the focal length is assumed, and the distance with it &nbsp;·&nbsp; before you save: "
    "<b>Find it</b>, at the left"
)
VERDICT_HINTS = {
    "found": "<b>found</b>: <b>S</b> saves &nbsp;·&nbsp; 1 to 5 show it in other ways",
    "doubtful": "<b>doubtful</b>: does the outline lie on the object's edges? 2 and 5 show more "
    "&nbsp;·&nbsp; else <b>drag</b> and search again: <b>space</b>",
    "lost": "<b>lost</b>: <b>drag</b> the model onto the object, <b>shift</b> turns it "
    "&nbsp;·&nbsp; then search again: <b>space</b>",
}
"""Hint by the verdict on a pose that is not saved yet."""
WHEELS_FOCAL = "The focal length is a rough guess by the wheels, and with it the distance"
NOT_FOUND = "Not found by itself: perhaps it is not in this photo. Else "
MARKING_HINT = " &nbsp;·&nbsp; drag a mark, double-click removes it &nbsp;·&nbsp; Esc: end"


def files_text(session: Session) -> str:
    """Say what is open (markdown), and where its colours come from: a grey model may miss files."""
    item = session.document.object
    photo = session.document.photo
    model = item.model
    mesh = item.mesh
    colours = "coloured" if mesh.has_reflectance else "no colours"
    if mesh.textures:
        colours = _count_of(len(mesh.textures), "texture")
    camera = ", calibrated camera" if photo.camera is not None else ""
    return (
        f"**{plain(photo.label)}**  \n{photo.width} x {photo.height} px{camera}  \n"
        f"**{plain(model.name)}**  \n{len(mesh.faces):,} triangles, "
        f"{_count_of(len(mesh.part_names) or 1, 'part')}, {colours}; {symmetry_text(item)}"
    )


def notes_text(session: Session) -> str:
    """Say how the files were read (markdown), and what the model's size and origin mean."""
    sentences = *session.document.scene.notes, f"Model: {size_words(session.document.mesh)}."
    return "**Notes**\n" + "".join(f"\n- {plain(sentence)}" for sentence in sentences)


def _count_of(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count > 1)}"


def hint_of(session: Session) -> str:
    """The line over the photo (HTML): what the next click is for."""
    marks, looks = session.document.marks, session.is_looking
    match session.tool:
        case "wheels" if session.document.model.keypoints is None:
            name = "front" if marks.hubs else "rear"
            what = f"press the middle of the {name} wheel on the model at the right, drag turns it"
        case "wheels":
            wheel, point = divmod(len(marks.rims), MIN_RIM_POINTS)
            if wheel == WHEELS:
                what = "space: search from here"
            else:
                name = ("rear", "front")[wheel]
                what = f"click the {name} wheel's rim: point {point + 1} of {MIN_RIM_POINTS}"
                what = f"looking for the wheels in the photo ... or {what}" if looks else what
        case "pairs":
            number = len(marks.points)
            if marks.waits_for_pixel:
                what = f"pair {number}: click the same point on the photo"
            else:
                what = f"pair {number + 1}: click a point of the model at the right"
        case tool if tool in TOOL_HINTS:
            return TOOL_HINTS[tool]
        case _ if session.is_searching:
            return SEARCHING_HINT
        case _ if looks:
            if session.proposals and session.proposals.starts:
                return PROPOSED_HINT
            return f"{LOOKING_HINT} &nbsp;·&nbsp; {_what_helps(session)}"
        case _ if not session.document.object.is_placed and has_demo_model(session.document):
            return MODEL_HINT
        case _ if _is_not_found(session) or not session.document.object.is_placed:
            return _not_found_hint(session)
        case _ if session.display.style == "residual":
            return ""  # it would lie over the colours' legend
        case _ if is_focal_length_wanted(session):
            return ASSUMED_HINT
        case _ if session.is_unsaved and verdict_of(session.document.object) in VERDICT_HINTS:
            return VERDICT_HINTS[verdict_of(session.document.object)]
        case _:
            usual = USUAL_HINT
            if session.document.stepped:
                usual += FRAMES_HINT if session.document.scene.frames else PHOTOS_HINT
            return SIZE_HINT if _has_first_size(session) else usual
    return f"<b>{what}</b>{MARKING_HINT}"


def _is_not_found(session: Session) -> bool:
    """Whether starts were proposed for the document at hand, and there are none."""
    proposals = session.proposals
    if proposals is None or not proposals.is_over or proposals.starts:
        return False
    return proposals.document is session.document


def _not_found_hint(session: Session) -> str:
    """Say what to do where the active object is not found, or not surely."""
    if session.proposals and session.proposals.starts:
        is_car = _what_helps(session) is WHEELS_HINT
        return f"{UNSURE_HINT} &nbsp;·&nbsp; {WHEELS_HINT}" if is_car else UNSURE_HINT
    return f"{NOT_FOUND * bool(session.proposals)}{_what_helps(session)}"


def _what_helps(session: Session) -> str:
    """Say what helps to find the active object, which depends on its model."""
    document = session.document
    if missing := missing_textures(document.mesh.notes):
        return TEXTURE_HINT.format(plain(missing[0]), PLACE_HINT)
    is_car = pose_beside_wheels(document.mesh, document.pose.camera) is not None
    return WHEELS_HINT if is_car and document.model.keypoints is None else PLACE_HINT


def _has_first_size(session: Session) -> bool:
    """Whether the active object has been placed and never scaled since."""
    document, past = session.document, session.history.past[-SIZE_STEPS:]
    before = [d for d in past if d.object_id == document.object_id and not d.object.is_placed]
    if not before or session.search or document.object.result is not None:
        return False
    sizes = (radius_in_photo(d.pose, d.mesh) for d in (before[-1], document))
    return math.isclose(*sizes, rel_tol=1e-6)


def marks_text(session: Session) -> str:
    """Say what is marked, and how well the pose shows it (markdown)."""
    document = session.document
    marks = document.marks
    fewest = fewest_pairs(document.pose.camera)
    lines = list[str]()
    points = () if session.tool == "wheels" else marks.points
    if points and len(marks.pixels) < fewest:
        lines.append(f"{_count_of(fewest - len(marks.pixels), 'more pair')} needed")
    elif points:
        lines.append("**error per pair**")
        lines += [f"pair {i}: {px:.1f} px" for i, px in enumerate(pair_errors(document), 1)]
    elif session.tool == "pairs":
        lines.append(f"{fewest} pairs give a pose")
    if marks.note and session.tool in MARKING:
        lines.append(plain(marks.note))
    return "  \n".join(lines)


def proposals_text(session: Session) -> str:
    """Say how far the proposals are (markdown)."""
    proposals = session.proposals
    if session.is_proposing and session.preparation is not None:
        return "Waiting to begin."
    if proposals is None:
        return ""
    if not proposals.starts:
        return "" if proposals.is_over else "Looking for the object ... (Esc stops)"
    if not proposals.is_over:
        return "Fitting the likeliest ... (Esc stops)"
    count = len(proposals.starts)
    if proposals.index < 0:
        return f"**{_count_of(count, 'proposal')}**, none of them sure: press the right one"
    others = "press another one, or " if count > 1 else ""
    what = "fitted" if session.search else f"{others}space to search from here"
    return f"**proposal {proposals.index + 1} of {count}**: {what}"


def focal_note(session: Session) -> str:
    """Warn of a focal length that is a guess (markdown); "": it is none."""
    photo, camera = session.document.photo, session.document.pose.camera
    note, guess = photo.focal_note(camera), photo.default_camera()
    if photo.focal_note(guess) and isinstance(camera, Perspective):
        factor = camera.fx / guess.fx
        is_of_wheels = any(math.isclose(factor, longer) for longer in LONGER_FOCALS)
        note = WHEELS_FOCAL if is_of_wheels else note
    return note and f"⚠ {note.partition(':')[0]}."


def is_focal_length_wanted(session: Session) -> bool:
    """Whether a pose that is not saved yet rests on a guess of the focal length."""
    is_right = verdict_of(session.document.object) in ("found", "doubtful")
    return is_right and session.is_unsaved and bool(focal_note(session))


def focal_condition(session: Session) -> str:
    """Condition of all deviations where the focal length is a guess: ``, and if 2,059 px is``."""
    camera = session.document.pose.camera
    if isinstance(camera, Parallel) or not focal_note(session):
        return ""
    return f", and if the assumed focal length of {camera.fx:,.0f} px is right"


def search_text(session: Session) -> str:
    """Say by what the last search went, and how it ended (markdown); "": there is none."""
    search, progress = session.search, session.search_progress
    if search is None or progress is None or session.preparation is not None:
        return ""
    fit, settings = progress.progress, progress.settings
    is_stopped = progress.is_over and fit.status.name == "RUNNING"
    sentence = STOPPED if is_stopped else plain(fit.status.value)
    which = ""
    if session.is_searching and len(search.methods) > 1:
        which = f", {search.methods.index(settings) + 1} of {len(search.methods)} losses"
    if len(search.object_indices) > 1:
        label = label_of(session.document.scene.objects[progress.object_index])
        which += f"  \nOf all objects: **{plain(label)}**"
    steps, again = pace_of_search(progress), _search_again_note(session)
    return f"Loss: {settings.loss_name}{which}  \n{steps}  \n{sentence}{again}"


def pace_of_search(progress: SearchProgress) -> str:
    """Say how far a search is."""
    fit = progress.progress
    return f"{fit.evaluations} evaluations, restart {fit.restart}, {fit.seconds:.1f} s"


def shown_loss(session: Session) -> tuple[LossScale, float, bool] | None:
    """The loss at the pose with its scale, and whether another one will follow at once: that of the
    search that led there, which is in the pose file; else that of the pixels about the pose; None:
    not known.
    """
    losses, item = session.results.losses, session.document.object
    if losses is None or losses.mean is None:
        return None
    scale, result, now = losses.mean.scale, item.result, losses.mean.loss
    is_of_search = result is not None and (result.settings or {}).get("loss") == item.settings.loss
    of_search = result.loss if result is not None and is_of_search else None
    if of_search is not None:
        return scale, of_search, False
    return scale, now, session.is_moving or losses.at_pose != session.at_pose


def loss_text(session: Session) -> str:
    """Say the loss at the pose, or at the best one of the running search; "": not known."""
    losses, progress = session.results.losses, session.own_progress
    if session.is_searching and progress is not None:
        fit = progress.progress
        start = fit.scale.as_shown(fit.start_loss)
        return f"{_as_coarse(fit.loss_text)} (start {start:.3f})"
    known = shown_loss(session)
    if losses is None or known is None or not session.document.object.is_placed:
        return ""
    scale, loss, is_coarse = known
    text, count = scale.text(loss), len(losses.by_view)
    text = _as_coarse(text) if is_coarse else text
    if session.document.scene.has_many_views and session.document.object.result is None:
        return f"{text} at this pose, in this photo"
    return f"{text} at this pose" + (f", mean of {count} photos" if count > 1 else "")


def _search_again_note(session: Session) -> str:
    """Name objects that a focal length, found by another one, has taken the result from."""
    progress = session.search_progress
    if progress is None or not (progress.is_over and progress.settings.free_focal):
        return ""
    names = [
        plain(label_of(item))
        for index, item in enumerate(session.document.scene.objects)
        if index != progress.object_index and item.is_placed and item.result is None
    ]
    what = f"  \nThe focal length holds for all objects: search again for {', '.join(names)}."
    return what if names else ""


def _as_coarse(text: str) -> str:
    """Text of a loss that another one will follow at once: ``unexplained about 0.170``."""
    return text.replace(" ", " about ", 1)


def verdict_text(session: Session) -> str:
    """The verdict on the search that led to the pose, and why (markdown); "": there is none."""
    result = session.document.object.result
    verdict = None if result is None else result.verdict
    if verdict is None:
        return ""
    reasons = "\n".join(
        f"- {plain(reason)}" for reason in (*verdict.reasons, focal_note(session)) if reason
    )
    covariance, sure = session.covariance_in(session.document.view_index), ""
    if covariance is not None:
        unit = session.document.model.unit or "units"
        by_axis = {name: value for name, value in deviations_of(session).items() if name in "XYZ"}
        words = "".join(f"{name} ±{short(value)} {unit}, " for name, value in by_axis.items())
        words = plain(words + covariance.words(unit, without=("depth", "sideways")))
        condition = focal_condition(session)
        sure = f"\n\n**How sure, if right{condition}:** {words} (standard deviations)."
    return f"**Verdict: {verdict.label}.** {verdict.share_right}.{sure}\n\n{reasons}"


def occlusion_text(session: Session) -> str:
    """Say how much of the photo is hidden (markdown); "" where nothing is."""
    mask, occluders = session.document.painted, h.occlusion_pixels(session)
    lines = []
    if mask is not None:
        text = f"**{_hidden_share(mask)}** of the photo is hidden"
        of_all = [session.document.mask_of(kind, all_frames=True) for kind in h.KINDS[:2]]
        if session.document.scene.frames and (of_all := Mask.product([*filter(None, of_all)])):
            text += f", **{_hidden_share(of_all)}** in all frames"
        lines.append(text)
    elif any(h.masks_of(session)):
        lines.append("What is painted counts all the same")
    if occluders is not None:
        share = percent(float(np.mean(occluders)), 1)
        lines.append(f"**{share}** were taken for something in front by the search (violet)")
    return "  \n".join(lines)


def _hidden_share(mask: Mask) -> str:
    return percent(1.0 - float(np.mean(mask.weights)), 1)


def ends_table(comparison: LossComparison | None) -> str:
    """A column for each end, and how far each is from the first (markdown); "": no ends."""
    if comparison is None:
        return ""
    ends, fits = comparison.ends, [end.progress for end in comparison.ends]
    names = [end.settings.loss.capitalize() for end in ends]
    rows = {"": names, "---": ["--:"] * len(ends)}
    for name, end, losses in zip(names, ends, comparison.losses.T, strict=True):
        scale = end.problem.scale
        rows[f"{name}: {scale.name}"] = [f"{scale.as_shown(loss):.3f}" for loss in losses]
    rows |= {
        "seconds": [f"{fit.seconds:.1f}" for fit in fits],
        "evaluations": [f"{fit.evaluations:,}" for fit in fits],
        "restarts": [str(fit.restart) for fit in fits],
        "verdict": ["-" if fit.verdict is None else fit.verdict.label for fit in fits],
    }
    table = "\n".join(f"| {name} | {' | '.join(values)} |" for name, values in rows.items())
    text = f"{table}\n\nEach on the pixels about the start."
    for name, fit in zip(names[1:], fits[1:], strict=True):
        apart = pose_error(fit.problem.mesh, fit.pose, fits[0].pose)
        text += (
            f" {name} ends {apart.reprojection_px:.1f} px from {names[0]} ({apart.percent:.2g} % "
            f"of the model's size in the photo), turned by {apart.rotation_deg:.2g}°."
        )
    return f"{text} Outlines of ends that are not taken are pink."


def pace_text(pace: Pace) -> str:
    """Say how far a work on frames is, how fast, and how long it still takes; "": not begun."""
    total = pace.total
    if not pace.done:
        return ""
    frame = f"frame {max(int(pace.done), 1):,}" + ("" if total is None else f" of {total:,}")
    if pace.done <= pace.begun or not pace.seconds:
        return frame
    rate = (pace.done - pace.begun) / pace.seconds
    left = "" if total is None else f", {duration_text((total - pace.done) / rate)} left"
    return f"{frame}, {rate:{',.0f' if rate >= 10.0 else '.1f'}} a second{left}"


def offer_text(offer: AutosavedSession) -> str:
    """Say what an earlier session left (markdown)."""
    scene, when = offer.scene, time.localtime(offer.saved_at)
    names = " with ".join(map(plain, (offer.photo_name, offer.model_name)))
    counts = {
        f"a sequence of {len(scene.frames):,} frames": len(scene.frames),
        f"{len(scene.views)} photos": len(scene.views) - 1,
        f"{len(scene.objects)} objects": len(scene.objects) - 1,
    }
    parts = [f"**{names}**", *(text for text, count in counts.items() if count > 0)]
    said = ", ".join([*parts, time.strftime("%d %B %Y, %H:%M", when)])
    return f"An earlier session ended without saving: {said}"


def every_text(video: LongVideo, every: int) -> str:
    """Say how many frames of a video every N-th is, and how long they take (markdown)."""
    count = -(-video.frames // every)
    one = "1 frame" if count == 1 else f"{count:,} frames"
    reading, tracking = video.seconds, count / PROPAGATED_A_SECOND
    return (
        f"**{plain(video.name)}** has {video.frames:,} frames.  \n"
        f"**{one}**: about {duration_text(reading)} to read, and {duration_text(tracking)} to "
        f"propagate a pose through ({PROPAGATED_A_SECOND:g} a second on two cores)."
    )


def duration_text(seconds: float) -> str:
    """Say a time in the unit that people would."""
    if seconds < 60.0:
        return f"{max(math.ceil(seconds), 1)} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
