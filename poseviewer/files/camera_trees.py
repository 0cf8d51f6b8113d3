"""Files of cameras as trees of mappings, lists and texts, whatever they are written in."""

import csv
import re
from contextlib import suppress
from dataclasses import replace
from io import BytesIO, StringIO
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from poseviewer.files.checks import InputFile, quiet_libraries

MAX_TEXT_BYTES = 1_000_000
"""Limit of a text, CSV or YAML, which is read in seconds; calibrations have less."""
MAX_ARRAY_NUMBERS = 10_000
"""Bytes of an array that may say a camera."""
LOADER = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
"""Every number a text, every tag and anchor plain; libyaml's where PyYAML was built with it."""
NO_BLANK = re.compile(r"^([^\S\n]*+(?=[\w.]*[A-Za-z])[\w.]++):(?=[\[{\"!\d.+-])", re.MULTILINE)
"""A key of YAML, and its colon without a blank behind it."""
FLOW = re.compile(r"^[^\S\n]*+- \{.*", re.MULTILINE)
"""A line of YAML with a mapping in braces."""
NO_BLANK_IN_FLOW = re.compile(r"([{,]\s*+[A-Za-z]\w*+):(?=[\[{\"!\d.+-])")
"""``NO_BLANK`` in it."""
SECTION = re.compile(r"\s*\[\s*([A-Za-z]\w*)\s*\]\s*")
KEY = re.compile(r"\s*+(?P<key>[A-Za-z]\w*+(?: ++\w++)*+)\s*+([:=](?P<numbers>.*))?")
"""Lines of a text: the name of a section; a key, alone or with numbers."""
BETWEEN = re.compile(r"[\[\](),;]")
TREES = (".yml", ".yaml", ".xml", ".json", ".sfm", ".npz", ".npy", ".csv", ".txt", ".ini")


def load_tree(file: InputFile) -> Any:
    """The mappings, lists and texts in a YAML, XML, JSON, NumPy, CSV or text file."""
    match file.path.suffix.lower():
        case ".json" | ".sfm" | "":
            return file.load_json()
        case ".npy" | ".npz":
            return _arrays(file)
        case ".txt" | ".ini":
            return _of_text(file)
        case ".csv":
            rows = [row for row in csv.reader(StringIO(_short_text(file))) if any(row)]
            return {"rows": [dict(zip(rows[0], row, strict=False)) for row in rows[1:]]}
    text, data = file.load_text(), None
    with suppress(yaml.YAMLError, ElementTree.ParseError, RecursionError):
        if text.lstrip().startswith("<"):
            data = _of_element(ElementTree.fromstring(text))  # expat refuses bombs of entities
        else:
            data = _of_yaml(file)
    if isinstance(data, dict | list):
        return data
    raise file.error("not YAML or XML as OpenCV writes it", "wanted a whole file")


def _of_yaml(file: InputFile) -> Any:
    """The first document of a YAML file, with OpenCV's head, which none that YAML knows is."""
    body = re.sub(r"\A\s*%YAML:1\.0", "", _short_text(file))
    body = NO_BLANK.sub(r"\1: ", body)  # cv2.FileStorage reads ``data:[``, and writes ``{ id:1``
    body = FLOW.sub(lambda line: NO_BLANK_IN_FLOW.sub(r"\1: ", line[0]), body)
    data = next(iter(yaml.load_all(body, LOADER)), None)  # what it calls a matrix is a mapping
    if _count_letters(data, {}) > MAX_TEXT_BYTES:
        found = f"its aliases stand for more than {MAX_TEXT_BYTES:,} letters"
        raise file.error(found, "wanted a calibration without them")
    return data


def _count_letters(value: Any, known: dict[int, int]) -> int:
    """Count the letters of a tree, those of a YAML alias wherever it stands."""
    if not isinstance(value, dict | list):
        return 1 + len(value)
    if id(value) not in known:
        inner = [*value, *value.values()] if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_count_letters(own, known) for own in inner)
    return known[id(value)]


def _of_text(file: InputFile) -> dict[str, Any]:
    """Parse ``[sections]``, ``key: numbers``, ``key = numbers`` and keys above numbers."""
    tree: dict[str, dict[str, Any]] = {"": {}}
    entries, key = tree[""], ""
    for line in _short_text(file).splitlines():
        line = line.partition("#")[0]
        words = line.split()
        section = SECTION.fullmatch(line)
        known = KEY.fullmatch(line)
        if section:
            entries, key = tree.setdefault(section[1], {}), ""
        elif len(words) == 22:  # of Middlebury's photos: name, K, R and t
            entries[words[0]] = {"K": words[1:10]}
        else:
            key = known["key"] if known else key if words else ""
            numbers = BETWEEN.sub(" ", known["numbers"] or "" if known else line).split()
            entries.setdefault(key, []).extend(numbers)
    top = tree.pop("")
    loose = top.pop("", [])
    if not (top or tree):
        return {"matrix": loose}
    for name, values in list(top.items()):
        _, _, number = name.rpartition("_")
        if len(values) == 12 and re.fullmatch(r"P\d+|P_rect_\d+", name):
            matrix = [*values[:3], *values[4:7], *values[8:11]]
            top[name] = {"K": matrix, "image_size": top.get(f"S_rect_{number}")}
        elif re.fullmatch(r"S_\d+", name):
            top[f"image_size_{number}"] = values
        elif len(values) == 9 and re.fullmatch(r"cam\d+", name):
            top[name] = {"K": values}
    for entries in (top, *tree.values()):
        entries.update({k: v[0] for k, v in entries.items() if isinstance(v, list) and len(v) == 1})
    return top | tree


def matrix_text(file: InputFile) -> str:
    """The numbers in a text, without what may stand between them."""
    return BETWEEN.sub(" ", _short_text(file))


def _short_text(file: InputFile) -> str:
    return replace(file, largest=MAX_TEXT_BYTES).load_text()


def _arrays(file: InputFile) -> dict[str, Any]:
    with quiet_libraries(), file.naming_errors():
        content = np.load(BytesIO(file.load_bytes()))
        if isinstance(content, np.ndarray):
            return {"camera_matrix": content.tolist()}
        small = [i.filename for i in content.zip.infolist() if i.file_size <= MAX_ARRAY_NUMBERS]
        return {name.removesuffix(".npy"): content[name].tolist() for name in small}


def _of_element(element: ElementTree.Element) -> Any:
    if not len(element) and (element.text or "").strip():
        return element.text or ""
    if len(element) and all(child.tag == "_" for child in element):
        return [_of_element(child) for child in element]
    values: dict[str, list[Any]] = {}
    for child in element:
        values.setdefault(child.tag, []).append(_of_element(child))
    entries = {tag: own[0] if len(own) == 1 else own for tag, own in values.items()}
    return {**element.attrib, **entries} or ""
