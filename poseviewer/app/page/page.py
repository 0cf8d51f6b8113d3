"""The page: panels left and right, the photo in the middle, notices; brought to each session."""

from functools import partial
from pathlib import Path
from typing import Any

import viser

from poseviewer import __version__
from poseviewer.app.below_viser.client_script import ClientScript
from poseviewer.app.below_viser.incoming import check_incoming
from poseviewer.app.page.above_steps import add_preparing, objects_list
from poseviewer.app.page.controls import Controls, Post, on_page, plain
from poseviewer.app.page.handles import handles_of
from poseviewer.app.page.map_panel import PALETTE, add_maps
from poseviewer.app.page.panels import STEPS, add_status, idle_buttons
from poseviewer.app.page.photo_view import DEPTH, SIDE, PhotoScene
from poseviewer.app.page.reports import SeenMaps, Theme, meaning_of
from poseviewer.app.page.rows import add_rows
from poseviewer.app.page.status import FIRST
from poseviewer.app.page.strip import show_strip
from poseviewer.app.page.texts import every_text, hint_of, offer_text
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state.document import MARKING, label_of
from poseviewer.app.state.edits import SavePose, set_fields
from poseviewer.app.state.hiding import SHAPES
from poseviewer.app.state.keys_and_buttons import client_keys, help_table
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import OF_FRAMES
from poseviewer.app.workers.finding_cameras import StillChoice, find_still_cameras
from poseviewer.app.workers.tasks import (
    LongVideo,
    Request,
    Restore,
    TaskResult,
    UnsavedPose,
    download,
)
from poseviewer.errors import REPORTING, PoseViewerError
from poseviewer.files.formats.bop import likely_numbers, object_numbers
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.mesh.size import METRES
from poseviewer.files.state.session_file import AutosavedSession
from poseviewer.opening.sources import MAX_FILES
from poseviewer.opening.uploads import MAX_UPLOAD_BYTES

PANEL_PX = 300
"""Width of the left panel at the start; its border can be dragged."""
MAPS_PX = 380
"""Width of the maps at the start; their border can be dragged."""
SLIM_PX = 280, 290
"""Widths of both where the window is small: a photo of 4:3 gets 40 % of 1280 x 720 px."""
SMALL_PX = 1400
"""Width below which a window is small."""
NARROW_PX = 1000
"""Width below which the photo needs the room of the maps, which are folded."""
PANELS_S = 0.1
"""Least time between two updates of the panels; the photo is always up to date."""
MAPS_S = 0.2
"""Least time between two updates of the maps, which are larger."""
NOTICE_S = 6.0
"""Seconds after which a notice of few words goes: it lies over the photo."""
READING_S = 0.05
"""Seconds for each letter that a notice stays at least: people read some 20 a second."""
MAX_NUMBER = 10**15
"""Largest number of an image or object that a field takes: browsers hold such numbers exactly."""
STILL_WAYS = {
    "markers if there are any, else features": "auto",
    "features of the scene": "features",
    "markers (ArUco, AprilTag)": "markers",
}
"""Ways to find the cameras of a scene that stands still."""
STILL_TEXT = (
    "Nothing moves but the camera. Where it stood in each frame is found from the pictures; then "
    "an object that is placed in one frame is placed in all. Undo brings the sequence back."
)
SIDE_HINT = "Side of a marker's black square: the scale, by features too; 0: not known"
PAGE_CONFIG = {
    "plane": {"depth": DEPTH, "side": SIDE},
    "steps": list(STEPS),
    "first": "Place",  # photo and model are there by the command line
    "widths": [NARROW_PX, SMALL_PX],
    "palette": PALETTE.tolist(),
    "keys": client_keys(),
    "largest": MAX_UPLOAD_BYTES,
    "most": MAX_FILES,
    "style": Path(__file__).with_name("page.css").read_text(encoding="utf-8"),
}
"""Settings of the client's script."""


