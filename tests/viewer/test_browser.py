"""The app as a person sees it: real Chromium on the real app."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from playwright.sync_api import Browser

from poseviewer.demo import demo_case
from poseviewer.files.photo_file import load_photo, save_image
from poseviewer.files.pose_file import PoseRecord, load_pose, save_pose
from poseviewer.fit.pose_fit import Limits, fit_pose
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.registration import FitSettings, load_registration, make_problem
from poseviewer.render.software import SoftwareRenderer
from tests.scene import Scene
from tests.viewer.app_process import AppProcess
from tests.viewer.browser import AppPage, open_browser

SIZES = ((1400, 900), (1150, 1000), (1900, 640))
ZOOMS = (1.0, 3.3, 9.0)
PHOTO = (640, 400)
DEMO_PHOTO = (960, 720)
EVALUATIONS = 300
"""Of the demo's search in the browser: a browser without a GPU leaves little time for it."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as chromium:
        yield chromium


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppProcess]:
    with AppProcess(tmp_path_factory.mktemp("demo")) as app:
        yield app
        assert app.interrupt() == 0


@pytest.fixture
def page(browser: Browser, demo: AppProcess) -> Iterator[AppPage]:
    tab = AppPage(browser, demo.url)
    yield tab
    assert tab.errors == []
    tab.page.close()


def make_dots(folder: Path, camera: Camera) -> np.ndarray:
    """A model of small balls, and a photo with a white dot wherever numpy projects one; (k, 2)."""
    places = np.array([[-1.6, -0.8, 0.2], [1.5, -0.7, -0.3], [0.1, 0.1, 0.5], [1.2, 0.9, 0.0]])
    balls = [trimesh.creation.icosphere(4, 0.1).apply_translation(place) for place in places]
    trimesh.util.concatenate(balls).export(str(folder / "dots.ply"))
    pose = Pose(camera, RigidTransform.from_rotation_vector([0.2, -0.1, 0.1], [0.0, 0.0, 8.0]))
    save_pose(folder / "dots.json", PoseRecord(pose))
    seen = pose.project(places)
    v, u = np.mgrid[0 : PHOTO[1], 0 : PHOTO[0]] + 0.5
    fine = np.full((PHOTO[1], PHOTO[0], 3), (70.0, 70.0, 70.0))
    for x, y in seen:
        share = np.clip(4.0 - np.hypot(u - x, v - y), 0.0, 1.0)[..., None]
        fine = fine * (1.0 - share) + share * 235.0
    save_image(folder / "dots.png", np.rint(fine).astype(np.uint8))
    return seen


def centre_of(weights: np.ndarray, near: tuple[float, float], reach: float) -> np.ndarray:
    """(2,): the weighted mean place near another, pixel centres at i + 0.5."""
    v, u = np.mgrid[0 : weights.shape[0], 0 : weights.shape[1]] + 0.5
    close = weights * (np.hypot(u - near[0], v - near[1]) < reach)
    assert close.any(), f"nothing marked within {reach:.0f} px of {near}"
    return np.array([(close * u).sum(), (close * v).sum()]) / close.sum()


def circle_centre(weights: np.ndarray, near: tuple[float, float], reach: float) -> np.ndarray:
    """(2,): the centre of the circle through marked pixels, by least squares (Kasa's): a line of
    two pixels is not as bright all around, so its mean place is no measure.
    """
    v, u = np.nonzero(weights)
    close = np.hypot(u + 0.5 - near[0], v + 0.5 - near[1]) < reach
    u, v = u[close] + 0.5 - near[0], v[close] + 0.5 - near[1]
    assert len(u) > 8, f"no outline within {reach:.0f} px of {near}"
    root = np.sqrt(weights[weights > 0][close])
    rows = root[:, None] * np.column_stack([u, v, np.ones_like(u)])
    found = np.linalg.lstsq(rows, root * (u * u + v * v), rcond=None)[0]
    return found[:2] / 2.0 + near


@pytest.mark.parametrize(
    "camera",
    [
        Perspective(900.0, 900.0, 290.3, 231.7, *PHOTO),
        Parallel(112.0, 331.2, 190.9, *PHOTO),
    ],
    ids=["perspective", "parallel"],
)
def test_model_and_photo_coincide(browser: Browser, tmp_path: Path, camera: Camera):
    seen = make_dots(tmp_path, camera)
    files = (tmp_path / "dots.png", tmp_path / "dots.ply", "--pose", tmp_path / "dots.json")
    with AppProcess(tmp_path, *files) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("at this pose")
        for size in SIZES:
            tab.page.set_viewport_size({"width": size[0], "height": size[1]})
            tab.page.wait_for_timeout(500)
            for zoom in ZOOMS:
                assert_coincident(tab, seen, zoom)
        assert tab.errors == []
        tab.page.close()


