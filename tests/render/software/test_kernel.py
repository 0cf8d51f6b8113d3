"""Machine code of kernels: where it cannot be kept, when it is old, and who compiles it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import poseviewer
from poseviewer.render.software.kernel import kernels_folder

COUNT = """
from poseviewer.render.software.rasterise import _span
from poseviewer.render.software.compiled import kernels_are_compiled
print(*_span(0, 5, -3, 2), kernels_are_compiled())
print(sum(_span.stats.cache_hits.values()), sum(_span.stats.cache_misses.values()))
"""
COMPILED, LOADED = "0 1", "1 0"


@pytest.mark.slow
def test_kernels_run_where_nothing_can_be_kept(tmp_path: Path):
    """A file stands where the folder would be: another one is made, and goes with the process."""
    home, temporary = tmp_path / "home", tmp_path / "temporary"
    home.write_text("")
    temporary.mkdir()
    package = str(Path(poseviewer.__file__).parents[1])
    settings = {"HOME": str(home), "XDG_CACHE_HOME": str(home), "PYTHONPATH": package}
    assert _run(COUNT, tmp_path, **settings, TMPDIR=str(temporary)) == ["2 5 False", COMPILED]
    assert not list(temporary.iterdir())


def test_that_machine_code_cannot_be_kept_is_said(tmp_path: Path, monkeypatch, caplog):
    (tmp_path / "a file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "a file"))
    assert kernels_folder.__wrapped__().is_dir()
    (said,) = caplog.messages
    assert said.startswith(f"{tmp_path / 'a file'}: cannot be written to (Not a directory)")
    assert "compiled anew at each call" in said


@pytest.mark.slow
@pytest.mark.long
def test_a_copy_of_the_package_is_not_compiled_again_until_any_kernel_changes(tmp_path: Path):
    """The times of its files do not matter. Machine code contains that of the kernels it calls,
    whose files numba does not look at.
    """
    package, home = _copy_of_the_package(tmp_path / "one"), {"XDG_CACHE_HOME": str(tmp_path)}
    assert _run(COUNT, tmp_path / "one", **home)[1] == COMPILED
    copy = tmp_path / "other" / "poseviewer"
    shutil.copytree(package, copy)
    for source in copy.rglob("*.py"):
        os.utime(source, (0, 0))
    assert _run(COUNT, tmp_path / "other", **home)[1] == LOADED
    kernels = copy / "render" / "software" / "sums.py"
    kernels.write_text(kernels.read_text() + "# One more line.\n")
    os.utime(kernels, (0, 0))
    assert _run(COUNT, tmp_path / "other", **home)[1] == COMPILED
    chosen = {"NUMBA_CACHE_DIR": str(tmp_path / "chosen")}
    assert _run(COUNT, tmp_path / "other", **home, **chosen)[1] == COMPILED
    assert any((tmp_path / "chosen").rglob("*.nbc"))


EVALUATE = """
from poseviewer.files.demo import demo_case
from poseviewer import load
from poseviewer.render.software import compiled, rasterise, shade, sums
def types_of(kernels):
    return [kernel.signatures[:] for kernel in kernels]
print(compiled.kernels_are_compiled())
compiled.compile_drawing()
compiled.compile_sums()
kernels = rasterise.rasterise, shade.shade, sums.moments, sums.structure_sums
ahead = types_of(kernels)
files = demo_case()
case = load(files.photo, files.model, files.start)
case.loss
load(files.photo, files.model, files.start, pixels="clip", grey=True).loss
case.renderer.render(case.pose)
print(all(ahead), types_of(kernels) == ahead)
print(*(sum(kernel.stats.cache_misses.values()) for kernel in kernels))
"""


@pytest.mark.slow
@pytest.mark.long
def test_what_is_compiled_ahead_is_what_evaluations_need(tmp_path: Path):
    """With the arguments' types that they come with; the tests' session has compiled them."""
    package = str(Path(poseviewer.__file__).parents[1])
    found = _run(EVALUATE, tmp_path, PYTHONPATH=package)
    assert found == ["True", "True True", "0 0 0 0"]


def _copy_of_the_package(folder: Path) -> Path:
    package = folder / "poseviewer"
    ignored = shutil.ignore_patterns("__pycache__", "demo_files")
    shutil.copytree(Path(poseviewer.__file__).parent, package, ignore=ignored)
    return package


def _run(script: str, folder: Path, **settings: str) -> list[str]:
    """The lines that a script prints, in an environment of its own."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA", "XDG"))}
    found = subprocess.run(
        [sys.executable, "-c", script],
        env=inherited | {"PYTHONPATH": str(folder)} | settings,
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert found.returncode == 0, found.stderr
    return found.stdout.splitlines()
