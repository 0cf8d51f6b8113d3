"""Make the pictures of the README and of the docs' pages: ``python -m tests.measure.pictures``.

Run it from the repository's root, with names of ``PICTURES`` to make those alone. All are made from
the bundled demo by the library, the command line, or the real app in chromium.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from assets.source.data_folder import ROOT
from poseviewer import load
from poseviewer.app.state.dragging import rotate
from poseviewer.cli.main import main as command_line
from poseviewer.confidence.verdict import LABELS
from poseviewer.evaluation.cases import Case
from poseviewer.files.demo import demo_case
from poseviewer.files.marks import PointPairs
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.placing import surface_point
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.types import PlacedModel
from poseviewer.starts.point_pairs import start_from_pairs
from poseviewer.starts.start import StartCamera
from tests.app.app_process import AppProcess
from tests.app.browser import AppPage, open_browser
from tests.lenses import as_taken, write_camera
from tests.measure.jobs import Hand, mark_wheels, save_demo_without_wheels
from tests.measure.still import LARGE as LARGE_CAMERA
from tests.measure.still import draw_room, models
from tests.several import LIGHT, lit_models, make_three, save_model
from tests.still_scene import MARKER
from tests.view_sets import BOX, BOX_TRUTH, CAMERA, MESH, TRUTH, write_two, write_views

ASSETS = ROOT / "assets"
README, DOCS = ASSETS / "readme", ASSETS / "docs" / "pictures"
DEMO, PHOTO = demo_case(), (960, 720)
QUALITY = 74
"""Quality of a JPEG."""
WIDTH = 640
GAP = 6
"""px: width of each picture of a sheet, and gap between two of them."""
SMALL = (1120, 640)
WITHOUT_MAPS = 0, 986
"""Columns of ``WINDOW`` beside the panel of the maps, px."""
WINDOW, LARGE = (1280, 720), (1440, 900)
"""CSS px of the app's window; the large one has room for the maps of two losses."""
SETTLED_S = 12
"""A page that has not changed for so long is settled."""
MAX_SECONDS = 150
"""Longest wait for a settled page."""
MAX_WAIT_S = 600
"""Longest wait for the end of a search."""
SHOWN = """() => document.querySelector(".pv-dim") ? "" : [
    ...[...document.querySelectorAll(".pv-cell image")].map((map) => map.getAttribute("href")),
    document.body.innerText].join()"""
"""Maps and texts of a page; "" while the maps are about another pose."""
EVALUATIONS = """least => {
    const said = document.body.innerText.match(/(\\d+) evaluations/);
    return said && Number(said[1]) >= least;
}"""
WIDE_SIMPLEX = """() => {
    const said = document.body.innerText.match(/(\\d+) evaluations, restart (\\d+)/);
    if (!said || said[2] === "0") return false;
    window.begun ??= Number(said[1]);
    return said[1] - window.begun >= 12;
}"""
"""A little into the first restart."""
PIN = """() => {
    const { e, f } = document.querySelectorAll(".pv-pin")[1].transform.baseVal[0].matrix;
    return [e, f];
}"""
"""Place of the front wheel's pin, px of the photo."""
NOT_PLACED = "is not placed yet"
"""Text of a page whose model is nowhere yet."""
NEAR = "xpath=//*[text()='Range ± %']/following::input[not(@type='hidden')][1]"
LENS = Lens("opencv", (-0.28, 0.09, 0.0004, -0.0002, -0.01))
SPOTS = ((180.0, 420.0), (420.0, 300.0), (780.0, 380.0), (540.0, 460.0))
"""Point pairs on the demo's photo, px."""
POST = (534, 586, 665)
"""Left, right and lower end of a post in front of the car, px."""
FRAMES = 16
"""Frames of the sequence."""
CAR = slice(190, 570), slice(120, 830)
"""Rows and columns of the photo about the car."""
TINT = (0.72, 0.66, 0.86)
"""RGB of what a photo does not paint."""
REGION = ((140.0, 220.0), (810.0, 550.0))
"""Two corners of a rectangle about the car, px."""


def save(path: Path, picture: Image.Image, quality: int = QUALITY) -> None:
    """Write a picture as JPEG."""
    picture.save(path, quality=quality, optimize=True, progressive=True)


