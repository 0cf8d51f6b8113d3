"""Two presses read a distance, and the pose of one object in another's frame is copied."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.several import CAMERA, MESHES, TRUTH, make_three

pytestmark = pytest.mark.slow

SIZE = (CAMERA.width, CAMERA.height)


def test_a_distance_is_read_and_a_relative_pose_copied(browser: Browser, tmp_path: Path):
    pose, low = TRUTH[1].pose, MESHES[1].vertices.min(axis=0)
    face = pose.camera_from_model.inverse().translation  # the faces towards the camera
    corners = np.abs(low) * np.sign(face) * np.array([[0.8, 0.9, 1.0], [-0.8, -0.9, 1.0]])
    scene = make_three(tmp_path, TRUTH)
    with AppProcess(tmp_path, scene) as app, AppPage(browser, app.url) as tab:
        tab.wait_for_text("at this pose")
        tab.open_step(4)
        tab.page.get_by_role("button", name="Measure (M)").click()
        tab.wait_for_text("press a point of a model")
        for corner in corners:
            tab.page.mouse.click(*tab.on_screen(pose.project(corner).tolist(), SIZE))
        measured = tab.page.locator(".pv-result", has_text="Measured points")
        row = measured.locator("tr", has_text="distance").locator("td")
        distance = float(row.inner_text())
        assert tab.page.locator(".pv-sheet text").last.text_content() == row.inner_text()
        assert distance == pytest.approx(np.linalg.norm(corners[0] - corners[1]), rel=0.01)
        tab.page.keyboard.press("m")
        tab.wait_for_text("roll, scale")
        tab.page.get_by_label("Relative to", exact=True).first.click()
        tab.page.get_by_role("option", name="front").click()
        tab.wait_for_text("in the frame of front")
        tab.page.context.grant_permissions(["clipboard-read"])
        tab.page.get_by_role("button", name="Copy", exact=True).click()
        copied = tab.page.evaluate("navigator.clipboard.readText()").split()
        ball = TRUTH[0].pose.camera_from_model
        wanted = pose.camera_from_model.inverse() @ ball
        np.testing.assert_allclose(
            [float(number) for number in copied],
            [*wanted.as_quaternion(), *wanted.translation],
            atol=1e-6,
        )
