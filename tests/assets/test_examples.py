"""The short scripts of the library's page run, and do what they say."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.scene import make_scene
from tests.view_sets import write_views

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "assets" / "examples"
ONE = ("p.png", "m.ply", "start.json")
OWN = "fit p.png m.ply --pose start.json --loss correlation --pixels whole --out o.json"


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "arguments", "words", "files"),
    [
        ("one_photo", ONE, "\nfound\n", ("pose.json", "outline.png", "residual.png")),
        ("several_photos", ("set.json", *ONE[1:]), "all photos: found\n", ("result.b.png",)),
        ("batch", ("jobs.csv", "results"), "\np.png found 0.0", ("results/report.html",)),
        ("own_landscape", ("p.png", "m.ply", "true.json"), "", ("default.png", "mean.png")),
        ("own_minimiser", ONE, "unexplained 0.01", ()),
        ("own_loss", (*OWN.split(), "--quiet"), "\nloss 0.0", ("o.json",)),
    ],
)
def test_an_example_runs_on_files_of_the_user(tmp_path: Path, name, arguments, words, files):
    if name == "several_photos":
        write_views(tmp_path)
    else:
        make_scene(tmp_path)
    (tmp_path / "jobs.csv").write_text("photo,model,start\n" + ",".join(ONE) + "\n")
    script = [sys.executable, "-W", "error", EXAMPLES / f"{name}.py", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    end = subprocess.run(
        script, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (end.returncode, end.stderr) == (0, "")
    assert words in end.stdout
    for file in files:
        assert (tmp_path / file).stat().st_size > 500


def test_the_page_of_the_library_links_every_example():
    page = (ROOT / "assets" / "docs" / "library.md").read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        assert f"(../examples/{path.name})" in page
