"""Names, assignments and docstrings of the package: what a rule can tell of them."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import poseviewer

PACKAGE = Path(poseviewer.__file__).parent
IRREGULAR = {
    "bound", "built", "drawn", "found", "given", "held", "kept", "left", "made", "said", "seen",
    "sent", "shown", "split", "taken", "told", "written",
}  # fmt: skip
"""Participles that do not end in "ed"; "cut", "put", "read", "set" are verbs, too."""
VERBS = {"embed", "feed", "need", "seed", "shed"}
PRIVATE_CONSTANT = re.compile(
    r"(?:^|_)(?:LEAST|MOST|FEWEST|LARGEST|LONGEST|SHORTEST|SMALLEST)(?:_|$)"
)
MANY = 4
"""Parameters from which a public function describes them."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def nodes() -> Iterator[tuple[str, ast.AST]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            yield str(path.relative_to(PACKAGE)), node


def functions() -> Iterator[tuple[str, Function]]:
    for path, node in nodes():
        if isinstance(node, Function):
            yield path, node


def is_value(function: Function) -> bool:
    """Whether it is read as a value: a property, or what overrides one."""
    return any(ast.unparse(one).endswith("property") for one in function.decorator_list)


def is_participle(word: str) -> bool:
    return word in IRREGULAR or (word.endswith("ed") and word not in VERBS)


def test_functions_begin_with_no_participle():
    names = [
        f"{path}: {function.name}"
        for path, function in functions()
        if is_participle(function.name.strip("_").partition("_")[0]) and not is_value(function)
    ]
    assert not names


def test_limits_are_named_min_and_max():
    names = [
        f"{path}: {node.id}"
        for path, node in nodes()
        if isinstance(node, ast.Name) and PRIVATE_CONSTANT.search(node.id)
    ]
    assert not names


def test_no_assignment_packs_three_values():
    """But for a rotation of the same names."""
    packed = []
    for path, node in nodes():
        if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)):
            continue
        target = node.targets[0]
        if not isinstance(target, ast.Tuple) or len(target.elts) < 3:
            continue
        assigned, values = ({ast.unparse(e) for e in side.elts} for side in (target, node.value))
        if not assigned & values:
            packed.append(f"{path}:{node.lineno}: {ast.unparse(node)}")
    assert not packed


def test_constants_stand_on_lines_of_their_own():
    packed = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Tuple)
        and isinstance(node.value, ast.Tuple)
        and ast.unparse(node.targets[0].elts[0]).isupper()
    ]
    assert not packed


def parameters(function: Function) -> list[str]:
    own = function.args
    names = [one.arg for one in (*own.posonlyargs, *own.args, *own.kwonlyargs)]
    return [name for name in names if name not in ("self", "cls", "session")]


def test_public_functions_of_many_parameters_describe_each():
    missing = []
    for path, function in functions():
        names = parameters(function)
        if function.name.startswith("_") or len(names) < MANY:
            continue
        words = ast.get_docstring(function) or ""
        described = words.partition("Args:")[2].partition("Raises:")[0]
        if not all(re.search(rf"\b{name}\b", described) for name in names):
            missing.append(f"{path}: {function.name}")
    assert not missing


def test_errors_are_described_in_one_form():
    """As a section, an error a line: ``Raises:`` and below it ``PoseFileError: why.``"""
    forms = [
        f"{path}: {function.name}"
        for path, function in functions()
        if re.search(r"\b[Rr]aises(?!:)", ast.get_docstring(function) or "")
    ]
    assert not forms