class Page:
    """Everything that pages show; all of them show the same."""

    def __init__(
        self,
        server: viser.ViserServer,
        post: Post,
        session: Session,
        review: Reviewer | None = None,
    ) -> None:
        self._server = server
        self._post = post
        gui = server.gui
        choose_theme(gui)
        gui.set_panel_label("poseviewer")
        gui.main_panel.dock_left()
        gui.main_panel.set_width(PANEL_PX)
        maps = gui.add_panel()
        maps.dock_right()
        maps.set_width(MAPS_PX)
        maps.minimize()
        self._map_panel, self._is_open = maps, False
        self.scene = PhotoScene(server)
        # Pages may report from here on.
        self._is_light: dict[int, bool] = {}  # colours that were chosen in the help, by client
        self._is_narrow = False
        self._widths: dict[int, tuple[float, float]] = {}  # of the panels, by client
        self._sees_maps: dict[int, bool] = {}  # by client
        self._script = ClientScript(server, PAGE_CONFIG, self._on_report)
        self._controls = controls = Controls(gui, post, session, PANELS_S)
        add_preparing(controls)
        if review is not None:
            add_rows(controls, review)
        add_status(controls, "" if review else FIRST)
        controls.html(objects_list)
        tabs = gui.add_tab_group()
        for step, add_controls in STEPS.items():
            with tabs.add_tab(step):
                add_controls(controls)
        with maps.add_tab("Pose and maps", viser.Icon.GRID_DOTS):
            self._maps = Controls(gui, post, session, MAPS_S)
            add_maps(self._maps)
        self._shown: Session | None = None
        self._working: list[viser.NotificationHandle] = []
        self._said: dict[tuple[int, str], viser.NotificationHandle] = {}
        self._question: Any = None
        self._side, self._unit, self._way = 0.0, "m", ""  # of markers, as was last said
        self._offer: viser.GuiFolderHandle | None = None
        server.on_client_disconnect(lambda _: self._tell_maps())
        for subscribe in (server.on_client_connect, server.on_client_disconnect):
            subscribe(lambda _: self._script.show("setTabs", len(self._tabs())))
        check_incoming(server, lambda client, why: self.show_error(why, client))

    def show(self, session: Session, seen: int, where: str) -> None:
        """Bring the page to the session; cheap where nothing has changed.

        Args:
            session: what is shown.
            seen: number of the last request that the session includes.
            where: path at which the pose was or will be saved.
        """
        if session is not self._shown:
            self._shown = session
            photo = session.document.photo
            self._script.show("setPhoto", photo.width, photo.height)
            self._script.show("setHint", hint_of(session))
            shape = session.tool if session.tool in SHAPES else ""
            self._script.show("setPen", shape, session.pen.erases, session.tool == "pose")
            self._script.show("setIdle", idle_buttons(session))
            self.scene.show(session)
            self._script.show("setHandles", handles_of(session))
            show_strip(self._script, session)
            self._script.show("forgetStrokes", session.pen.strokes)  # their tint is there
        # Together: who answers to one field must not find the next one still to be written.
        with self._server.atomic():
            self._controls.where = where
            self._controls.show(session, seen)
        self._maps.show(session, seen)
        # The photo has its place until there is something to tell; a drag's photo rests.
        # A tool's next press must not land beside its place: panels rest while one is active.
        marks, rests = session.tool in MARKING, session.drag is not None or session.tool != "pose"
        is_placed = any(item.is_placed for item in session.document.scene.objects)
        is_open = marks or (is_placed and not self._is_narrow)
        if is_open is not self._is_open and (marks or not rests):
            self._is_open = is_open
            (self._map_panel.expand if is_open else self._map_panel.minimize)()

    def _on_report(self, report: object, client: viser.ClientHandle) -> None:
        match meaning_of(report, client.client_id):
            case Theme(light, text, width):
                number = client.client_id
                choose_theme(client.gui, self._is_light.get(number, light))
                self._is_narrow = width < NARROW_PX
                panel, maps = SLIM_PX if width < SMALL_PX * text else (PANEL_PX, MAPS_PX)
                wanted = panel * text, maps * text
                if wanted != self._widths.get(number, (PANEL_PX, MAPS_PX)):
                    client.gui.main_panel.set_width(wanted[0])
                    self._map_panel.set_width(wanted[1])
                self._widths[number] = wanted
            case SeenMaps(seen):
                self._sees_maps[client.client_id] = seen
                self._tell_maps()
            case str(trouble):
                self.show_error(trouble, client.client_id)
            case None:
                pass
            case request:
                self._post(request)

    def _tell_maps(self) -> None:
        """Have the maps computed while a page shows them."""
        tabs = [tab.client_id for tab in self._tabs()]
        if tabs:
            seen = any(self._sees_maps.get(number) for number in tabs)
            self._post(set_fields("display", sees_maps=seen))

    def _tabs(self, client: int | None = None) -> list[viser.ClientHandle]:
        """Pages that are open: all, or the one of a client's id."""
        clients = self._server.get_clients()
        return [handle for number, handle in clients.items() if client in (None, number)]

    def show_error(self, sentence: str, client: int | None = None) -> None:
        """Tell all pages, or one, what could not be done, and why; from any thread."""
        self._notify("", sentence, client, "orange", 12.0)

    def tell(self, title: str, *texts: str) -> None:
        """Tell all pages that something is done, or all that is to be noted in one notice.

        It goes soon, so that the photo is free again; the step Open keeps the notes on files.
        """
        if texts:
            text = "\n".join(dict.fromkeys(texts))
            seconds = max(NOTICE_S, READING_S * len(text))
            self._notify(title, text, None, "cyan", seconds)

    def _notify(
        self, title: str, text: str, client: int | None, colour: str, seconds: float
    ) -> None:
        """Show a notice in place of the one before of this title."""
        options: Any = {"color": colour, "auto_close_seconds": seconds}
        for tab in self._tabs(client):
            before = self._said.pop((tab.client_id, title), None)
            if before is not None:
                before.remove()
            self._said[tab.client_id, title] = tab.add_notification(title, on_page(text), **options)

    def working(self, what: str, note: str = "") -> None:
        """Say that something is being done that takes a moment; "" when it is over."""
        if what and self._working:
            for notice in self._working:
                notice.title, notice.body = what, note
            return
        for notice in self._working:
            notice.remove()
        self._working = [
            tab.add_notification(what, note, loading=True, with_close_button=False)
            for tab in (self._tabs() if what else ())
        ]

    def send(self, result: TaskResult) -> None:
        """Give files to the page that asked for them."""
        for tab in self._tabs(result.client):
            for name, content in result.files.items():
                tab.send_file_download(name, content, save_immediately=True)

    def show_help(self, client: int) -> None:
        """Open the panel with the keys, the colours, the version and how to report an error."""
        for tab in self._tabs(client):
            with tab.gui.add_modal("Keys and mouse") as modal:
                tab.gui.add_button("Close").on_click(lambda _, modal=modal: close_modal(modal))
                tab.gui.add_markdown(help_table())
                colours = tab.gui.add_button_group("Colours", ("Light", "Dark"))

                def choose(_: viser.GuiEvent, tab: Any = tab, colours: Any = colours) -> None:
                    self._is_light[tab.client_id] = colours.value == "Light"
                    choose_theme(tab.gui, self._is_light[tab.client_id])

                colours.on_click(choose)
                tab.gui.add_markdown(f"poseviewer {plain(__version__)}. {plain(REPORTING)}")

    def ask_numbers(self, what: str, client: int) -> None:
        """Ask on a page for the numbers of image and objects in BOP, then download."""
        scene, tab = self._controls.session.document.scene, self._server.get_clients().get(client)
        if tab is None:
            return
        named, numbers = likely_numbers(scene)
        add = partial(tab.gui.add_number, min=0, max=MAX_NUMBER, step=1)
        with tab.gui.add_modal("Numbers in BOP") as modal:
            image = None if what in OF_FRAMES else add("Image", named or 0)
            objects = zip(scene.objects, numbers, strict=True)
            fields = [add(label_of(item), number) for item, number in objects]

            def send(_: viser.GuiEvent) -> None:
                said = None if image is None or image.value == named else f"{image.value}"
                ids = tuple(field.value for field in fields)
                numbers = ConvertOptions(image=said, object_ids=ids)
                try:
                    object_numbers(scene, numbers)
                except PoseViewerError as error:
                    self.show_error(str(error), client)
                    return
                close_modal(modal)
                self._post(download(what, client, numbers))

            tab.gui.add_button("Export", color="cyan").on_click(send)
            tab.gui.add_button("Close", color="gray").on_click(lambda _: close_modal(modal))

    def ask_every(self, video: LongVideo, client: int) -> None:
        """Ask on a page how many frames of a long video are taken, then open it."""
        for tab in self._tabs(None if client < 0 else client):
            with tab.gui.add_modal("A long video") as modal:
                every = tab.gui.add_number("Every N-th frame", 1, min=1, max=video.frames, step=1)
                text = tab.gui.add_markdown(every_text(video, 1))

                @every.on_update
                def _(_: viser.GuiEvent, text: Any = text, every: Any = every) -> None:
                    text.content = every_text(video, max(int(every.value), 1))

                def take(_: viser.GuiEvent, modal: Any = modal, every: Any = every) -> None:
                    close_modal(modal)
                    self._post(video.open(max(int(every.value), 1)))

                tab.gui.add_button("Open", color="cyan").on_click(take)
                close = tab.gui.add_button("Close", color="gray")
                close.on_click(lambda _, modal=modal: close_modal(modal))

    def ask_to_open(self, unsaved: UnsavedPose, client: int) -> None:
        """Ask on a page whether to open files in place of a pose that is in no file."""
        for tab in self._tabs(None if client < 0 else client):
            with tab.gui.add_modal("The pose is not saved") as modal:
                name = plain(unsaved.name)
                said = f"Opening **{name}** replaces what is shown, whose pose is in no file yet."
                tab.gui.add_markdown(f"{said} *Undo* brings it back.")

                def answer(request: Request, modal: Any = modal) -> None:
                    close_modal(modal)
                    self._post(request)

                save = tab.gui.add_button("Save it, then open", color="cyan")
                save.on_click(lambda _: answer(SavePose("beside", unsaved.open)))
                without = tab.gui.add_button("Open without saving", color="gray")
                without.on_click(lambda _: answer(unsaved.open))
                close = tab.gui.add_button("Close", color="gray")
                close.on_click(lambda _, modal=modal: close_modal(modal))

    def ask_still(self, client: int) -> None:
        """Ask on a page how the cameras of a scene that stands still are found, then find them."""
        tab, document = self._server.get_clients().get(client), self._controls.session.document
        if tab is None or not document.scene.frames:
            return
        ways: dict[str, Any] = dict(STILL_WAYS)
        posed = sum(document.object.id in frame.poses for frame in document.scene.frames)
        if posed > 1:
            ways[f"{label_of(document.object)}, placed in {posed:,} frames"] = "object"
        with tab.gui.add_modal("It stands still") as modal:
            tab.gui.add_markdown(STILL_TEXT)
            # A dropdown that comes first would open, as the dialog does.
            side = tab.gui.add_number(
                "Markers' side", self._side, min=0.0, step=0.0001, hint=SIDE_HINT
            )
            unit = tab.gui.add_dropdown("in", tuple(METRES), initial_value=self._unit)
            last = self._way if self._way in ways else None
            way = tab.gui.add_dropdown("Cameras by", tuple(ways), initial_value=last)

            def find(_: viser.GuiEvent) -> None:
                close_modal(modal)
                by = ways[way.value]
                self._side, self._unit, self._way = side.value, unit.value, way.value
                has_size = side.value > 0.0 and by != "object"
                known = {"marker_size": side.value, "unit": unit.value} if has_size else {}
                self._post(find_still_cameras(StillChoice(by, **known)))

            tab.gui.add_button("Find the cameras", color="cyan").on_click(find)
            tab.gui.add_button("Close", color="gray").on_click(lambda _: close_modal(modal))

    def offer(self, offer: AutosavedSession) -> None:
        """Offer above the steps, where it interrupts nothing, what an earlier session left."""
        gui, said = self._server.gui, offer_text(offer)
        with gui.add_folder("Earlier session", order=-1.0) as self._offer:
            gui.add_markdown(said)
            answers = {"Open it again": Restore(True), "Discard": Restore(False)}
            self._controls.choices("", answers)

    def close_offer(self) -> None:
        """Take the offer of an earlier session off all pages."""
        if self._offer is not None:
            self._offer.remove()
            self._offer = None

    def ask_to_replace(self, path: Path) -> None:
        """Ask all pages whether to replace a file that this session did not write."""
        self.close_question()
        said = "was not written by this session. What is replaced is kept as `.bak`."
        with self._server.gui.add_modal("There is such a file already") as self._question:
            self._server.gui.add_markdown(f"**{plain(path.name)}** {said}")
            self._controls.button("Use another name", SavePose("beside"), color="cyan")
            self._controls.button("Replace it", SavePose("replace"))
            self._controls.button("Close", SavePose("leave"))

    def close_question(self) -> None:
        """Take the question off all pages."""
        if self._question is not None:
            close_modal(self._question)


def close_modal(modal: Any) -> None:
    """Close a dialog that a second click may have closed already."""
    if not modal.closed:
        modal.close()


def choose_theme(gui: viser.GuiApi, light: bool = False) -> None:
    """Dark, or as the browser prefers light ones."""
    gui.configure_theme(
        dark_mode=not light, show_logo=False, show_share_button=False, brand_color=(23, 162, 184)
    )
