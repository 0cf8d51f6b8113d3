"""Packages stay apart: imports, printing, threads."""

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import poseviewer
from poseviewer.scene.types import SceneObject

PACKAGE = Path(poseviewer.__file__).parent
REPOSITORY = PACKAGE.parent


def test_import_contracts_hold():
    code = "from importlinter.cli import lint_imports_command as main; main()"
    result = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "0 broken" in result.stdout


def test_only_the_command_line_prints():
    printers = {
        path.relative_to(PACKAGE).parts[0]
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Name) and node.id == "print"
    }
    assert printers == {"cli"}


def test_no_thread_outside_the_workers():
    for path in PACKAGE.rglob("*.py"):
        is_worker = path.parent == PACKAGE / "app" / "workers"
        assert is_worker or path == PACKAGE / "processes.py" or "Thread(" not in path.read_text(), (
            path
        )


def test_names_are_imported_from_the_module_that_defines_them():
    """A name that a module only imports is not taken from there; ``poseviewer`` itself is a door
    to the library's.
    """
    taken = [
        (path, node.module.replace(".", "/"), alias.name)
        for path in PACKAGE.rglob("*.py")
        if path != PACKAGE / "__init__.py"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    ]
    imported = {(path.relative_to(REPOSITORY).as_posix(), name) for path, _, name in taken}
    elsewhere = [
        (path.name, at, name) for path, at, name in taken if (f"{at}.py", name) in imported
    ]
    assert len(taken) > 2000
    assert elsewhere == []


def listed(node: ast.AST) -> set[object]:
    """Names that a call has as keywords, a dict as keys, or a class as fields."""
    if isinstance(node, ast.Call):
        return {keyword.arg for keyword in node.keywords}
    if isinstance(node, ast.Dict):
        return {key.value for key in node.keys if isinstance(key, ast.Constant)}
    declared = node.body if isinstance(node, ast.ClassDef) else ()
    return {part.target.id for part in declared if isinstance(part, ast.AnnAssign)}  # pyright: ignore[reportAttributeAccessIssue]


ALIKE = {"run", "main", "minimise"}
"""Functions of one protocol: of commands and of minimisers."""


def test_no_name_stands_twice():
    """Neither of a class, nor of a public function of a module, nor of a file."""
    paths = [path for path in PACKAGE.rglob("*.py") if path.name != "__init__.py"]
    trees = [ast.parse(path.read_text()) for path in paths]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    classes = [node.name for node in nodes if isinstance(node, ast.ClassDef)]
    defined = [node for tree in trees for node in tree.body]
    functions = [node.name for node in defined if isinstance(node, ast.FunctionDef)]
    public = [name for name in functions if not name.startswith("_") and name not in ALIKE]
    for names in (classes, public, [path.name for path in paths]):
        assert [name for name, count in Counter(names).items() if count > 1] == []


def test_fields_of_an_object_are_listed_in_few_places():
    """A field such as ``note`` is declared once, and in the pose file that shares it; a place that
    lists many fields by hand is one more to edit for each new field.
    """
    fields = set(SceneObject.__dataclass_fields__)
    places = {
        f"{path.relative_to(PACKAGE).as_posix()}: {getattr(whole, 'name', '')}"
        for path in PACKAGE.rglob("*.py")
        for whole in ast.parse(path.read_text()).body
        for node in ast.walk(whole)
        if len(fields & listed(node)) >= 6
    }
    assert places == {
        "scene/types.py: SceneObject",  # the declaration
        "files/scene_json.py: _object_as_saved",  # what files have otherwise than a session
        "files/scene_json.py: scene_of_pose",  # what a pose file says
        "opening/scenes.py: _open_views",  # what a pose file says of several photos
        "app/state/objects.py: with_added",  # another object like the active one
    }


def test_files_and_names_of_how_to_add_are_there():
    """Each row names files first, then what is in the last of them."""
    page = (REPOSITORY / "assets" / "docs" / "how_to_add.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\d\. .*$", page, re.MULTILINE)
    assert len(rows) > 10
    for row in rows:
        text = ""
        for name in re.findall(r"`([^`]+)`", row):
            path = REPOSITORY / name
            if "/" in name or path.is_file():
                assert path.exists(), name
                files = path.glob("*.py") if path.is_dir() else [path]
                text += "".join(file.read_text(encoding="utf-8") for file in files)
            elif re.fullmatch(r"[A-Za-z_]+", name):
                assert re.search(rf"\b{name}\b", text), (name, row)
