"""A description inside a picture file, beside its pixels, which stay as they are."""

from __future__ import annotations

import struct
import zlib

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_HEADER_END = len(PNG_SIGNATURE) + 25
"""After IHDR, which comes first and has 13 bytes of content."""
JPEG_START = b"\xff\xd8"
LONGEST = 60_000
"""Bytes: a JPEG's comment has at most 65,533."""


def described(data: bytes, description: str) -> bytes:
    """The file's bytes with a description: PNG's ``iTXt`` "Description" (ISO/IEC 15948, 11.3.4.5),
    JPEG's COM (ITU T.81, B.2.4.5), both in UTF-8. Other files, and "" as text, change nothing.
    """
    text = description.encode()[:LONGEST]
    if not text:
        return data
    if data.startswith(PNG_SIGNATURE):
        content = b"Description\0\0\0\0\0" + text
        body = b"iTXt" + content
        chunk = struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))
        return data[:PNG_HEADER_END] + chunk + data[PNG_HEADER_END:]
    if data.startswith(JPEG_START):
        return JPEG_START + b"\xff\xfe" + struct.pack(">H", len(text) + 2) + text + data[2:]
    return data
