"""The commands that run many fits: studies, tables of photos, several models."""

from __future__ import annotations

import json
from argparse import Namespace
from contextlib import closing

from poseviewer.cli import describe
from poseviewer.cli.commands import _bar, _require_folder, _say_nothing, _settings, _tell
from poseviewer.cli.many_options import scene_rule_of
from poseviewer.errors import EXIT_INTERRUPTED, EXIT_MENDABLE, SettingsError
from poseviewer.files.photo.load import load_mask
from poseviewer.files.writing import write_whole
from poseviewer.fit.problem import FitProgress
from poseviewer.render.pool import processors
from poseviewer.starts.registration import load_registration


def study(options: Namespace) -> int:
    """Measure from how far off fits find the pose; print the table."""
    from poseviewer.study.plan import read_plan
    from poseviewer.study.run import open_study, write_report

    plan = read_plan(options)
    tell = _say_nothing if options.quiet else _tell
    try:
        run = open_study(plan, tell)
        with _bar(len(run.left), options.quiet) as bar:
            for _ in run.trials(options.jobs or processors()):
                bar.update()
    except KeyboardInterrupt:
        _tell("poseviewer: stopped; what is done is kept: run the same again to go on.")
        return EXIT_INTERRUPTED
    print(write_report(run).as_text())
    print(f"\nrows, summary: {run.out}")
    return 0


def batch(options: Namespace) -> int:
    """Fit the rows of a table; write a pose and a picture for each, a table and a report."""
    from poseviewer.batch.results import REPORT, TABLE
    from poseviewer.batch.run import open_batch, run_batch, save_outcome

    rule = scene_rule_of(options)
    opened = open_batch(options.jobs, options.out, _settings(options), options.mask, rule)
    if opened.done and not options.quiet:
        _tell(f"{len(opened.done)} of {len(opened.jobs)} rows were done before.")
    fresh, stopped = [], False
    results = run_batch(opened, scheduler=options.scheduler, processes=options.processes)
    with closing(results), _bar(len(opened.to_do), options.quiet) as bar:
        try:
            for result in results:
                fresh.append(result)
                bar.update()
        except KeyboardInterrupt:
            stopped = True
    known = save_outcome(opened, fresh)
    print(describe.batch_result(len(opened.jobs), [result.failed for result in known], stopped))
    print(f"table: {options.out / TABLE}\nreport: {options.out / REPORT}")
    if opened.manifest.scene is not None:
        print(f"BOP scene: {options.out}")
    if stopped:
        return EXIT_INTERRUPTED
    return EXIT_MENDABLE if any(result.failed for result in known) else 0


def review(options: Namespace) -> int:
    """Serve the app on what a batch left, until it is interrupted."""
    from poseviewer.app.serving import serve_review

    serve_review(
        options.folder,
        host=options.host,
        port=options.port,
        browser=not options.no_browser,
        tell=lambda line: print(line, flush=True),
    )
    return 0


def identify(options: Namespace) -> int:
    """Fit several models to one photo; print which explains it best."""
    from poseviewer.confidence.identify import identify as identify_models

    if options.json:
        _require_folder(options.json, SettingsError)
    settings = _settings(options)
    opened = [load_registration(options.photo, model, options.start) for model in options.models]
    photo = opened[0].photo
    mask = load_mask(options.mask, photo.width, photo.height) if options.mask else None
    if not options.quiet:
        for warning in dict.fromkeys(text for one in opened for text in one.warnings):
            _tell(f"note: {warning}")
    with _bar(None, options.quiet) as bar:

        def watch(name: str, progress: FitProgress) -> None:
            bar.set_description_str(f"{name}, loss {progress.loss:.5f}", refresh=False)
            bar.update()

        ranked = identify_models(opened, settings, mask, watch)
    print(describe.ranking(ranked))
    if options.json:
        text = json.dumps(describe.ranking_as_json(ranked), indent=2, allow_nan=False)
        write_whole(options.json, (text + "\n").encode(), SettingsError)
        print(f"json: {options.json}")
    return 0
