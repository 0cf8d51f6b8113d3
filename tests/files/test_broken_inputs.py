from __future__ import annotations

from typing import Any

from poseviewer.errors import MeshFileError, PhotoFileError, PoseFileError
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose

LOADERS: dict[str, Any] = {
    "model": (load_mesh, MeshFileError),
    "photo": (load_photo, PhotoFileError),
    "pose": (lambda path: load_pose(path, 80, 64), PoseFileError),
}


def test_every_broken_input_is_refused_in_one_line_that_names_it(
    broken_inputs: list[Any],
) -> None:
    wrong = []
    for broken in broken_inputs:
        load, error_type = LOADERS[broken.kind]
        try:
            load(broken.path)
            wrong.append(f"{broken.kind} {broken.name}: accepted")
        except error_type as error:
            text = str(error)
            if not text.startswith(broken.path.name) or "\n" in text or not 30 < len(text) < 300:
                wrong.append(f"{broken.kind} {broken.name}: {text!r}")
        except Exception as error:  # noqa: BLE001 - that is what is tested
            wrong.append(f"{broken.kind} {broken.name}: {error!r}")
    assert not wrong, "\n".join(wrong)
    assert len(broken_inputs) >= 40
