"""Run the cells of ``assets/docs/library.ipynb`` and keep what they give: the page is its source.

Run from the repository's root: ``python -m assets.source.notebook`` (``pip install -e '.[dev]'``).
"""

import base64
import re
from io import BytesIO
from pathlib import Path

from PIL import Image

PAGE = Path(__file__).resolve().parent.parent / "docs" / "library.ipynb"


def main() -> None:
    """Run the cells in a kernel, and write the notebook with their outputs."""
    import nbformat  # pyright: ignore[reportMissingImports]
    from nbclient import NotebookClient  # pyright: ignore[reportMissingImports]

    notebook = nbformat.read(PAGE, as_version=4)
    NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # times of day
        for output in cell.get("outputs", []):
            make_small(output)
    nbformat.validate(notebook)
    nbformat.write(notebook, PAGE)


def make_small(output: dict) -> None:
    """Store pictures as JPEG, a fifth of their PNG."""
    data = output.get("data", {})
    if "image/png" in data:
        picture = Image.open(BytesIO(base64.b64decode(data.pop("image/png")))).convert("RGB")
        small = BytesIO()
        picture.save(small, "JPEG", quality=80)
        data["image/jpeg"] = base64.b64encode(small.getvalue()).decode()
        data["text/plain"] = re.sub(r" at 0x[0-9A-F]+", "", data.get("text/plain", ""))


if __name__ == "__main__":
    main()
