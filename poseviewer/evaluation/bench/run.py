"""One run of the benchmark: every figure in it is from the same machine and the same minutes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter

from poseviewer.evaluation.bench.case import Case, Demo, load_demo, make_model, place
from poseviewer.evaluation.bench.machine import machine, versions
from poseviewer.evaluation.bench.paths import make_paths
from poseviewer.evaluation.bench.scaling import ScalingPlan, ScalingRow, measure_scaling
from poseviewer.evaluation.bench.searches import (
    FitTime,
    MapsTime,
    time_first_maps,
    time_fit,
    time_maps,
)
from poseviewer.evaluation.bench.timing import Row, measure
from poseviewer.render.many import processors
from poseviewer.render.opengl import opengl_unavailable_reason

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
    rounds_limit_s: float = 20.0
    """Of each case; three rounds are made in any case."""
    fit_limit_s: float = 60.0
    plain_fit_limit_s: float = 120.0
    map_size: int | None = 41
    """None: the first sheet is all."""
    maps_limit_s: float = 60.0
    scaling: ScalingPlan | None = field(default_factory=ScalingPlan)
    limit_s: float = 500.0
    """From the run's begin; after it no further point of the scaling is begun."""


QUICK = Plan(
    triangles=(MAIN_TRIANGLES,),
    sizes=(MAIN_SIZE,),
    rounds=6,
    rounds_limit_s=4.0,
    fit_limit_s=4.0,
    plain_fit_limit_s=3.0,
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
    rows, main = _measure_cases(demo, plan, letters, tell)
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


def _measure_cases(demo: Demo, plan: Plan, letters: str, tell: Tell) -> tuple[list[Row], Case]:
    """The rows of all cases, and the main case, or the one that stands for it in a short plan."""
    rows: list[Row] = []
    cases: dict[tuple[int, Size], Case] = {}
    for triangles in plan.triangles:
        tell(f"making a model of {triangles:,} triangles")
        model = make_model(demo, triangles)
        for size in plan.sizes:
            tell(f"timing the paths: {triangles:,} triangles, {size[0]}x{size[1]}")
            case = cases[triangles, size] = place(demo, model, *size)
            paths = make_paths(case, letters, processors())
            rows += measure(case, paths, plan.rounds, plan.rounds_limit_s)
            for path in paths:
                path.close()
    return rows, cases.get((MAIN_TRIANGLES, MAIN_SIZE), next(iter(cases.values())))


def _time_all_maps(case: Case, plan: Plan, tell: Tell) -> Sequence[MapsTime]:
    tell("making the first maps")
    found = [time_first_maps(case, processors(), limit_s=plan.maps_limit_s)]
    if plan.map_size:
        tell(f"making maps of {plan.map_size}x{plan.map_size}")
        found.append(time_maps(case, processors(), plan.map_size, limit_s=plan.maps_limit_s))
    return found


def _time_fits(demo: Demo, plan: Plan, letters: str, tell: Tell) -> list[FitTime]:
    fits = []
    for letter, limit in (("d", plan.fit_limit_s), ("a", plan.plain_fit_limit_s)):
        if letter in letters:
            tell(f"searching on path {letter}, for {limit:.0f} s at most")
            fits.append(time_fit(demo, letter, limit))
    return fits
