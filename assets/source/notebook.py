"""``assets/docs/library.ipynb``: poseviewer as a library, executed.

Run from the repository's root: ``python -m assets.source.notebook`` (``pip install -e '.[dev]'``).
The cells are here; the outputs are what a Jupyter kernel gives for them.
"""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).resolve().parent.parent / "docs" / "library.ipynb"
WORDS, CODE = "markdown", "code"
CELLS: tuple[tuple[str, str], ...] = (
    (
        WORDS,
        """# poseviewer as a library

Fit the bundled demo, judge the pose, and draw its loss landscape. Every name used here is in the
[API reference](api.md). Run it where poseviewer and Jupyter are installed.""",
    ),
    (
        CODE,
        """from PIL import Image

import poseviewer
from poseviewer.files.demo import demo_case

demo = demo_case()
case = poseviewer.load(demo.photo, demo.model, demo.start)
print(case.registration.photo.label, "and", case.registration.mesh_name)
print("chart:", ", ".join(case.problem.chart.names))""",
    ),
    (
        WORDS,
        """`load` takes a photo, a model and a start pose, as files. The start is a pose like any
other: it leaves a share of the photo unexplained, from 0 to 1, and it can be drawn.""",
    ),
    (
        CODE,
        """print(f"unexplained at the start: {case.start.unexplained:.3f}")
Image.fromarray(case.start.picture()).resize((480, 360))""",
    ),
    (
        WORDS,
        "`fit` searches to its end, or to a limit. A function can watch; what it raises ends it.",
    ),
    (
        CODE,
        """losses = []
found = case.fit(evaluations=1500, watch=lambda progress: losses.append(progress.loss))
print(found.status)
print(f"unexplained {found.unexplained:.3f} after {len(losses)} evaluations")
print(found.pose.camera_from_model.translation.round(2))""",
    ),
    (
        CODE,
        """Image.fromarray(found.picture("residual")).resize((480, 360))""",
    ),
    (
        WORDS,
        """What the light that was found leaves unexplained: reflections and the mirror's shadow,
but no edge of a model that lies beside its place.

The map of the loss about the pose says how well each pair of parameters is determined: a round
valley well, a long one badly.""",
    ),
    (
        CODE,
        """maps = found.landscape(half_width=0.05, size=5)
for piece in maps.slices[:3]:
    names = maps.names[piece.first], maps.names[piece.second]
    shares = piece.shown(maps.loss_scale).losses
    print(names, f"least {shares.min():.3f}, most {shares.max():.3f}")""",
    ),
    (
        WORDS,
        "Poses, pictures and maps are written whole or not at all.",
    ),
    (
        CODE,
        """import tempfile
from pathlib import Path

with tempfile.TemporaryDirectory() as folder:
    found.save(Path(folder, "pose.json"))
    maps.save(Path(folder, "maps.npz"))
    print(sorted(path.name for path in Path(folder).iterdir()))""",
    ),
    (
        WORDS,
        "A mistake is one sentence.",
    ),
    (
        CODE,
        """try:
    found.draw("picture.png", look="glossy")
except poseviewer.PoseViewerError as error:
    print(error)""",
    ),
)


def main() -> None:
    """Run the cells in a kernel, and write the notebook with what they gave."""
    import nbformat  # pyright: ignore[reportMissingImports]
    from nbclient import NotebookClient  # pyright: ignore[reportMissingImports]

    new = {WORDS: nbformat.v4.new_markdown_cell, CODE: nbformat.v4.new_code_cell}
    cells = [new[kind](text, id=f"cell-{i}") for i, (kind, text) in enumerate(CELLS)]
    notebook = nbformat.v4.new_notebook(cells=cells)
    notebook.metadata["kernelspec"] = {
        "name": "python3",
        "display_name": "Python 3",
        "language": "python",
    }
    NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # when it ran is nobody's business
        for output in cell.get("outputs", []):
            _make_small(output)
    nbformat.validate(notebook)
    nbformat.write(notebook, PAGE)


def _make_small(output: dict) -> None:
    """Pictures as JPEG, which is a fifth of their PNG."""
    import base64
    from io import BytesIO

    from PIL import Image

    data = output.get("data", {})
    if "image/png" in data:
        picture = Image.open(BytesIO(base64.b64decode(data.pop("image/png")))).convert("RGB")
        small = BytesIO()
        picture.save(small, "JPEG", quality=80)
        data["image/jpeg"] = base64.b64encode(small.getvalue()).decode()
        data["text/plain"] = re.sub(r" at 0x[0-9A-F]+", "", data.get("text/plain", ""))


if __name__ == "__main__":
    main()