def save_sheet(path: Path, *pictures: np.ndarray, width: int = WIDTH) -> None:
    """Write RGB pictures in two columns of a width, px."""
    height = min(round(p.shape[0] * width / p.shape[1]) for p in pictures)
    rows = (len(pictures) + 1) // 2
    sheet = Image.new("RGB", (2 * width + GAP, rows * (height + GAP) - GAP), "white")
    for index, picture in enumerate(pictures):
        row, column = divmod(index, 2)
        small = Image.fromarray(picture).resize((width, height))
        sheet.paste(small, (column * (width + GAP), row * (height + GAP)))
    save(path, sheet)


@contextmanager
def open_app(
    folder: Path,
    *arguments: str | Path,
    size: tuple[int, int] = WINDOW,
    first: str = "at this pose",
) -> Iterator[AppPage]:
    """Open the app's page, dark, and wait for its ``first`` text, by default the loss."""
    with open_browser() as browser, AppProcess(folder, *arguments, has_fine_maps=True) as app:
        tab = AppPage(browser, app.url, size, pixel_ratio=1.0, color_scheme="dark")
        tab.page.set_default_timeout(1000 * MAX_WAIT_S)
        tab.wait_for_text(first)
        yield tab


def save_page(
    path: Path, tab: AppPage, settled: bool = True, columns: tuple[int, int] | None = None,
    quality: int = QUALITY,
) -> None:  # fmt: skip
    """Write what the page shows, or its columns of px, once it has not changed for a while."""
    before, still = "", 0
    for _ in range(MAX_SECONDS if settled else 0):
        tab.page.wait_for_timeout(1000)
        now = tab.page.evaluate(SHOWN)
        still = still + 1 if now and now == before else 0
        before = now
        if still == SETTLED_S:
            break
    if settled:
        tab.settled_picture()
    picture = Image.open(BytesIO(tab.page.screenshot())).convert("RGB")
    left, right = columns or (0, picture.width)
    save(path, picture.crop((left, 0, right, picture.height)), quality)


def press(tab: AppPage, button: str) -> None:
    """Press a button of the panel."""
    tab.page.get_by_role("button", name=button).click()


def make_search(_folder: Path) -> None:
    """The README's animation: the outline wherever the search finds a better pose."""
    registration = load(DEMO.photo, DEMO.model, DEMO.start)
    *_, end = registration.search()
    pictures = (registration.at(better.pose).picture() for better in end.improvements)
    frames = [Image.fromarray(picture).resize((800, 600)) for picture in pictures]
    frames[0].save(
        README / "search.webp",
        save_all=True,
        append_images=frames[1:],
        duration=[*[160] * (len(frames) - 1), 1500],
        loop=0,
        quality=72,
    )


def make_demo(folder: Path) -> None:
    """Start and end of the demo's fit, relit model, residual, and the loss about the end."""
    result = load(DEMO.photo, DEMO.model, DEMO.start).fit()
    drawn = [result.picture(look) for look in ("outline", "relit", "residual")]
    save_sheet(README / "demo.jpg", result.start.picture(), *drawn)
    save_sheet(DOCS / "library.jpg", result.start.picture(), drawn[2])
    result.landscape(size=21).save(folder / "maps.png")
    maps = Image.open(folder / "maps.png").convert("RGB")
    maps.quantize(256).save(README / "landscape.png", optimize=True)


def make_app(folder: Path) -> None:
    """The app's page on the way from the demo's start to its end."""
    with open_app(folder, size=(1440, 720)) as tab:
        save_page(README / "app_start.jpg", tab)
        pin = tab.page.evaluate(PIN)
        tab.page.mouse.move(*tab.on_screen(pin, PHOTO))
        tab.page.mouse.down()
        tab.page.mouse.move(*tab.on_screen((pin[0] + 40, pin[1] + 40), PHOTO), steps=8)
        save_page(README / "app_pins.jpg", tab)
        tab.page.keyboard.press("Escape")
        tab.page.mouse.up()
        tab.open_step(3)
        tab.page.keyboard.press("r")
        tab.page.keyboard.press("Space")
        tab.page.wait_for_function(EVALUATIONS, arg=400)  # the population is still wide
        save_page(README / "app_search.jpg", tab, settled=False)
        tab.wait_for_text("Verdict:")
        tab.open_step(4)
        save_page(README / "app_found.jpg", tab)
        for key, name in (("3", "relit"), ("5", "residual")):
            tab.page.keyboard.press(key)
            save_page(README / f"app_{name}.jpg", tab)
        tab.page.keyboard.press("1")
        tab.page.locator(".pv-cell button").nth(1).click()
        save_page(README / "app_large_map.jpg", tab)