def assert_coincident(tab: AppPage, seen: np.ndarray, zoom: float) -> None:
    for point in seen[:2] if zoom == 1.0 else seen[2:3]:
        tab.page.evaluate("window.poseviewer.showAll()")
        x, y = tab.on_screen(point, PHOTO)
        left, top = tab.view()["box"][:2]
        # What lies under the cursor stays there: only points inside the window can be looked at.
        tab.page.evaluate(f"window.poseviewer.zoomAt({x - left}, {y - top}, {zoom})")
        picture = tab.settled_picture().astype(int)
        wanted = tab.on_screen(point, PHOTO)
        np.testing.assert_allclose(wanted, (x, y), atol=1e-6)
        red, blue = picture[..., 0], picture[..., 2]
        scale = tab.view()["scale"]
        # The dot is white on grey, the outline around it cyan.
        dot = centre_of(np.clip(red - 90, 0, None), wanted, 6.5 * scale)
        outline = circle_centre(np.clip(blue - red - 20, 0, None), wanted, 18.0 * scale)
        assert np.abs(dot - wanted).max() < 0.5
        # Outlines are found in three samples a photo px: what zoom shows of a photo px, it shows.
        assert np.abs(outline - wanted).max() < max(0.5, 0.08 * scale)


def test_the_page_opens_on_the_demo(page: AppPage):
    assert page.page.title() == "poseviewer"
    assert page.page.locator("link[rel~=icon]").get_attribute("href", timeout=5000)
    page.wait_for_text("demo_photo.jpg")
    page.wait_for_text("89,728 triangles")
    page.wait_for_text("at this pose")


def test_the_camera_cannot_be_knocked_off_the_photo(page: AppPage):
    before = page.view()
    corner = (30.0, 700.0)  # beside the model
    for keys in ((), ("Shift",), ("Control",)):
        page.drag(corner, (300.0, 650.0), DEMO_PHOTO, keys)
    for key in ("w", "a", "d", "q", "e"):
        page.page.keyboard.press(key, delay=80)
    page.page.wait_for_timeout(300)
    assert page.view() == before
    camera = page.page.evaluate("window.__viserMutable.camera.position.toArray()")
    np.testing.assert_allclose(camera, 0.0, atol=1e-6)


def test_wheel_zooms_at_the_cursor_and_a_key_returns(page: AppPage):
    place = tuple(round(v) for v in page.on_screen((700.0, 300.0), DEMO_PHOTO))
    left, top = page.view()["box"][:2]
    under = page.page.evaluate(
        f"window.poseviewer.photoFromCanvas({place[0] - left}, {place[1] - top})"
    )
    page.page.mouse.move(*place)
    page.page.mouse.wheel(0, -700)
    page.page.wait_for_function(
        "JSON.parse(document.documentElement.dataset.poseviewerView).zoom > 2"
    )
    np.testing.assert_allclose(page.on_screen(under, DEMO_PHOTO), place, atol=0.01)
    page.page.mouse.down(button="right")
    page.page.mouse.move(place[0] + 40, place[1] - 25, steps=4)
    page.page.mouse.up(button="right")
    moved = page.on_screen(under, DEMO_PHOTO)
    np.testing.assert_allclose(moved, (place[0] + 40, place[1] - 25), atol=0.01)
    page.page.keyboard.press("f")
    page.page.wait_for_function(
        "JSON.parse(document.documentElement.dataset.poseviewerView).zoom === 1"
    )


def demo_pins(numbers: list[float]) -> np.ndarray:
    """(3, 2): where the paper's numbers put the pins, by hand."""
    mu, delta, psi = np.array(numbers).reshape(3, 2)
    size = np.array(DEMO_PHOTO)
    return np.array([mu * size, (mu + delta) * size, mu * size + 0.25 * min(DEMO_PHOTO) * psi])


def test_each_pin_is_its_two_numbers(page: AppPage, demo: AppProcess):
    path = demo.folder / "demo_photo.pose.json"
    page.page.keyboard.press("r")
    for pin, shift in ((0, (9.0, -7.0)), (1, (-12.0, 5.0)), (2, (6.0, 8.0))):
        before = page.saved_pose(path)["chart"]["numbers"]
        pins = demo_pins(before)
        page.drag(pins[pin], pins[pin] + np.array(shift), DEMO_PHOTO)
        page.page.wait_for_timeout(300)
        after = page.saved_pose(path)["chart"]["numbers"]
        moved = demo_pins(after)
        others = [i for i in range(3) if i != pin]
        np.testing.assert_allclose(moved[pin], pins[pin] + np.array(shift), atol=0.8)
        np.testing.assert_allclose(moved[others], pins[others], atol=1e-6)
        changed = np.abs(np.array(after) - before) > 1e-9
        if pin:
            own = [2, 3] if pin == 1 else [4, 5]
            assert list(np.flatnonzero(changed)) == own
    for _ in range(3):
        page.page.keyboard.press("z")


