"""One whole job in real Chromium: files are dropped, the model is placed, fitted and saved."""

from pathlib import Path

import numpy as np
from playwright.sync_api import Browser

from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.pose import load_pose
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import Scene
from tests.writing import write

SIZE = (160, 120)
CAMERA = {"fx": 300.0, "fy": 300.0, "cx": 82.5, "cy": 57.5}
"""That of the scene, as files have it: pixel centres are integers."""


def test_a_photo_and_a_model_that_are_dropped_become_a_saved_pose(
    browser: Browser, tmp_path: Path, scene: Scene
) -> None:
    mesh, truth = load_mesh(scene.model), load_pose(scene.truth, *SIZE).pose
    seen, (x, y) = truth.project(mesh.vertices), truth.project(mesh.centre)
    with AppProcess(tmp_path) as app, AppPage(browser, app.url) as tab:
        tab.wait_for_text("at this pose")  # the demo
        tab.drop_files([scene.photo, scene.model])
        tab.wait_for_text("is not placed yet")
        tab.open_step(2)
        tab.page.get_by_text("Camera", exact=True).click()
        with tab.page.expect_file_chooser() as chooser:
            tab.page.get_by_role("button", name="Calibration file ...").click()
        chooser.value.set_files(str(write(tmp_path / "camera.json", CAMERA)))
        tab.wait_for_text("the photo's camera was read")
        tab.page.get_by_role("alert").get_by_role("button").click()  # it lies over the photo
        tab.fit_to_box(seen, SIZE)
        tab.drag((x, y), (x + np.ptp(seen[:, 0]) / 10, y), SIZE)
        tab.page.keyboard.press("Space")
        tab.wait_for_text("Verdict:")
        tab.page.get_by_role("button", name="Keep it").click()
        tab.open_step(5)
        tab.saved(tmp_path / "p.m.pose.json")
        found = load_pose(tmp_path / "p.m.pose.json", *SIZE).pose
        assert app.terminate() == 0
    assert not [line for line in app.lines if "Traceback" in line or "Error" in line]
    assert pose_error(mesh, found, truth).percent < 1.0