def make_first(folder: Path) -> None:
    """The first minute: the demo, a photo and a model without a pose, its search, its camera."""
    with open_app(folder, size=SMALL) as tab:
        save_page(DOCS / "first_demo.jpg", tab)
    with open_app(folder, DEMO.photo, DEMO.model, size=SMALL, first=NOT_PLACED) as tab:
        tab.settled_picture()
        save_page(DOCS / "first_looking.jpg", tab, settled=False)
        tab.page.locator(".pv-starts button").first.wait_for()
        tab.settled_picture()
        save_page(DOCS / "first_proposal.jpg", tab, settled=False)
        tab.page.locator(".pv-starts button").first.click()
        press(tab, "Search (space)")
        tab.wait_for_text("Verdict:")
        save_page(DOCS / "first_verdict.jpg", tab)
        press(tab, "Keep it")
        tab.open_step(2)
        tab.page.get_by_text("Camera", exact=True).click()
        tab.page.get_by_label("cy (px)").scroll_into_view_if_needed()
        save_page(DOCS / "first_camera.jpg", tab)


def make_lens(folder: Path) -> None:
    """The demo's photo as a longer lens with distortion takes it, and that photo undistorted."""
    photo = load_photo(DEMO.photo)
    known = load_pose(DEMO.truth, *PHOTO).pose.camera
    assert isinstance(known, Perspective)
    camera = replace(known, fx=1.15 * known.fx, fy=1.15 * known.fy)
    taken = as_taken(Undistortion(LENS, camera, known), photo.pixels)
    Image.fromarray(taken).save(folder / "taken.png")
    write_camera(folder / "camera.yml", camera, LENS)
    words = ("undistort", "taken.png", "--calibration", "camera.yml", "--out", "flat.png")
    assert command_line([str(folder / word) if "." in word else word for word in words]) == 0
    save_sheet(DOCS / "lens.jpg", taken, np.array(Image.open(folder / "flat.png").convert("RGB")))


def make_export(folder: Path) -> None:
    """The model's vertices, drawn by OpenCV from the file that ``convert`` wrote for it."""
    assert command_line(["convert", str(DEMO.truth), "--to", "opencv", f"{folder}/pose.yml"]) == 0
    storage = cv2.FileStorage(f"{folder}/pose.yml", cv2.FILE_STORAGE_READ)
    fields = ("rvec", "tvec", "camera_matrix", "distortion_coefficients")
    points = np.ascontiguousarray(load_model(DEMO.model).mesh.vertices[::7])
    turn, shift, camera, distortion = (storage.getNode(field).mat() for field in fields)
    pixels, _ = cv2.projectPoints(points, turn, shift, camera, distortion)
    picture = np.array(Image.open(DEMO.photo).convert("RGB"))
    for x, y in np.rint(pixels[:, 0]).astype(int).tolist():
        cv2.circle(picture, (x, y), 1, (255, 220, 0), -1)
    save(DOCS / "export.jpg", Image.fromarray(picture).resize((900, 675)))


def make_pairs(_folder: Path) -> None:
    """Four points on the demo's photo, to a pixel, and the start that they give."""
    model, truth = load_model(DEMO.model), load_pose(DEMO.truth, *PHOTO).pose
    points = np.array([surface_point(model.mesh, truth, spot) for spot in SPOTS], float)
    pairs, focal = PointPairs(points, np.rint(truth.project(points))), StartCamera(focal_px=1333.0)
    placed = load(DEMO.photo, model, lambda on: start_from_pairs(on, pairs, focal))
    marked = np.array(Image.open(DEMO.photo).convert("RGB"))
    yellow, font = (255, 220, 0), cv2.FONT_HERSHEY_SIMPLEX
    for number, (x, y) in enumerate(pairs.pixels.astype(int).tolist(), 1):
        cv2.drawMarker(marked, (x, y), yellow, cv2.MARKER_CROSS, 34, 4)
        cv2.putText(marked, str(number), (x + 14, y - 12), font, 1.3, yellow, 4)
    save_sheet(DOCS / "pairs.jpg", marked, placed.picture())


