"""Hook of mkdocs: files outside of ``docs`` come along where a page links to them.

Links stay as they are in a clone: relative, from file to file.
"""

import re
from os.path import relpath
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "assets" / "docs"
LINK = re.compile(r"(\]\()(?!https?://|#)([^)\s#]+)")


def uri(path: Path) -> str:
    """Place of a file in the site: hidden folders are not hidden there."""
    if path.is_relative_to(DOCS):
        return path.relative_to(DOCS).as_posix()
    return "repository/" + path.relative_to(ROOT).as_posix().lstrip(".")


def targets(path: Path) -> list[Path]:
    """Files that a page links to."""
    text = path.read_text(encoding="utf-8")
    return [(path.parent / name).resolve() for _, name in LINK.findall(text)]


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add what is linked to, and what that links to."""
    waiting = sorted(DOCS.glob("*.md"))
    while waiting:
        for path in targets(waiting.pop()):
            if files.get_file_from_path(uri(path)) is None:
                files.append(File.generated(config, uri(path), abs_src_path=str(path)))
                waiting += [path] if path.suffix == ".md" else []
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: object) -> str:
    """Make links those of the site."""
    here = Path(page.file.abs_src_path or "")
    start = Path(page.file.src_uri).parent

    def rewrite(link: re.Match[str]) -> str:
        return link[1] + Path(relpath(uri((here.parent / link[2]).resolve()), start)).as_posix()

    return LINK.sub(rewrite, markdown)