FIRST_CELL = """() => {
    const cell = document.querySelector(".pv-cell");  // maps that are drawn anew replace it
    const box = cell === null ? { width: 0 } : cell.getBoundingClientRect();
    return box.width > 0 ? [box.x, box.y, box.width, box.height] : null;
}"""


def test_a_press_on_a_map_moves_the_pose_and_undo_brings_it_back(page: AppPage, demo: AppProcess):
    path = demo.folder / "demo_photo.pose.json"
    before = page.saved_pose(path)["chart"]["numbers"]
    page.page.wait_for_function("document.querySelectorAll('.pv-cell image').length === 15")
    # Dimmed maps are about the pose before, and that is where a press on them leads.
    page.page.wait_for_function("document.querySelector('.pv-dim') === null")
    x, y, width, height = page.page.wait_for_function(FIRST_CELL).json_value()
    page.page.mouse.click(x + 0.75 * width, y + 0.25 * height)
    page.page.wait_for_timeout(500)
    after = page.saved_pose(path)["chart"]["numbers"]
    changed = np.flatnonzero(np.abs(np.array(after) - before) > 1e-9)
    assert list(changed) == [0, 1]
    assert after[0] > before[0]
    assert after[1] > before[1]  # upwards on the map is more
    page.page.keyboard.press("z")
    page.page.wait_for_timeout(300)
    assert page.saved_pose(path)["chart"]["numbers"] == before


def test_a_saved_pose_loads_to_the_last_digit(page: AppPage, demo: AppProcess, tmp_path: Path):
    path = demo.folder / "demo_photo.pose.json"
    page.page.keyboard.press("ArrowRight")
    page.page.keyboard.press("Shift+J")
    saved = page.saved_pose(path)
    kept = tmp_path / "kept.json"
    kept.write_text(json.dumps(saved))
    page.page.keyboard.press("ArrowDown")
    page.page.wait_for_timeout(200)
    assert page.saved_pose(path)["camera_from_model"] != saved["camera_from_model"]
    page.page.reload()
    page.page.wait_for_function("window.poseviewer")
    with page.page.expect_file_chooser() as chooser:
        page.page.get_by_role("button", name="Pose file ...").click()
    chooser.value.set_files(str(kept))
    page.page.wait_for_timeout(1500)
    again = page.saved_pose(path)
    assert again["camera_from_model"] == saved["camera_from_model"]
    assert again["camera"] == saved["camera"]


DROP = """(files) => {
    const held = new DataTransfer();
    for (const [name, text] of files) held.items.add(new File([text], name));
    const event = { dataTransfer: held, bubbles: true, cancelable: true };
    const canvas = window.__viserMutable.canvas;
    const over = canvas.dispatchEvent(new DragEvent("dragover", event));
    return [over, canvas.dispatchEvent(new DragEvent("drop", event))];
}"""


def test_files_can_be_dropped_on_the_page(page: AppPage, demo: AppProcess):
    path = demo.folder / "demo_photo.pose.json"
    saved = page.saved_pose(path)
    page.page.keyboard.press("ArrowDown")
    page.wait_for_text("● unsaved changes")
    # "false": the browser is kept from opening the files itself.
    dropped = [["kept.JSON", json.dumps(saved)], ["notes.txt", "no pose"]]
    assert page.page.evaluate(DROP, dropped) == [False, False]
    page.wait_for_text("notes.txt: not the name of a photo, a model or a pose file")
    page.page.wait_for_timeout(1000)
    assert page.saved_pose(path)["camera_from_model"] == saved["camera_from_model"]


def test_a_file_that_is_too_large_is_not_sent(page: AppPage, tmp_path: Path):
    huge = tmp_path / "huge.ply"
    with huge.open("wb") as file:
        file.truncate(200_000_001)
    with page.page.expect_file_chooser() as chooser:
        page.page.get_by_role("button", name="Model ...").click()
    chooser.value.set_files(str(huge))
    page.wait_for_text("huge.ply: 200,000,001 bytes; up to 200,000,000 can be uploaded")
    assert page.page.get_by_text("Uploading").count() == 0


def test_the_help_has_the_keys_until_it_is_closed(page: AppPage):
    for closing in ("Escape", "?"):
        page.page.keyboard.press("?")
        page.wait_for_text("turn it as a ball about its centre")
        page.page.keyboard.press("g")  # would show the rings
        page.page.keyboard.press(closing)
        page.page.get_by_role("dialog").wait_for(state="detached")
    assert not page.page.get_by_label("Rotation rings (G)").is_checked()