def make_report(folder: Path) -> None:
    """The report of a batch of two rows, one of which fails, as a browser shows it."""
    named = {"001.jpg": DEMO.photo, "car.glb": DEMO.model, "start.json": DEMO.start}
    for name, path in named.items():
        (folder / name).write_bytes(path.read_bytes())
    (folder / "002.jpg").write_text("not a photo")
    rows = [f"00{number}.jpg,car.glb,start.json\n" for number in (1, 2)]
    (folder / "jobs.csv").write_text("photo,model,start\n" + "".join(rows))
    command_line(["batch", f"{folder}/jobs.csv", "--out", f"{folder}/results", "--quiet"])
    with open_browser() as browser:
        page = browser.new_page(viewport={"width": 1180, "height": 400}, color_scheme="light")
        page.goto((folder / "results" / "report.html").as_uri())
        shot = page.screenshot(full_page=True)
        save(DOCS / "report.jpg", Image.open(BytesIO(shot)).convert("RGB"))


def make_wheels(folder: Path) -> None:
    """Wheels that the app found in a region."""
    with open_app(folder, DEMO.photo, DEMO.model, first=NOT_PLACED) as tab:
        press(tab, "Wheels")
        press(tab, "Find wheels: draw a region")
        tab.wait_for_text("drag a rectangle on the photo")
        tab.drag(*REGION, PHOTO)
        press(tab, "Find wheels in the region")
        tab.wait_for_text("space: search from here")
        save_page(DOCS / "quick_start_wheels.jpg", tab)


def make_marking(folder: Path) -> None:
    """The first of two wheels that are marked on the picture of a car without named wheels."""
    keypoints, truth = load_model(DEMO.model).keypoints, load_pose(DEMO.truth, *PHOTO).pose
    assert keypoints is not None
    case = Case("car", "", DEMO.photo, save_demo_without_wheels(folder / "car.glb"), truth)
    with open_app(folder, case.photo, case.mesh, size=SMALL, first=NOT_PLACED) as tab:
        mark_wheels(Hand(tab, [case], folder), keypoints, 1)
        tab.wait_for_text("middle of the front wheel")
        tab.settled_picture()
        save_page(DOCS / "marking.jpg", tab, settled=False, columns=(300, SMALL[0]))


def make_assumed(folder: Path) -> None:
    """A car found in a box by an assumed focal length, and the offer to find that, too."""
    photo = folder / "photo.jpg"
    Image.open(DEMO.photo).save(photo, quality=95)  # without EXIF
    with open_app(folder, photo, DEMO.model, size=SMALL, first=NOT_PLACED) as tab:
        press(tab, "Fit to box")
        tab.drag(*REGION, PHOTO)
        tab.wait_for_text("proposal 1 of")
        tab.page.keyboard.press("Space")
        tab.wait_for_text("Verdict:")
        save_page(DOCS / "assumed.jpg", tab)


def make_box(folder: Path) -> None:
    """The first proposal in a rectangle about the demo's car."""
    with open_app(folder, DEMO.photo, DEMO.model, first=NOT_PLACED) as tab:
        press(tab, "Fit to box")
        tab.wait_for_text("drag a rectangle about the object")
        tab.drag(*REGION, PHOTO)
        tab.wait_for_text("proposal 1 of")
        save_page(DOCS / "box.jpg", tab)


def make_methods(folder: Path) -> None:
    """The paper's search under way on the demo, with the maps of both losses."""
    with open_app(folder, size=LARGE) as tab:
        tab.open_step(3)
        for label, option in (("Loss", "Paper (2010)"), ("Maps of", "all")):
            tab.page.get_by_label(label, exact=True).click()
            tab.page.get_by_role("option", name=option, exact=True).click()
        tab.page.mouse.move(600, 60)  # no tooltip stays
        tab.page.locator(".pv-cell image").nth(29).wait_for()  # maps of both losses
        tab.page.keyboard.press("Space")
        tab.page.wait_for_function(WIDE_SIMPLEX)
        save_page(DOCS / "methods.jpg", tab, settled=False)


def make_searched(name: str, folder: Path) -> None:
    """A pose found, with its maps: how sure it is; or in three photos at once."""
    files: tuple[str | Path, ...] = ()
    if name == "views":
        of_set, model, start = write_views(folder)
        files = "--views", of_set, model, "--pose", start
    with open_app(folder, *files, size=LARGE) as tab:
        tab.page.keyboard.press("Space")
        tab.wait_for_text("Verdict:")
        if not files:
            tab.open_step(4)
            tab.page.locator(NEAR).fill("4")
            tab.page.keyboard.press("Enter")
        save_page(DOCS / f"{name}.jpg", tab)


