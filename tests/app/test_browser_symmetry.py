"""A symmetric model in real Chromium: its symmetry is looked for, used, said and saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from playwright.sync_api import Browser

from poseviewer.app.page.panels import SYMMETRIC
from poseviewer.files.pose import load_pose
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, keep_picture
from tests.meshes import make_mesh
from tests.scene import make_scene_of

pytestmark = pytest.mark.slow


def test_a_symmetry_is_found_used_and_saved(browser: Browser, tmp_path: Path):
    box = trimesh.creation.box(extents=(2.0, 1.2, 0.7))
    colours = np.full((len(box.vertices), 3), 0.6)
    scene = make_scene_of(make_mesh(box.vertices, box.faces, colours=colours), tmp_path)
    with AppProcess(tmp_path, scene.photo, scene.model, "--pose", scene.start) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("at this pose")
        tab.open_step(1)
        tab.wait_for_text("all poses are told apart")
        use, path = tab.page.get_by_label(SYMMETRIC), app.folder / "p.pose.json"
        assert not use.is_checked()
        use.click()
        tab.wait_for_text("poses are one that differ by half a turn about")
        keep_picture(tab, "symmetry")
        assert use.is_checked()
        tab.saved_pose(path)
        assert len(load_pose(path, 160, 120).symmetry.transforms()) == 4
        use.click()
        tab.wait_for_text("all poses are told apart")
        tab.saved_pose(path)
        assert load_pose(path, 160, 120).symmetry.is_none
        assert tab.errors == []
        tab.page.close()
