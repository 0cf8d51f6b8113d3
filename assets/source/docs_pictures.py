"""The pictures of ``assets/docs``, from the bundled demo, with poseviewer's own commands.

Run from the repository's root: ``python -m assets.source.docs_pictures [NAME ...]``; without names
it makes all of them, in minutes. Those of pages need chromium.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import trimesh
from PIL import Image

from assets.source.app_pictures import PHOTO, open_app, settle, shot_of
from poseviewer.cli.main import main as poseviewer
from poseviewer.files.demo import demo_case
from poseviewer.files.marks import PointPairs
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import PhotoReference, PoseRecord, load_pose, save_pose
from poseviewer.files.scene import ObjectRecord, SceneRecord, save_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.starts.placing import surface_point
from poseviewer.starts.point_pairs import start_from_pairs
from poseviewer.starts.registration import StartCamera, StartInputs
from tests.app.browser import AppPage, open_browser
from tests.app.groceries import make_groceries
from tests.view_sets import write_views

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "pictures"
QUALITY, WIDTH, GAP = 80, 640, 6
WINDOW, LARGE_WINDOW = (1280, 720), (1440, 900)
"""CSS px of pages; the large one has room for two landscapes."""
LENS = Lens("opencv", (-0.28, 0.09, 0.0004, -0.0002, -0.01))
SPOTS = ((180.0, 420.0), (420.0, 300.0), (780.0, 380.0), (540.0, 460.0))
POST, POST_RADIUS, POST_FOOT = 560.0, 26.0, 665.0
"""Of a post in front of the car, px: its middle, half its width, where it stands."""
REGION = ((140.0, 220.0), (810.0, 550.0))
"""Two corners, px."""


def run(*arguments: object) -> None:
    """One command; anything but success ends the script."""
    if code := poseviewer([str(argument) for argument in arguments]):
        raise SystemExit(code)


def save(name: str, *pictures: np.ndarray | Path) -> None:
    """RGB pictures side by side, each ``WIDTH`` px wide (alone: 900), as JPEG."""
    width = WIDTH if len(pictures) > 1 else 900
    found = [
        Image.open(p).convert("RGB") if isinstance(p, Path) else Image.fromarray(p)
        for p in pictures
    ]
    height = min(round(p.height * width / p.width) for p in found)
    sheet = Image.new("RGB", (len(found) * (width + GAP) - GAP, height), "white")
    for index, picture in enumerate(found):
        small = picture.resize((width, round(picture.height * width / picture.width)))
        sheet.paste(small, (index * (width + GAP), 0))
    FOLDER.mkdir(exist_ok=True)
    sheet.save(FOLDER / f"{name}.jpg", quality=QUALITY, optimize=True)


def lens(folder: Path) -> None:
    """The demo's photo as a lens would have taken it, and that photo undistorted."""
    case = demo_case()
    photo = load_photo(case.photo)
    camera = load_pose(case.truth, photo.width, photo.height).pose.camera
    assert isinstance(camera, Perspective)
    # A longer lens than the demo's, so that its photo has nothing to show beyond the demo's.
    camera = replace(camera, fx=1.15 * camera.fx, fy=1.15 * camera.fy)
    known = load_pose(case.truth, photo.width, photo.height).pose.camera
    assert isinstance(known, Perspective)
    undistortion = Undistortion(LENS, camera, known)
    rows, columns = np.mgrid[: photo.height, : photo.width] + 0.5
    points = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    where = undistortion.from_taken(points).reshape(*rows.shape, 2).astype(np.float32) - 0.5
    taken = cv2.remap(photo.pixels, where[..., 0], where[..., 1], cv2.INTER_CUBIC)
    Image.fromarray(taken).save(folder / "taken.png")
    write_calibration(folder / "camera.yml", camera)
    run("undistort", folder / "taken.png", "--calibration", folder / "camera.yml",
        "--out", folder / "flat.png")  # fmt: skip
    save("lens", folder / "taken.png", folder / "flat.png")