def make_hide(folder: Path) -> None:
    """A post painted in front of the demo's car, hidden by a scribble."""
    photo, (left, right, foot) = np.array(Image.open(DEMO.photo).convert("RGB")), POST
    shade = 0.35 + 0.6 * np.sqrt(1.0 - np.linspace(-1.0, 1.0, right - left) ** 2)
    noise = np.random.default_rng(0).normal(0.0, 3.0, (foot, right - left, 3))
    photo[:foot, left:right] = np.outer(shade, [90.0, 140.0, 70.0]) + noise
    Image.fromarray(photo).save(folder / "post.png")
    middle = (left + right) / 2.0
    with open_app(folder, folder / "post.png", DEMO.model, "--pose", DEMO.truth) as tab:
        tab.open_step(3)
        tab.page.keyboard.press("h")
        press(tab, "Scribble")
        tab.wait_for_text("Scribble:")
        tab.drag((middle, 60.0), (middle, foot - 25.0), PHOTO)
        tab.wait_for_text("of the photo is hidden")
        tab.page.mouse.move(*tab.on_screen((middle + 90.0, 330.0), PHOTO))
        save_page(DOCS / "hide.jpg", tab)


def make_objects(folder: Path) -> None:
    """Three things in one photo, each fitted among the others."""
    with open_app(folder, make_three(folder)) as tab:
        tab.open_step(3)
        press(tab, "Search all")
        press(tab, "Keep it")
        save_page(DOCS / "objects.jpg", tab)


def make_two(folder: Path) -> None:
    """Two things in three photos, each placed in the first and fitted in all."""
    cameras, ball, box = write_two(folder)
    size = CAMERA.width, CAMERA.height
    with open_app(folder, "--views", cameras, ball, size=LARGE, first=NOT_PLACED) as tab:
        tab.fit_to_box(TRUTH[0].project(MESH.vertices), size)
        tab.add_object(box)
        tab.wait_for_text("not placed")
        tab.fit_to_box(BOX_TRUTH[0].project(BOX.vertices), size)
        tab.open_step(3)
        press(tab, "Search all")
        press(tab, "Keep it")
        save_page(DOCS / "two.jpg", tab)


def make_time_line(folder: Path) -> None:
    """The demo's car on its way through frames: propagated from the first, and mended in one."""
    (folder / "drive").mkdir()
    mesh, start = load_model(DEMO.model).mesh, load_pose(DEMO.truth, *PHOTO).pose.rescale(0.5)
    ground = cv2.GaussianBlur(np.array(Image.open(DEMO.photo).convert("RGB")), (0, 0), 24.0) / 255.0
    for index in range(FRAMES):
        turn = RigidTransform.from_rotation_vector([0.0, 0.05 * index, 0.0], np.zeros(3)).rotation
        now, centre = start.camera_from_model, start.camera_from_model.apply(mesh.centre)
        centre = centre + np.array([0.12 * index - 0.6, 0.0, 0.05 * index])
        rotation = turn @ now.rotation
        pose = Pose(start.camera, RigidTransform(rotation, centre - rotation @ mesh.centre))
        if index == 0:
            save_pose(folder / "start.json", PoseRecord.of(pose))
        random = np.random.default_rng(index)
        pixels = lit_models([PlacedModel(mesh, pose)], LIGHT, random, ground, 2.0)
        save_image(folder / "drive" / f"{index:04d}.png", pixels)
    with open_app(folder, folder / "drive", DEMO.model, "--pose", folder / "start.json") as tab:
        for button in ("graph", "to end"):
            press(tab, button)
        tab.wait_for_text("frames propagated")
        for _ in range(4):
            tab.page.keyboard.press(",")
        tab.wait_for_text(f"frame {FRAMES - 4}")
        size = start.camera.width, start.camera.height
        middle = size[0] / 2.0, size[1] / 2.0
        tab.drag(middle, (middle[0] + 2.0, middle[1]), size)
        tab.wait_for_text("· key")
        tab.page.mouse.move(0, 0)
        tab.settled_picture()
        left, _, width, _ = tab.view()["box"]
        clip = {"x": left, "y": 0, "width": width, "height": WINDOW[1]}
        shot = Image.open(BytesIO(tab.page.screenshot(clip=clip)))  # pyright: ignore
        save(DOCS / "time_line.jpg", shot.convert("RGB"), 60)