def test_two_tabs_agree(page: AppPage, browser: Browser, demo: AppProcess):
    other = AppPage(browser, demo.url)
    try:
        for tab in (page, other):
            tab.page.get_by_text("Numbers", exact=True).click()
        page.drag((450.0, 400.0), (480.0, 410.0), DEMO_PHOTO)
        page.page.wait_for_timeout(1500)
        shown = [
            [field.input_value() for field in tab.page.locator("input[inputmode]").all()]
            for tab in (page, other)
        ]
        assert shown[0] == shown[1]
        assert len(shown[0]) >= 6
        page.page.keyboard.press("z")
    finally:
        other.page.close()


def test_a_search_ends_where_the_command_line_ends(page: AppPage, demo: AppProcess):
    with page.page.expect_file_chooser() as chooser:  # another test may have set the start
        page.page.get_by_role("button", name="Pose file ...").click()
    chooser.value.set_files(str(demo_case("perspective").start))
    page.page.wait_for_timeout(1500)
    page.page.get_by_text("Settings", exact=True).click()
    limit = page.page.get_by_label("Most evaluations")
    limit.fill(str(EVALUATIONS))
    limit.press("Enter")
    page.page.wait_for_timeout(500)
    page.page.evaluate("document.activeElement.blur()")
    page.page.keyboard.press("Space")
    page.wait_for_text("Stopped at the limit of evaluations")
    found = page.saved_pose(demo.folder / "demo_photo.pose.json")
    case = demo_case("perspective")
    registration = load_registration(case.photo, case.model, case.start)
    problem, _ = make_problem(registration, FitSettings(limits=Limits(EVALUATIONS)))
    (last,) = deque(fit_pose(problem, SoftwareRenderer(registration.mesh)), maxlen=1)
    # The file's numbers are worked out from the pose: they may differ in the last digit.
    np.testing.assert_allclose(found["chart"]["numbers"], last.numbers, rtol=1e-12)
    assert found["loss"] == last.loss
    page.page.get_by_role("button", name="Go back").click()


OFFER = "An earlier session ended without saving"


def change_and_crash(tab: AppPage, app: AppProcess) -> None:
    """Change the pose, search, and kill the app once it has kept the session."""
    tab.page.keyboard.press("Shift+ArrowRight")
    tab.page.keyboard.press("Space")
    sessions = app.folder / "state" / "sessions"
    for _ in range(400):
        if any(sessions.glob("session-*.json")):  # not the file that it is written to first
            break
        tab.page.wait_for_timeout(50)
    assert any(sessions.glob("session-*.json"))
    app.kill()


def test_a_session_that_was_killed_is_offered_again(browser: Browser, tmp_path: Path, scene: Scene):
    files = (scene.photo, scene.model, "--pose", scene.start)
    with AppProcess(tmp_path, *files) as app:
        tab = AppPage(browser, app.url)
        change_and_crash(tab, app)
        tab.page.close()
    with AppProcess(tmp_path, *files) as again:
        tab = AppPage(browser, again.url)
        tab.page.get_by_role("button", name="Open it again").click()
        tab.wait_for_text("unsaved changes")
        tab.page.close()


def test_a_server_restart_brings_the_page_back(browser: Browser, tmp_path: Path, scene: Scene):
    files = (scene.photo, scene.model, "--pose", scene.start)
    with AppProcess(tmp_path, *files) as app:
        tab = AppPage(browser, app.url)
        tab.wait_for_text("at this pose")
        tab.page.evaluate("window.poseviewer.zoomAt(200, 300, 1.7)")
        view = tab.view()
        change_and_crash(tab, app)
    port = int(app.url.rstrip("/").rpartition(":")[2])
    with AppProcess(tmp_path, *files, port=port) as again:
        assert again.url == app.url
        tab.page.get_by_text(OFFER).wait_for()
        tab.page.get_by_role("button", name="Forget it").click()
        tab.page.get_by_text(OFFER).wait_for(state="hidden")
        tab.wait_for_text("at this pose")
        # The new server's page: what is done on it comes through, and it draws what comes back.
        tab.page.get_by_text("no unsaved changes").wait_for()
        now = tab.view()
        assert (now["zoom"], now["centre"]) == (view["zoom"], view["centre"])
        picture = tab.settled_picture()
        tab.page.keyboard.press("ArrowRight")
        tab.page.get_by_text("● unsaved changes").wait_for()
        tab.page.wait_for_timeout(500)
        assert not np.array_equal(tab.settled_picture(), picture)
        assert tab.errors == []
        tab.page.close()


def test_the_saved_file_is_a_pose_of_the_photo(page: AppPage, demo: AppProcess):
    path = demo.folder / "demo_photo.pose.json"
    page.saved_pose(path)
    photo = load_photo(demo_case("perspective").photo)
    record = load_pose(path, photo.width, photo.height)
    assert record.photo is not None
    assert record.photo.sha256 == photo.sha256
