"""One run of the benchmark: every figure in it is from the same machine and the same minutes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from time import perf_counter

from poseviewer.bench.case import Case, Demo, Model, load_demo, make_model, place
from poseviewer.bench.machine import machine, versions
from poseviewer.bench.paths import make_paths
from poseviewer.bench.scaling import ScalingPlan, ScalingRow, measure_scaling
from poseviewer.bench.searches import (
    FitTime,
    MapsTime,
    time_first_maps,
    time_fit,
    time_maps,
    time_method,
)
from poseviewer.bench.timing import Row, measure
from poseviewer.render.opengl.renderer import opengl_unavailable_reason
from poseviewer.render.pool import processors
from poseviewer.render.software.renderer import SoftwareRenderer

Size = tuple[int, int]
Tell = Callable[[str], None]

MAIN_TRIANGLES, MAIN_SIZE = 50_000, (640, 480)
"""The case by which paths are compared, and whose maps are made."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What to measure, and for how long."""

    triangles: tuple[int, ...] = (5_000, 50_000, 500_000)
    sizes: tuple[Size, ...] = ((640, 480), (1920, 1080))
    rounds: int = 12
    rounds_limit_s: float = 15.0
    """Of each case; three rounds are made in any case, unless they take twice as long."""
    fit_limit_s: float = 30.0
    plain_fit_limit_s: float = 90.0
    map_size: int | None = 41
    """None: the first sheet is all."""
    maps_limit_s: float = 30.0
    scaling: ScalingPlan | None = field(default_factory=ScalingPlan)
    limit_s: float = 500.0
    """From the run's begin: after half of it no further case is begun, and after all of it no
    further point of the scaling; what is left out is said."""


QUICK = Plan(
    triangles=(MAIN_TRIANGLES,),
    sizes=(MAIN_SIZE,),
    rounds=6,
    rounds_limit_s=4.0,
    fit_limit_s=3.0,
    plain_fit_limit_s=2.0,
    map_size=None,
    maps_limit_s=3.0,
    scaling=None,
)
"""The main case alone; searches are cut short where they take longer."""


@dataclass(frozen=True, slots=True)
class Report:
    """All that one run found."""

    machine: dict[str, str | int | float | None]
    versions: dict[str, str | None]
    rows: tuple[Row, ...]
    fits: tuple[FitTime, ...]
    maps: tuple[MapsTime, ...]
    scaling: tuple[ScalingRow, ...]
    notes: tuple[str, ...]
    """What could not be measured, in sentences."""


def run_bench(plan: Plan, tell: Tell) -> Report:
    """Measure what the plan says; ``tell`` hears, before each part, what comes."""
    about = machine(), versions()
    notes = []
    reason = opengl_unavailable_reason()
    if reason:
        notes.append(f"Paths a and b are left out: {reason}")
    letters = "cde" if reason else "abcde"
    began = perf_counter()
    tell("loading the demo")
    demo = load_demo()
    rows, main, left_out = _measure_cases(demo, plan, letters, tell)
    notes += left_out
    maps = _time_all_maps(main, plan, tell)
    fits = _time_fits(demo, plan, letters, tell)
    scaling: list[ScalingRow] = []
    if plan.scaling:
        scaling, missing = measure_scaling(
            demo, plan.scaling, letters, tell, until=began + plan.limit_s
        )
        if missing:
            notes.append(
                f"{missing} of {plan.scaling.points} points of the scaling are left out: the limit "
                f"of {plan.limit_s:g} s was reached; run again on a machine that is less busy."
            )
    return Report(*about, tuple(rows), tuple(fits), tuple(maps), tuple(scaling), tuple(notes))


def _measure_cases(
    demo: Demo, plan: Plan, letters: str, tell: Tell
) -> tuple[list[Row], Case, list[str]]:
    """The rows of all cases; the main case, or the one that stands for it in a short plan; and
    what was left out, in sentences.
    """
    rows: list[Row] = []
    cases: dict[tuple[int, Size], Case] = {}
    left_out: list[str] = []
    models: dict[int, Model] = {}
    until = perf_counter() + 0.5 * plan.limit_s
    for size, triangles in product(plan.sizes, plan.triangles):
        name = f"{triangles:,} triangles, {size[0]}x{size[1]}"
        if cases and perf_counter() > until:
            left_out.append(
                f"{name} is left out: half of the limit of {plan.limit_s:g} s was over."
            )
            continue
        tell(f"timing the paths: {name}")
        if triangles not in models:
            models[triangles] = make_model(demo, triangles)
        case = cases[triangles, size] = place(demo, models[triangles], *size)
        paths = make_paths(case, letters, processors())
        rows += measure(case, paths, plan.rounds, plan.rounds_limit_s)
        for path in paths:
            path.close()
    return rows, cases.get((MAIN_TRIANGLES, MAIN_SIZE), next(iter(cases.values()))), left_out


def _time_all_maps(case: Case, plan: Plan, tell: Tell) -> Sequence[MapsTime]:
    tell("making the first maps")
    found = [time_first_maps(case, processors(), limit_s=plan.maps_limit_s)]
    if plan.map_size:
        tell(f"making maps of {plan.map_size}x{plan.map_size}")
        found.append(time_maps(case, processors(), plan.map_size, limit_s=plan.maps_limit_s))
    return found


def _time_fits(demo: Demo, plan: Plan, letters: str, tell: Tell) -> list[FitTime]:
    fits = []
    limits = {"d": plan.fit_limit_s, "e": plan.fit_limit_s, "a": plan.plain_fit_limit_s}
    for letter, limit in limits.items():
        if letter in letters:
            tell(f"searching on path {letter}, for {limit:.0f} s at most")
            fits.append(time_fit(demo, letter, limit))
    tell(f"fitting by both methods, for {plan.fit_limit_s:.0f} s at most each")
    renderer = SoftwareRenderer(demo.registration.mesh)
    fits.append(time_method(demo, renderer, "default", processors(), plan.fit_limit_s))
    fits.append(time_method(demo, renderer, "paper", 1, plan.fit_limit_s))  # it knows no threads
    return fits