def write_calibration(path: Path, camera: Perspective) -> None:
    """As OpenCV's calibration sample writes it: pixel centres at integers."""
    matrix = np.array([[camera.fx, 0, camera.cx - 0.5], [0, camera.fy, camera.cy - 0.5], [0, 0, 1]])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", LENS.array.reshape(-1, 1))
    storage.release()


def export(folder: Path) -> None:
    """The model's vertices, drawn by OpenCV from the file that ``convert`` wrote for it."""
    case = demo_case()
    run("convert", case.truth, "--to", "opencv", folder / "pose.yml")
    storage = cv2.FileStorage(str(folder / "pose.yml"), cv2.FILE_STORAGE_READ)
    fields = ("rvec", "tvec", "camera_matrix", "distortion_coefficients")
    rvec, tvec, matrix, distortion = (storage.getNode(field).mat() for field in fields)
    points = np.ascontiguousarray(load_mesh(case.model).vertices[::7])
    seen, _ = cv2.projectPoints(points, rvec, tvec, matrix, distortion)
    picture = np.array(Image.open(case.photo).convert("RGB"))
    for x, y in np.rint(seen[:, 0]).astype(int):
        cv2.circle(picture, (int(x), int(y)), 1, (255, 220, 0), -1)
    save("export", picture)


def pairs(folder: Path) -> None:
    """Four places on the demo's photo, to a pixel, and the start that they give."""
    case = demo_case()
    photo, mesh = load_photo(case.photo), load_mesh(case.model)
    truth = load_pose(case.truth, photo.width, photo.height).pose
    found = [surface_point(mesh, truth, spot) for spot in SPOTS]
    points = np.array([point for point in found if point is not None])
    pixels = np.rint(truth.project(points))
    material = StartInputs(photo, mesh, None)
    start = start_from_pairs(material, PointPairs(points, pixels), StartCamera(focal_px=1333.0))
    save_pose(folder / "start.json", PoseRecord(start.pose))
    run("overlay", case.photo, case.model, "--pose", folder / "start.json",
        "--out", folder / "start.png", "--quiet")  # fmt: skip
    marked = np.array(photo.as_rgb8(photo.width, photo.height))
    for number, (x, y) in enumerate(pixels.astype(int).tolist(), 1):
        cv2.drawMarker(marked, (x, y), (255, 220, 0), cv2.MARKER_CROSS, 34, 4)
        cv2.putText(marked, str(number), (x + 14, y - 12), cv2.FONT_HERSHEY_SIMPLEX, 1.3,
                    (255, 220, 0), 4)  # fmt: skip
    save("pairs", marked, folder / "start.png")


def looks(folder: Path) -> None:
    """The demo's start, and the residual at its true pose."""
    case = demo_case()
    jobs = (("start", case.start, "outline"), ("residual", case.truth, "residual"))
    for name, pose, look in jobs:
        run("overlay", case.photo, case.model, "--pose", pose, "--look", look,
            "--out", folder / f"{name}.png", "--quiet")  # fmt: skip
    save("library", folder / "start.png", folder / "residual.png")


