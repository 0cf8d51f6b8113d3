"""Help texts: every option says what it does, its unit and its default; examples are commands."""

import re
import shlex
import subprocess
import sys
from argparse import Action, ArgumentParser, _HelpAction, _SubParsersAction
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

import poseviewer
from poseviewer.cli import main as cli
from poseviewer.evaluation.plan import Plan
from poseviewer.scene.settings import FitSettings, Limits
from tests.commands import run

UNITS = {
    "LEFT,TOP,WIDTH,HEIGHT": "in px",
    "WIDTHxHEIGHT": "in px",
    "PX": "in px",
    "SECONDS": "in s",
    "PERCENT,...": "in %",
    "SHARE": "in shares of",
    "LENGTHS": "units",
    "REAR;FRONT": "angle in degrees",
}
"""Words that tell the unit of a value, by what the usage calls the value."""
NO_VERB = re.compile("(an?|the|of|in|for|at|by|to|with|where|which|what|how|if|whether|it|this) ")


def parser_of(command: str) -> ArgumentParser:
    """The parser of one command with its options."""
    actions = cli.make_parser(command)._actions
    return next(a.choices[command] for a in actions if isinstance(a, _SubParsersAction))


def arguments_of(command: str) -> Iterator[tuple[str, Action]]:
    """Help texts as a user sees them, one space between words, and their arguments."""
    parser = parser_of(command)
    for action in parser._actions:
        if not isinstance(action, _HelpAction):
            text = parser._get_formatter()._expand_help(action) if action.help else ""
            yield " ".join(text.split()), action


def takes_value(action: Action) -> bool:
    return bool(action.option_strings) and action.nargs != 0


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_help_texts_say_what_an_option_does_its_unit_and_its_default(command: str):
    for text, action in arguments_of(command):
        assert len(text.split()) > 2, action
        assert not text.endswith("."), action
        assert UNITS.get(str(action.metavar), "") in text, text
        if action.option_strings:
            assert re.match("[a-z]+ ", text), text
            assert not NO_VERB.match(text), text
        if takes_value(action) and not action.required:
            assert "(default: " in text, text


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_defaults_are_those_of_parser_and_settings(command: str):
    of_command = Plan(out=Path()) if command == "study" else FitSettings()
    owners = Limits(), of_command
    defaults = {f.name: getattr(owner, f.name) for owner in owners for f in fields(owner)}
    checked = 0
    for text, action in arguments_of(command):
        default = defaults.get(action.dest) if action.default is None else action.default
        if takes_value(action) and isinstance(default, str | int | float | tuple) and default:
            values = default if isinstance(default, tuple) else (default,)
            between = "x" if action.metavar == "WIDTHxHEIGHT" else ","
            told = between.join(f"{v:g}" if isinstance(v, float) else str(v) for v in values)
            assert f"(default: {told}" in text, text
            checked += 1
    assert checked or command in {
        "bench", "cameras", "demo", "info", "paint", "render", "track", "undistort",
    }  # fmt: skip


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_two_examples_end_the_help_and_parse(command: str):
    printed = parser_of(command).format_help()
    assert f"usage: poseviewer {command} " in printed
    assert f"\n    {command}" in cli.make_parser(command).format_help()
    examples = [line for line in printed.splitlines() if line.startswith("  poseviewer ")]
    assert printed.endswith("\n".join(("examples:", *examples)) + "\n")
    assert len(set(examples)) == 2
    parsed = [cli.parse(shlex.split(line)[1:]).command for line in examples]
    assert command in parsed
    assert all(len(line) < 100 for line in examples)


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]):
    assert run("--version") == 0
    assert capsys.readouterr().out == f"poseviewer {poseviewer.__version__}\n"


def test_the_version_is_known_without_other_imports():
    code = "import sys, poseviewer; print(poseviewer.__version__, *sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    version, *modules = ended.stdout.split()
    assert version == poseviewer.__version__
    assert not [name for name in modules if name.startswith("poseviewer.")]
    assert not {"numpy", "importlib.metadata"} & set(modules)
