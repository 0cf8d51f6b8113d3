"""The body of a PLY file, as text or bytes: columns of numbers and of lists."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.part import numbers_from_text

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip

Lists = tuple[NDArray[np.int64], NDArray]
"""How many values each row has (N,), and all the values one after another."""

Columns = dict[str, Any]
"""By name: an array (N,) of numbers, or Lists."""


@dataclass
class Element:
    """A table of the file, as its header announces it."""

    name: str
    count: int
    """Rows."""
    properties: list[tuple[str, str | None, str]] = field(default_factory=list)
    """Name, type of the count (lists only), type of the values."""


def _cut_short(name: str, element: Element) -> MeshFileError:
    return MeshFileError(
        f"{name}: the header promises {element.count:,} of {element.name!r}, but the file ends "
        "before; it is cut short, copy or export it again."
    )


def columns_from_text(name: str, elements: list[Element], body: bytes) -> dict[str, Columns]:
    """The columns of each element by name, from the text below the header.

    Raises:
        MeshFileError: other than numbers, or fewer than promised.
    """
    try:
        numbers = numbers_from_text(body.decode("ascii", "replace"))
    except (ValueError, DeprecationWarning):
        raise MeshFileError(
            f"{name}: something else than numbers below the PLY header; export it again."
        ) from None
    columns, at = {}, 0
    for element in elements:
        columns[element.name], at = _text_element(name, element, numbers, at)
    return columns


def _text_element(name: str, element: Element, numbers: NDArray, at: int) -> tuple[Columns, int]:
    """Rows of equal length are cut out as a table; others are walked through."""
    layout, width = [], 0
    for key, count_type, value_type in element.properties:
        length = 1
        if count_type:
            if element.count and at + width >= len(numbers):
                raise _cut_short(name, element)
            length = int(numbers[at + width]) if element.count else 0
        layout.append((key, count_type, value_type, width, length))
        width += length + (1 if count_type else 0)
    table = numbers[at : at + element.count * width]
    is_table = width > 0 and len(table) == element.count * width
    if is_table:
        table = table.reshape(element.count, width)
        is_table = all(np.all(table[:, w] == n) for _, c, _, w, n in layout if c)
    if not is_table:
        return _walk_text(name, element, numbers, at)
    columns = {}
    for key, count_type, value_type, w, n in layout:
        if count_type:
            columns[key] = np.full(element.count, n), table[:, w + 1 : w + 1 + n].ravel()
        else:
            columns[key] = table[:, w].astype(value_type)
    return columns, at + element.count * width


def _walk_text(name: str, element: Element, numbers: NDArray, at: int) -> tuple[Columns, int]:
    values = numbers.tolist()
    found: dict[str, tuple[list, list]] = {key: ([], []) for key, _, _ in element.properties}
    for _ in range(element.count):
        for key, count_type, _ in element.properties:
            if at >= len(values):
                raise _cut_short(name, element)
            length = 1
            if count_type:
                length, at = int(values[at]), at + 1
            if length < 0 or at + length > len(values):
                raise _cut_short(name, element)
            found[key][0].append(length)
            found[key][1].extend(values[at : at + length])
            at += length
    return _as_columns(element, found), at


def _as_columns(element: Element, found: dict[str, tuple[list, list]]) -> dict:
    columns = {}
    for key, count_type, value_type in element.properties:
        counts, values = found[key]
        array = np.array(values, dtype=float if count_type else value_type)
        columns[key] = (np.array(counts, dtype=np.int64), array) if count_type else array
    return columns


def columns_from_bytes(
    name: str, elements: list[Element], data: bytes, at: int, order: str
) -> dict[str, Columns]:
    """The columns of each element by name, from the bytes of the file from ``at`` on.

    ``order`` is "<" or ">", the least or the most significant byte first.

    Raises:
        MeshFileError: fewer bytes than promised.
    """
    columns = {}
    for element in elements:
        columns[element.name], at = _bytes_element(name, element, data, at, order)
    return columns


def _bytes_element(
    name: str, element: Element, data: bytes, at: int, order: str
) -> tuple[Columns, int]:
    fields, width = [], 0
    for key, count_type, value_type in element.properties:
        if not count_type:
            fields.append((key, order + value_type))
            width += np.dtype(value_type).itemsize
            continue
        kind = np.dtype(order + count_type)
        if element.count and at + width + kind.itemsize > len(data):
            raise _cut_short(name, element)
        length = int(np.frombuffer(data, kind, 1, at + width)[0]) if element.count else 0
        if length * np.dtype(value_type).itemsize > len(data):
            raise _cut_short(name, element)
        fields += [(f"{key} count", kind), (key, order + value_type, (length,))]
        width += kind.itemsize + length * np.dtype(value_type).itemsize
    lists = [key for key, count_type, _ in element.properties if count_type]
    row = np.dtype(fields)
    if at + element.count * row.itemsize <= len(data) and row.itemsize:
        table = np.frombuffer(data, row, element.count, at)
        if all(np.all(table[f"{k} count"] == table[k].shape[1]) for k in lists):
            columns = {
                key: (table[f"{key} count"].astype(np.int64), table[key].ravel())
                if count_type
                else table[key].astype(value_type)
                for key, count_type, value_type in element.properties
            }
            return columns, at + element.count * row.itemsize
    if not lists:
        raise _cut_short(name, element)
    return _walk_bytes(name, element, data, at, order)


def _walk_bytes(
    name: str, element: Element, data: bytes, at: int, order: str
) -> tuple[Columns, int]:
    found: dict[str, tuple[list, list]] = {key: ([], []) for key, _, _ in element.properties}
    kinds = [
        (key, np.dtype(order + (c or "u1")), bool(c), np.dtype(order + v))
        for key, c, v in element.properties
    ]
    for _ in range(element.count):
        for key, count_kind, is_list, kind in kinds:
            length = 1
            if is_list:
                if at + count_kind.itemsize > len(data):
                    raise _cut_short(name, element)
                length = int(np.frombuffer(data, count_kind, 1, at)[0])
                at += count_kind.itemsize
            if length < 0 or at + length * kind.itemsize > len(data):
                raise _cut_short(name, element)
            found[key][0].append(length)
            found[key][1].extend(np.frombuffer(data, kind, length, at).tolist())
            at += length * kind.itemsize
    return _as_columns(element, found), at