def report(folder: Path) -> None:
    """The report of a batch of two rows, one of which fails, as a browser shows it."""
    case = demo_case()
    with (folder / "jobs.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["photo", "model", "start"])
        rows.writerow(["001.jpg", "car.glb", "start.json"])
        rows.writerow(["002.jpg", "car.glb", "start.json"])
    keypoints = case.model.with_suffix(".keypoints.json")
    files = {"001.jpg": case.photo, "car.glb": case.model, "start.json": case.start}
    for name, path in (files | {"car.keypoints.json": keypoints}).items():
        (folder / name).write_bytes(path.read_bytes())
    (folder / "002.jpg").write_text("not a photo")
    poseviewer(["batch", str(folder / "jobs.csv"), "--out", str(folder / "results"),
                "--processes", "1", "--quiet"])  # fmt: skip
    with open_browser() as browser:
        page = browser.new_page(viewport={"width": 1180, "height": 400}, color_scheme="light")
        page.goto((folder / "results" / "report.html").as_uri())
        page.wait_for_load_state()
        picture = Image.open(BytesIO(page.screenshot(full_page=True))).convert("RGB")
        picture.save(FOLDER / "report.jpg", quality=QUALITY, optimize=True)


def wheels(folder: Path) -> None:
    """Wheels that the app found in a region."""
    case = demo_case()
    with open_app(folder, WINDOW, case.photo, case.model, maps="away") as tab:
        tab.page.get_by_text("Quick start", exact=True).click()
        tab.page.get_by_role("button", name="Find wheels: draw a region").click()
        tab.wait_for_text("drag a rectangle on the photo")
        tab.drag(*REGION, PHOTO)
        tab.page.get_by_role("button", name="Find wheels in the region").click()
        tab.wait_for_text("10 of 10 points on the rims")
        settle(tab)
        save_page("quick_start_wheels", tab)


def box(folder: Path) -> None:
    """The first proposal in a rectangle about the demo's car."""
    case = demo_case()
    with open_app(folder, WINDOW, case.photo, case.model, maps="away") as tab:
        tab.page.get_by_role("button", name="Fit to box").click()
        tab.wait_for_text("drag a rectangle about the object")
        tab.drag(*REGION, PHOTO)
        tab.wait_for_text("proposal 1 of")
        settle(tab)
        save_page("box", tab)


def methods(folder: Path) -> None:
    """The paper's search under way on the demo, with the maps of both losses."""
    with open_app(folder, LARGE_WINDOW, maps="beside") as tab:
        tab.open_step(3)
        for label, option in (("Method", "Jayawardena 2010"), ("Whose loss", "both")):
            tab.page.get_by_label(label, exact=True).click()
            tab.page.get_by_role("option", name=option, exact=True).click()
        tab.page.get_by_label("Outlines of the candidates").check()
        settle(tab)
        tab.page.mouse.move(600, 60)  # no tooltip stays
        tab.page.keyboard.press("Space")
        # A little into the first restart, while its simplex is still wide.
        tab.page.wait_for_function(
            """() => {
                const said = document.body.innerText.match(/(\\d+) evaluations, restart (\\d+)/);
                if (!said || said[2] === "0") return false;
                window.begun ??= Number(said[1]);
                return said[1] - window.begun >= 12;
            }"""
        )
        save_page("methods", tab)


def sure(folder: Path) -> None:
    """The demo's pose found, how sure it is, and its region on near maps."""
    with open_app(folder, LARGE_WINDOW, maps="beside") as tab:
        tab.page.keyboard.press("Space")
        tab.wait_for_text("Verdict:")
        tab.open_step(4)
        near = "xpath=//*[text()='Range ± %']/following::input[not(@type='hidden')][1]"
        tab.page.locator(near).fill("4")
        tab.page.keyboard.press("Enter")
        settle(tab)
        save_page("sure", tab)


def which_model(folder: Path) -> None:
    """The demo's car told from two that it is not."""
    case = demo_case()
    others = [folder / "longer.glb", folder / "higher.glb"]
    for path, stretch in zip(others, ((1.15, 1.0, 1.0), (1.0, 1.0, 1.2)), strict=True):
        car = trimesh.load_scene(case.model)
        car.apply_transform(np.diag([*stretch, 1.0]))
        car.export(str(path))
    files = case.photo, others[0], others[1], case.model
    with open_app(folder, WINDOW, *files, "--pose", case.start, maps="away") as tab:
        tab.open_step(4)
        tab.page.get_by_text("Which model is it?", exact=True).click()
        tab.page.get_by_role("button", name="Tell them apart").click()
        tab.wait_for_text("Press a row to see its fit")
        settle(tab)
        save_page("which_model", tab)


def hide(folder: Path) -> None:
    """A post drawn in front of the demo's car, hidden by a scribble."""
    case, path = demo_case(), folder / "post.png"
    cv2.imwrite(str(path), with_post(np.asarray(cv2.imread(str(case.photo)))))
    with open_app(folder, WINDOW, path, case.model, "--pose", case.truth, maps="away") as tab:
        tab.open_step(3)
        tab.page.keyboard.press("h")
        tab.page.get_by_role("button", name="Scribble").click()
        tab.wait_for_text("Scribble:")
        tab.drag((POST, 60.0), (POST, 640.0), PHOTO)
        tab.wait_for_text("of the photo is hidden")
        tab.page.mouse.move(*tab.on_screen((POST + 90.0, 330.0), PHOTO))
        settle(tab)
        save_page("hide", tab)


def with_post(photo: np.ndarray) -> np.ndarray:
    """The photo (height, width, 3) with a painted post from above its upper edge to the ground,
    round by its shading, blurred and noisy as the photo is.
    """
    v, u = np.mgrid[: photo.shape[0], : photo.shape[1]].astype(float)
    across = (u - POST) / POST_RADIUS
    is_post = (np.abs(across) < 1.0) & (v < POST_FOOT)
    cover = cv2.GaussianBlur(is_post.astype(float), (0, 0), 0.8)[..., None]
    light = 0.35 + 0.65 * np.clip(0.9 * np.sqrt(np.clip(1.0 - across**2, 0.0, 1.0)), 0.0, 1.0)
    paint = light[..., None] * np.array([70.0, 140.0, 90.0])
    paint += np.random.default_rng(0).normal(0.0, 3.0, paint.shape)
    return np.clip(np.rint(cover * paint + (1.0 - cover) * photo), 0, 255).astype(np.uint8)


def objects(folder: Path) -> None:
    """Three boxes in one photo, each fitted among the others."""
    shelf = make_groceries(folder / "shelf")
    size = shelf.truths[0].camera.width, shelf.truths[0].camera.height
    photo = PhotoReference("shelf.png", *size)
    boxes = [
        ObjectRecord(str(number), model, PoseRecord(pose, photo))
        for number, (model, pose) in enumerate(zip(shelf.models, shelf.truths, strict=True), 1)
    ]
    scene = folder / "shelf" / "shelf.scene.json"
    save_scene(scene, SceneRecord(shelf.photo, photo, shelf.truths[0].camera, tuple(boxes)))
    with open_app(folder, WINDOW, scene, maps="away") as tab:
        tab.open_step(3)
        tab.page.get_by_role("button", name="Search all").click()
        tab.page.get_by_role("button", name="Keep it").click()
        settle(tab)
        save_page("objects", tab)


def views(folder: Path) -> None:
    """A shape in three photos, and its pose found in all three at once."""
    of_set, model, start = write_views(folder)
    files = "--views", of_set, model, "--pose", start
    with open_app(folder, LARGE_WINDOW, *files, maps="below") as tab:
        tab.page.keyboard.press("Space")
        tab.wait_for_text("Verdict:")
        settle(tab)
        save_page("views", tab)


def save_page(name: str, tab: AppPage) -> None:
    """What a page shows, as it is, as JPEG."""
    shot_of(tab).save(FOLDER / f"{name}.jpg", quality=QUALITY, optimize=True)


PICTURES = {
    "lens": lens,
    "export": export,
    "library": looks,
    "pairs": pairs,
    "report": report,
    "quick_start_wheels": wheels,
    "box": box,
    "methods": methods,
    "sure": sure,
    "which_model": which_model,
    "objects": objects,
    "hide": hide,
    "views": views,
}


def main() -> None:
    """Make the pictures that are named, or all."""
    for name in sys.argv[1:] or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            PICTURES[name](Path(folder))


if __name__ == "__main__":
    main()
