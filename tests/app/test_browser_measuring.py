"""Two presses read a distance, and the pose of one object in another's frame is copied."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.several import CAMERA, MESHES, TRUTH, make_three


@pytest.mark.slow
@pytest.mark.long
def test_a_distance_is_read_and_a_relative_pose_copied(browser: Browser, tmp_path: Path):
    pose, half = TRUTH[1].pose, MESHES[1].vertices.max(axis=0)
    towards = np.sign(pose.camera_from_model.inverse().translation)
    corners = half * towards * np.array([[0.8, 0.9, 1.0], [-0.8, -0.9, 1.0]])
    scene = make_three(tmp_path, TRUTH)
    with AppProcess(tmp_path, scene) as app, AppPage(browser, app.url) as tab:
        tab.wait_for_text("at this pose")
        tab.open_step(4)
        tab.page.get_by_role("button", name="Measure (M)").click()
        tab.wait_for_text("press two points of models")
        for corner in pose.project(corners).tolist():
            tab.page.mouse.click(*tab.on_screen(corner, (CAMERA.width, CAMERA.height)))
        measured = tab.page.locator(".pv-result", has_text="Measured points")
        read = measured.locator("tr", has_text="distance").locator("td").inner_text()
        assert float(read) == pytest.approx(np.linalg.norm(corners[0] - corners[1]), rel=0.01)
        assert tab.page.locator(".pv-sheet text").last.text_content() == read
        tab.page.keyboard.press("m")
        tab.wait_for_text("roll, scale")
        tab.page.get_by_label("Relative to", exact=True).first.click()
        tab.page.get_by_role("option", name="front").click()
        tab.wait_for_text("in the frame of front")
        tab.page.context.grant_permissions(["clipboard-read"])
        tab.page.get_by_role("button", name="Copy", exact=True).click()
        copied = tab.page.evaluate("navigator.clipboard.readText()")
        wanted = pose.camera_from_model.inverse() @ TRUTH[0].pose.camera_from_model
        numbers = [*wanted.as_quaternion(), *wanted.translation]
        np.testing.assert_allclose(np.fromstring(copied, sep=" "), numbers, atol=1e-6)
