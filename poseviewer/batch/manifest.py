"""What a folder of results says of the batch that filled it, so that it can be reviewed."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from poseviewer.batch.jobs import Job
from poseviewer.errors import BatchError
from poseviewer.files.writing import write_whole
from poseviewer.fit.settings import FitSettings, settings_as_json, settings_from_json

MANIFEST = "batch.json"
FORMAT, VERSION = "poseviewer-batch", 1


@dataclass(frozen=True, slots=True)
class Manifest:
    """The rows of a batch, and how they were fitted."""

    jobs: tuple[Job, ...]
    """In the order of their rows."""
    settings: FitSettings = field(default_factory=FitSettings)
    scene: str | None = None
    """The BOP scene that the rows are from, absolute; None for those of a table."""


def save_manifest(folder: Path, manifest: Manifest) -> None:
    """Write ``batch.json``.

    Raises:
        BatchError: it cannot be written.
    """
    data = {
        "format": FORMAT,
        "version": VERSION,
        "scene": manifest.scene,
        "settings": settings_as_json(manifest.settings),
        "jobs": [asdict(job) for job in manifest.jobs],
    }
    text = json.dumps(data, indent=1, ensure_ascii=False)
    write_whole(folder / MANIFEST, (text + "\n").encode(), BatchError)


def load_manifest(folder: Path) -> Manifest:
    """What ``save_manifest`` wrote.

    Raises:
        BatchError: the folder holds no batch, or the file is damaged.
    """
    try:
        data = json.loads((folder / MANIFEST).read_bytes())
        if (data["format"], data["version"]) != (FORMAT, VERSION):
            raise ValueError(f"{data['format']} {data['version']}")
        jobs = tuple(_job(entry) for entry in data["jobs"])
        return Manifest(jobs, settings_from_json(data["settings"]), data["scene"])
    except FileNotFoundError:
        raise BatchError(
            f"{folder}: no {MANIFEST} in it; name the folder of results that "
            "`poseviewer batch ... --out` filled (run it again if an older version did)."
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BatchError(
            f"{folder / MANIFEST}: cannot be used ({type(error).__name__}: {error}); run the batch "
            "again, what is done is not done twice."
        ) from None


def _job(entry: dict[str, Any]) -> Job:
    return Job(**{**entry, "above": tuple(entry["above"])})
