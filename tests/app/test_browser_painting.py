"""A model without colours is painted in real Chromium, followed, exported, and unpainted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.pose_error import pose_error
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.app.sequences import COUNT, MESH, true_pose, write_sequence
from tests.several import save_model

pytestmark = [pytest.mark.slow, pytest.mark.long]


def test_a_key_paints_the_model_of_a_sequence(browser: Browser, tmp_path: Path):
    frames, model, camera, start = write_sequence(tmp_path)
    save_model(model, replace(MESH, colours=np.full_like(MESH.colours, 0.6)))
    options = "--calibration", camera, "--pose", start
    with (
        AppProcess(tmp_path, frames, model, *options) as app,
        AppPage(browser, app.url) as tab,
    ):
        tab.wait_for_text("at this pose")
        button = tab.page.get_by_role
        tab.open_step(4)
        expect(button("button", name="Unpaint")).to_be_hidden()
        button("button", name="Paint from the keys").click()
        tab.wait_for_text("of the surface is painted, from 1 photo.")
        expect(button("button", name="Unpaint")).to_be_visible()
        # The way to the end is by its print.
        tab.page.locator(".pv-time").get_by_role("button", name="to end").click()
        tab.until(lambda: "propagated" in tab.page.locator(".pv-end").inner_text())
        tab.saved(tmp_path / "frames.m.scene.json")
        tab.open_step(5)
        with tab.page.expect_download() as download:
            button("button", name="Export painted model").click()
        painted = tmp_path / "painted.glb"
        painted.write_bytes(Path(download.value.path()).read_bytes())
        tab.open_step(4)
        button("button", name="Unpaint").click()
        expect(button("button", name="Unpaint")).to_be_hidden()
        tab.page.keyboard.press("z")
        expect(button("button", name="Unpaint")).to_be_visible()
    found = load_mesh(painted)
    np.testing.assert_allclose(found.bounds, MESH.bounds, atol=1e-5)
    assert np.std(found.colours[:, 0]) > 0.05
    scene = load_scene(tmp_path / "frames.m.scene.json")
    assert len(scene.frames) == COUNT
    for index, frame in enumerate(scene.frames):
        pose = scene.views[0].pose(frame.poses["1"].world_from_model)
        assert pose_error(MESH, pose, true_pose(index)).percent < 2.0