def make_table(folder: Path) -> None:
    """A film of a table: things are placed in one frame, found in all, and sent as a data set."""
    film, size = folder / "film", (LARGE_CAMERA.width, LARGE_CAMERA.height)
    film.mkdir()
    (first, *_), things = draw_room(film, FRAMES, True), models()
    shown = {
        name: LARGE_CAMERA.project(first.apply(thing.vertices)) for name, thing in things.items()
    }
    for name in ("box", "car"):
        thing = things[name]
        moved = replace(thing, vertices=thing.vertices - thing.centre)
        save_model(folder / f"{name}.ply", moved)

    def show(name: str) -> None:
        save_page(DOCS / f"table_{name}.jpg", tab, columns=WITHOUT_MAPS, quality=60)

    with open_app(folder, film, folder / "box.ply", first=f"frame 1 of {FRAMES}") as tab:
        tab.fit_to_box(shown["box"], size)
        tab.wait_for_text("· key")
        show("film")
        press(tab, "it stands still")
        tab.page.get_by_label("Markers' side").first.fill(f"{MARKER}")
        tab.page.get_by_label("Markers' side").first.blur()
        show("markers")
        press(tab, "Find the cameras")
        tab.wait_for_text(f"{FRAMES} of {FRAMES} pictures have cameras")
        tab.page.keyboard.press("Space")
        tab.wait_for_text("Verdict: ")
        show("found")
        tab.add_object(folder / "car.ply")
        tab.until(lambda: tab.verdicts().get("car.ply") == "not placed")
        tab.fit_to_box(shown["car"], size)
        tab.page.keyboard.press("Space")
        tab.until(lambda: tab.verdicts()["car.ply"] in LABELS)
        for _ in range(FRAMES - 1):
            tab.page.keyboard.press(".")
        tab.wait_for_text(f"photo {FRAMES} of {FRAMES}")
        show("two")
        tab.open_step(5)
        tab.page.get_by_label("Format", exact=True).first.click()
        tab.page.get_by_role("option", name="bop", exact=True).click()
        press(tab, "Export as")
        tab.wait_for_text("Numbers in BOP")
        show("bop")


def make_painted(_folder: Path) -> None:
    """The demo's car without its colours, painted from the photo: seen as there, and from both
    sides of it, with a tint where the photo shows nothing.
    """
    mesh, pose = load_model(DEMO.model).mesh, load_pose(DEMO.truth, *PHOTO).pose
    grey = {"colours": np.full((len(mesh.vertices), 3), 0.6), "textures": ()}
    bare = replace(mesh, **grey, face_texture=np.full(len(mesh.faces), -1))
    painting = load(DEMO.photo, ModelFile.of(bare), pose).paint().object.painting
    assert painting is not None
    panels = [np.array(Image.open(DEMO.photo).convert("RGB"))]
    for turn in (0.0, 0.7, -0.7):
        turned = rotate(pose, bare.centre, (0.0, turn, 0.0))
        image = SoftwareRenderer(painting.mesh).render(turned)
        shade = 0.65 + 0.35 * np.clip(-image.normals[..., 2:], 0.0, 1.0)
        colours = np.where(painting.is_painted[image.face_ids][..., None], image.reflectance, TINT)
        panel = np.where(image.mask[..., None], colours * shade, 1.0)
        panels.append(np.rint(255.0 * np.clip(panel, 0.0, 1.0)).astype(np.uint8))
    save_sheet(DOCS / "painted.jpg", *[panel[CAR] for panel in panels], width=400)


MAKERS = (
    make_search, make_demo, make_app, make_first, make_lens, make_export, make_pairs, make_report,
    make_wheels, make_marking, make_assumed, make_box, make_methods, make_hide, make_objects,
    make_two, make_time_line, make_table, make_painted,
)  # fmt: skip
PICTURES: dict[str, Callable[[Path], None]] = {
    **{make.__name__.removeprefix("make_"): make for make in MAKERS},
    **{name: partial(make_searched, name) for name in ("sure", "views")},
}


def main() -> None:
    """Make the pictures that are named, or all."""
    for name in sys.argv[1:] or PICTURES:
        with tempfile.TemporaryDirectory() as folder:
            PICTURES[name](Path(folder))


if __name__ == "__main__":
    main()
