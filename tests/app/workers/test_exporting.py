"""What the page sends in other tools' formats is what ``convert`` and ``render`` write."""

from io import BytesIO
from zipfile import ZipFile

import numpy as np
import pytest

from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import CONVERTED, RELATIVE, export
from poseviewer.app.workers.opening import open_files
from poseviewer.errors import PoseViewerError
from poseviewer.files.formats.known_formats import FORMATS

OF_ONE_UNIT = ("bop", "dope", "linemod")


def test_every_format_of_convert_is_there():
    own = {name for name, known in FORMATS.items() if known.is_own}
    assert set(CONVERTED) - set(FORMATS) == {"masks, depth, normals", RELATIVE}
    assert set(FORMATS) - own == set(CONVERTED) & set(FORMATS)


@pytest.mark.parametrize("what", sorted({*CONVERTED} - {*OF_ONE_UNIT, RELATIVE}))
def test_a_pose_is_sent_in_every_format(scene, what):
    document = open_files(scene.photo, scene.model, scene.start)
    ((name, data),) = export(what, Session(document)).items()
    if what == "matrix":
        place = document.pose.camera_from_model
        wanted = np.column_stack([place.rotation, place.translation])
        np.testing.assert_allclose(np.loadtxt(BytesIO(data))[:3], wanted)
    if name.endswith(".zip"):
        names = ZipFile(BytesIO(data)).namelist()
        assert any("cameras.txt" in file or "/nocs/" in file for file in names)
    assert data


@pytest.mark.parametrize("what", OF_ONE_UNIT)
def test_a_format_of_one_unit_asks_for_the_models(scene, what):
    session = Session(open_files(scene.photo, scene.model, scene.start))
    with pytest.raises(PoseViewerError, match="on the page with Model's unit"):
        export(what, session, "as it says")
    assert export(what, session, "mm")
