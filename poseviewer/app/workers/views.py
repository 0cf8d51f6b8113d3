"""Fits over the photos of a set, as the app's workers make them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from poseviewer.api import SetCase, SetResult, make_set_case
from poseviewer.app.state.document import Document, SearchEnd
from poseviewer.app.state.photo_set import PhotoSet
from poseviewer.confidence.uncertainty import joint_covariance
from poseviewer.files.pose import PhotoReference
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.render.types import Renderer
from poseviewer.starts.view_set import SetRegistration, is_seen, require_several

if TYPE_CHECKING:  # numba takes a quarter of a second
    pass


def compared_of(document: Document, poses: tuple[Pose, ...]) -> dict[int, Registration]:
    """The photos of a set that are compared and see the model at ``poses``, by their numbers, the
    large one first: each with its own mask and region, started there.
    """
    views, mesh = document.views, document.registration.mesh
    assert views is not None  # who asks has a set
    found = {}
    for index in (views.at, *(i for i in range(len(poses)) if i != views.at)):
        if not views.compared[index] or not is_seen(mesh, poses[index]):
            continue
        own, photo = document.own_of_photos[index], views.views.views[index].photo
        mask = own.mask
        if own.region is not None:
            inside = own.region.mask(photo.height, photo.width)
            mask = Mask.of(inside if mask is None else mask.weights * inside)
        found[index] = replace(document.registration, photo=photo, start=poses[index], mask=mask)
    return found


def set_case_at(
    document: Document, pose: Pose, settings: FitSettings, renderer: Renderer
) -> SetCase:
    """The set that is open, started from ``pose`` in its large photo.

    Raises:
        PoseViewerError: fewer than two of its photos see the model there; the settings do not go
            with them.
    """
    views = document.views
    assert views is not None  # who asks has a set
    scale = views.scale
    if views.starts[views.at] is pose is not document.pose:
        scale = views.start_scale
    found = compared_of(document, views.views.posed(views.at, pose, scale))
    kept = tuple(views.views.views[index] for index in found)
    require_several(views.views, [view.name for view in kept])
    seen = replace(views.views, views=kept)
    placed = SetRegistration(seen, tuple(found.values()), scale, views.free_size, ())
    return make_set_case(placed, replace(settings, region=None), renderer)


def ends_in_set(case: SetCase, progress: FitProgress, views: PhotoSet) -> tuple[SearchEnd, ...]:
    """Where a search has ended, as each photo of the set has it."""
    result = SetResult(case, progress.parameters, progress)
    filed, problem, mesh = result.record, case.whole.problem, case.whole.registration.mesh
    chart = problem.chart
    assert isinstance(chart, ViewChart)  # that of every set
    first = views.index_of(case.whole.registration.photo)
    poses = views.views.posed(first, filed.pose, chart.scale_at(progress.parameters))
    starts = views.views.posed(first, case.whole.registration.start, chart.scale)
    back = starts[first].camera_from_model.inverse()
    alone = {views.index_of(one.case.registration.photo): one for one in result.views}
    judged = () if progress.verdict is None else progress.verdict.views
    ends = []
    for index, (view, pose) in enumerate(zip(views.views.views, poses, strict=True)):
        record = filed
        if index != first:
            photo, sure = view.photo, None
            if filed.covariance is not None:
                turn = starts[index].camera_from_model @ back
                here = replace(chart, camera=view.camera, view_from_reference=turn)
                sure = joint_covariance(problem, mesh, progress.parameters, judged, pose, here)
            named = PhotoReference(photo.name, photo.width, photo.height, photo.sha256)
            record = replace(
                filed, pose=pose, photo=named, undistortion=photo.undistortion, covariance=sure
            )
        one = alone.get(index)
        word = "" if one is None or one.verdict is None else one.verdict.word
        hidden = None if one is None else one.hidden
        ends.append(SearchEnd(record, hidden, word, filed))
    return tuple(ends)
