"""Coarse to fine: the levels of the photo that a search goes through, and how it searches each.

Most of a search is spent on finding the right valley, and a coarse level shows the same valleys:
its minimum lies within one of its pixels of the full photo's. So the wide part of the search runs
where an evaluation costs a fraction. Where all poses are judged on the same pixels that part is an
evolving cloud; a second, smaller one goes on upon the full photo, and quadratic models of the loss
end the search, if there is one on a still finer photo. Where each is judged on the pixels that it
covers, scouts and a restarted simplex are the wide part, and a simplex of the size of the level's
pixels is left to go downhill on the full photo, until restarts no longer improve it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from poseviewer.geometry.camera import Pose
from poseviewer.optimise.cma_es import CmaOptions
from poseviewer.optimise.quadratic import QuadraticOptions
from poseviewer.optimise.restarts import RestartOptions
from poseviewer.render.pyramid.levels import Level, coarsest_level, lighter_level
from poseviewer.render.types import PhotoAttributes, Renderer

FEWEST_PIXELS = 5000
"""The coarsest level still shows the model at the start in so many pixels: 70 along each side.
With a fourth of it the side valleys reach up to the start: on the demo half as many scouts end in
the right one."""
FEWEST_OF_STRUCTURE = 2000
"""The same where classes and edges are compared: they reach farther than shades do. With a fourth
of it the least loss of the demo is 10 per cent away from the truth."""
COARSE_SCOUTS, COARSE_STEP = 1.5, 2.0
"""Scouts cost little on a coarse level: how many times more are sent there, and how much wider."""
COARSE_TOLERANCE = 8.0
"""How many times less exactly a coarse level is searched than the photo itself."""
COARSE_CLOUD = CmaOptions(least_width=0.04)
"""Narrower than this a coarse level tells little: its minimum
is up to 5 per cent beside the photo's, on cars whose paint is not the model's."""
WIDE_CLOUD = replace(COARSE_CLOUD, width=0.2, nearness=1.0)
"""For another search, where the first ones ended in a pose that is not ``found``."""
FINE_CLOUD = CmaOptions(width=0.06, generations=24, least_width=2e-3)
"""On the photo itself, as wide as the coarse one can be wrong, and pulled to where that ended:
without it, one in ten runs away to where the model fills the photo. Along a flat valley, a black
car in front of black, it is still on its way after 16 generations: there 75 per cent of 40
starts found the pose, with 24 it is 97 of 60, and no more with 32."""
FINE_STEP = 0.3
"""Edge of a simplex on the full photo after a coarse search, as a share of the rules' step: a
pixel of the coarsest level, which is 1 to 2 per cent of the model's size, whatever the photo's."""
LAST_STEPS = QuadraticOptions(reach=2.0, rise=0.6)
"""After a cloud, in units of its standard deviations. The loss is a sum of logarithms there, some
40 in all: what gains less than 0.02 moves the model by less than a twentieth of a pixel."""
CLOSER_STEPS = QuadraticOptions(reach=1.0, rise=0.3)
"""On the finer photo, whose least loss is a pixel of the photo away at most; in units of the reach
of the models before."""


PLAIN = 1 / 30
"""What a difference in loss is worth without classes and edges, of one with them: shares of the
variance are added up then, not their logarithms."""


Scope = Literal["near", "usual", "wide"]
"""How far about the start a search with evolving clouds looks: near, it leaves out the first cloud.
"""

On = Literal["a sketch", "the photo", "a finer photo"]
"""What a stage minimises the loss on: a sketch is of fewer pixels or triangles, or something else
is minimised beside; a finer photo has no structure yet."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A part of a search."""

    level: Level
    rules: RestartOptions | CmaOptions | QuadraticOptions
    on: On = "the photo"


def make_stages(
    photo: PhotoAttributes,
    renderer: Renderer,
    start: Pose,
    rules: RestartOptions,
    finer: PhotoAttributes | None = None,
    scope: Scope = "usual",
) -> tuple[Stage, ...]:
    """The stages of a search from ``start``, the last one on the photo itself, or on a ``finer``
    one (without structure). ``scope``: how far to look, where evolving clouds go first.

    With the surroundings compared, side valleys are many: there an evolving cloud goes first, on
    whatever level is the coarsest, a narrower one on the photo follows. Clipped to the model, one
    that covers too few pixels for a coarser level is searched on the photo alone.
    """
    full = Level(1, photo, renderer)
    fewest = FEWEST_PIXELS if photo.structure is None else FEWEST_OF_STRUCTURE
    coarse = coarsest_level(photo, renderer, start, fewest)
    if not photo.clipped:
        lighter = lighter_level(photo, renderer, start)
        first = WIDE_CLOUD if scope == "wide" else COARSE_CLOUD
        second, last = FINE_CLOUD, LAST_STEPS
        if photo.structure is None:
            first, second = (replace(c, nearness=PLAIN * c.nearness) for c in (first, second))
            last = replace(last, rise=PLAIN * last.rise, least_gain=PLAIN * last.least_gain)
        clouds = Stage(coarse, first, "a sketch"), Stage(lighter, second, "a sketch")
        clouds = clouds[1:] if scope == "near" else clouds
        if finer is None:
            return *clouds, Stage(full, last)
        closer = Stage(Level(1, finer, renderer), CLOSER_STEPS, "a finer photo")
        return *clouds, Stage(lighter, LAST_STEPS, "a sketch"), closer
    if coarse.factor == 1:
        return (Stage(full, rules),)
    return Stage(coarse, coarse_rules(rules), "a sketch"), Stage(full, fine_rules(rules))


def coarse_rules(rules: RestartOptions) -> RestartOptions:
    """How to search a coarse level: widely, and less exactly than the photo."""
    return replace(
        rules,
        scouts=round(COARSE_SCOUTS * rules.scouts),
        step=COARSE_STEP * rules.step,
        patience=1,
        x_tolerance=COARSE_TOLERANCE * rules.x_tolerance,
        f_tolerance=COARSE_TOLERANCE * rules.f_tolerance,
        least_gain=COARSE_TOLERANCE * rules.least_gain,
    )


def fine_rules(rules: RestartOptions) -> RestartOptions:
    """How to search the photo from where a coarse level led: at once, and nearby."""
    return replace(rules, scouts=0, step=FINE_STEP * rules.step, patience=1)
