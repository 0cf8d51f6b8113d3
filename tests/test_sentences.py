"""Sentences for users: each names a setting as the place where it is read does."""

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from importlib import import_module
from inspect import signature
from pathlib import Path

import pytest

import poseviewer
from poseviewer.app.page.controls import FIELDS, WAYS, on_page
from poseviewer.cli.main import COMMANDS
from poseviewer.cli.options import each, in_options
from poseviewer.files.cameras import Calibration
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.masks import MaskFile
from poseviewer.fit.progress import Status
from poseviewer.opening.photo_sets import SetChoice
from poseviewer.opening.sources import Sources
from poseviewer.scene.settings import CHOICES, FitSettings, Limits
from poseviewer.still.still_cameras import find_cameras

PACKAGE = Path(poseviewer.__file__).parent
COMPUTED = {*CHOICES, "image", "object_id", "photo", "model"}
"""Settings whose names are computed where a sentence names them."""
SETTING_BEGINS = re.compile(r"`(?:\w+\.)?(\w+)(?=[`=])")
"""As ``errors.SETTING``; its value may be computed."""
OPTIONS = {name: import_module(f"poseviewer.cli.{name}_command").OPTIONS for name in COMMANDS}


def literals() -> Iterator[str]:
    """Yield the strings of the package outside of its command line, but for docstrings."""
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] != "cli":
            nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
            docs = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
            for node in nodes:
                text = getattr(node, "value", None)
                if isinstance(text, str) and id(node) not in docs:
                    yield text


def settings_named() -> set[str]:
    """Names of all settings in sentences of the package."""
    texts = [text for text in literals() if "``" not in text]
    return {name for text in texts for name in SETTING_BEGINS.findall(text)} | COMPUTED


def test_no_sentence_outside_of_the_command_line_names_an_option():
    assert not [text for text in literals() if re.search(r"(?<![\w-])(?<!var\()--[a-z]", text)]


def test_each_setting_in_a_sentence_has_a_word_in_the_library_on_the_line_and_on_the_page():
    named = settings_named()
    assert len(named) > 20
    of = (FitSettings, Limits, ConvertOptions, Calibration, MaskFile, SetChoice, Sources)
    in_library = {field.name for one in of for field in fields(one)}
    in_library |= signature(find_cameras).parameters.keys()
    on_line = {option.name for own in OPTIONS.values() for group in own.values()
               for option in each(group) if option.flag.startswith("--")}  # fmt: skip
    assert named <= in_library
    assert named <= on_line
    assert named == FIELDS.keys() | WAYS.keys()


def test_each_label_in_a_sentence_is_that_of_a_field():
    """A label is written where its field is made, and where sentences name it."""
    texts = list(literals())
    for name, label in FIELDS.items():
        assert texts.count(label) > 1, name


@pytest.mark.parametrize(
    ("sentence", "command", "line", "page"),
    [
        ('or use `chart="free-body"`', "fit", "or use --chart free-body",
         'or use "Parameters: free-body"'),
        ("choose it with `image` (a, b)", "convert", "choose it with --image NAME|NUMBER (a, b)",
         "choose it with poseviewer convert (a, b)"),
        ("choose one with `Calibration.camera`", "fit",
         "choose one with --calibration-camera NAME", "choose one with a file of it alone"),
        (Status.SECONDS_SPENT.value.split(", ")[1], "fit", "or raise --seconds SECONDS.",
         'or raise "Time limit (s)".'),
    ],
)  # fmt: skip
def test_a_sentence_has_the_words_of_its_place(sentence, command, line, page):
    assert in_options(sentence, OPTIONS[command]) == line
    assert on_page(sentence) == page


@pytest.mark.parametrize("name", ["a--b.png", "seed.png", "50%.jpg", "`b`.png", "``", "chart=x"])
def test_what_is_no_setting_stays(name):
    for said in (on_page(f"{name}: no photo"), in_options(f"{name}: no photo", OPTIONS["fit"])):
        assert said == f"{name}: no photo"


def test_a_setting_that_a_command_does_not_have_is_named_as_in_the_library():
    assert in_options("use `scale`", OPTIONS["convert"]) == "use `scale`"
