"""Names of files in a model file."""

import re
import struct
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote

from poseviewer.errors import MeshFileError
from poseviewer.files.mesh.gltf import GLTF, gltf_header
from poseviewer.files.mesh.obj import OPTIONS, library_names
from poseviewer.files.mesh.ply import MAX_HEADER_BYTES

WORDS = {
    ".obj": rb"(mtllib)",
    ".mtl": rb"(?i:(map_\w++|bump|disp|decal|norm|refl))",
    ".ply": rb"comment[ \t]++(?i:(texturefile))",
}
"""Words of a line before a file's name."""
READ = (b"mtllib", b"map_kd", b"texturefile")
PICTURE_3DS = re.compile(rb"\x00\xa3(.{4})([^\x00]{1,255})\x00", re.DOTALL)
"""The chunk 0xA300, the file name of a material's picture: its id, its length, the name."""
IMAGE_DAE = re.compile(rb"<image\b|<init_from>\s*+(?:<ref>)?+([^<]*+)")
"""An image of COLLADA, and the name of a picture or, outside images, of an image."""
CHUNK_HEADER = 6


def names_in(path: Path) -> dict[str, bool]:
    """Files that a model or MTL file names, and whether they are read; {} where it is damaged."""
    suffix = path.suffix.lower()
    try:
        if suffix in GLTF:
            header = gltf_header(path)
            entries = [*header.get("buffers", []), *header.get("images", [])]
            uris = [str(entry["uri"]) for entry in entries if entry.get("uri")]
            return {unquote(u): True for u in uris if not re.match(r"data:|https?:", u)}
        with path.open("rb") as file:
            data = file.read(MAX_HEADER_BYTES if suffix == ".ply" else -1)
    except (OSError, ValueError, AttributeError, TypeError, RecursionError, MeshFileError):
        return {}  # damaged: who reads the model will say so
    names: dict[str, bool] = {}
    if suffix == ".3ds":
        for length, name in PICTURE_3DS.findall(data):
            if struct.unpack("<I", length)[0] == CHUNK_HEADER + len(name) + 1:
                names[name.decode("latin-1")] = True
    elif suffix == ".dae":
        tags = [match[1] for match in IMAGE_DAE.finditer(data)]
        own = (name for tag, name in pairwise(tags) if tag is None and name is not None)
        written = (name.decode("utf-8", "replace").strip() for name in own)
        return {unquote(name): True for name in written if name}
    elif suffix in WORDS:
        pattern = rb"^(?:\xef\xbb\xbf)?[ \t]*+%b[ \t]++([^\r\n]*[^\s])" % WORDS[suffix]
        for word, rest in re.findall(pattern, data, re.MULTILINE):
            name = OPTIONS.sub("", rest.decode("utf-8", "surrogateescape"), count=1)
            for own in library_names(name) if word == b"mtllib" else filter(None, [name]):
                names[own] = names.get(own, False) or word.lower() in READ
    return names
