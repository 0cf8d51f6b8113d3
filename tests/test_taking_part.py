"""What others need to take part is there, and says what is: CI, forms, hooks, the guide."""

import os
import re
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

import poseviewer

ROOT = Path(__file__).resolve().parent.parent
GITHUB = ROOT / ".github"
GUIDE = GITHUB / "CONTRIBUTING.md"


def read(*names: str) -> str:
    return ROOT.joinpath(*names).read_text(encoding="utf-8")


def workflow(name: str) -> dict[Any, Any]:
    """A workflow; YAML reads its key ``on`` as true."""
    return yaml.safe_load(read(".github", "workflows", f"{name}.yml"))


def steps_of(job: dict[str, Any]) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


def test_ci_runs_the_test_command_of_the_readme_and_the_linters():
    (command,) = [line for line in read("README.md").splitlines() if line.endswith("/pytest")]
    lines = read(".ci", "run").splitlines()
    assert command in lines
    for tool in (
        'pytest -m "slow and not long"',
        "ruff check .",
        "ruff format --check .",
        "pyright",
    ):
        assert lines.index(f".venv/bin/{tool}") > lines.index(command)


@pytest.mark.parametrize("name", ["run", "night", "packages"])
def test_scripts_of_ci_are_programs(name: str):
    script = ROOT / ".ci" / name
    assert os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", script], check=True)


def test_random_tests_stop_no_change():
    assert "tests.measure" not in read(".ci", "run")
    for tool in ("fuzz", "drive"):
        assert f"-m tests.measure.{tool} " in read(".ci", "night")
    (job,) = workflow("night")["jobs"].values()
    assert steps_of(job) == [".ci/night"]
    assert set(workflow("night")[True]) == {"schedule", "workflow_dispatch"}


def test_the_workflow_is_what_ci_does_on_the_oldest_and_a_newer_python():
    (job,) = workflow("test")["jobs"].values()
    assert steps_of(job) == [".ci/run"]
    assert {"push", "pull_request"} <= set(workflow("test")[True])
    versions = job["strategy"]["matrix"]["python"]
    assert "${{ matrix.python }}" in job["container"]
    assert f'requires-python = ">={versions[0]}"' in read("pyproject.toml")
    assert "3.13" in versions


def test_hooks_are_local_and_those_of_ci():
    hooks = yaml.safe_load(read(".pre-commit-config.yaml"))["repos"]
    assert [entry["repo"] for entry in hooks] == ["local"]
    commands = [hook["entry"].split()[:2] for hook in hooks[0]["hooks"]]
    assert commands == [[".venv/bin/ruff", "check"], [".venv/bin/ruff", "format"]]


def test_programs_and_files_of_the_guide_are_there():
    text = GUIDE.read_text(encoding="utf-8")
    modules = set(re.findall(r"\b((?:assets|tests)\.\w+(?:\.\w+)+)\b", text))
    assert len(modules) > 5
    assert not [name for name in modules if find_spec(name) is None]
    named = set(re.findall(r"[ `]((?:\.ci|assets|poseviewer|tests)/[\w./]+)", text))
    assert len(named) > 5
    assert not [name for name in named if not (ROOT / name).exists()]


def test_the_version_is_told_once():
    assert f"\nversion: {poseviewer.__version__}\n" in read("poseviewer", "CITATION.cff")
    release = poseviewer.__version__.partition(".dev")[0]
    assert f"\n## Version {release}" in read("assets", "docs", "changes.md")
    assert 'dynamic = ["version"]' in read("pyproject.toml")
