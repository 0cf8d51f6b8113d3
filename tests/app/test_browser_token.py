"""The token in real Chromium: what no other port of the machine is sent, and what tabs keep."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from tests.app.app_process import AppProcess
from tests.app.browser import AppPage
from tests.scene import Scene

ASKS = """async (app) => {
    const said = {};
    const ask = async (name, way) => {
        const late = new Promise((done) => setTimeout(done, 3000, "no answer"));
        try { said[name] = String(await Promise.race([way(), late])); }
        catch (error) { said[name] = `refused: ${error}`; }
    };
    const loaded = (element, settings) => new Promise((done, failed) => {
        Object.assign(element, { onload: () => done("loaded"), onerror: failed }, settings);
        document.body.append(element);
    });
    const make = (kind) => document.createElement(kind);
    const text = (answer) => answer.text();
    const host = new URL(app).host;
    await ask("cookie", () => document.cookie);
    await ask("storage", () => JSON.stringify({ ...localStorage, ...sessionStorage }));
    await ask("fetch", () => fetch(app, { credentials: "include" }).then(text));
    await ask("fetch, not read", () =>
        fetch(app, { credentials: "include", mode: "no-cors" }).then(text));
    await ask("post", () => fetch(app, { method: "POST", credentials: "include" }).then(text));
    await ask("request", () => new Promise((done, failed) => {
        const request = new XMLHttpRequest();
        Object.assign(request, { withCredentials: true, onerror: failed,
            onload: () => done(request.responseText) });
        request.open("GET", app);
        request.send();
    }));
    await ask("websocket", () => new Promise((done, failed) => {
        const socket = new WebSocket(`ws://${host}/`, "viser-v1.1.1");
        Object.assign(socket, { onopen: () => done("opened"), onerror: failed });
    }));
    await ask("event source", () => new Promise((done, failed) => {
        const source = new EventSource(app, { withCredentials: true });
        Object.assign(source, { onopen: () => done("opened"), onerror: failed });
    }));
    await ask("script", () => loaded(make("script"), { src: app }));
    await ask("style", () => loaded(make("link"), { rel: "stylesheet", href: app }));
    await ask("picture", () => loaded(make("img"), { src: app }));
    for (const kind of ["iframe", "object", "embed"]) {
        await ask(kind, async () => {
            const frame = make(kind);
            await loaded(frame, kind === "object" ? { data: app } : { src: app });
            return frame.contentDocument?.documentElement.outerHTML ?? "closed";
        });
    }
    await ask("beacon", () => navigator.sendBeacon(app, "x"));
    await ask("worker", () => new Promise((done, failed) => {
        const worker = new Worker(app);
        Object.assign(worker, { onmessage: (event) => done(event.data), onerror: failed });
    }));
    await ask("import", () => import(app).then(JSON.stringify));
    await ask("broadcast", () => new Promise((done) => {
        new BroadcastChannel("poseviewer").onmessage = (event) => done(event.data);
    }));
    await ask("popup", async () => {
        const popup = open(app);
        await new Promise((done) => setTimeout(done, 2000));
        popup.postMessage("token", "*");
        return popup.location.href + JSON.stringify(popup.localStorage);
    });
    await ask("opener", () => opener.location.href + JSON.stringify(opener.localStorage));
    await ask("timing", () => performance.getEntries().map((entry) => entry.name).join());
    return said;
}"""
"""Ways in which a page of another port may ask for what the app's pages know."""


@contextmanager
def other_port() -> Iterator[tuple[str, list[str]]]:
    """Address of a server of another user, and all that it was sent: lines, headers, contents."""
    sent = list[str]()

    class Other(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            length = int(self.headers.get("Content-Length", 0))
            sent.append(f"{self.requestline}\n{self.headers}\n{self.rfile.read(length)!r}")
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<title>other</title><body></body>")

        def log_message(self, *_: object) -> None:
            """Print nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Other) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/", sent
        finally:
            server.shutdown()
            thread.join(60.0)


def open_beside(tab: AppPage, url: str) -> Page:
    """Open an address in another tab of the same browser, which knows the one that opened it."""
    with tab.page.expect_popup() as popup:
        tab.page.evaluate(f"open({url!r})")
    popup.value.wait_for_load_state()
    return popup.value


@pytest.mark.slow
@pytest.mark.long
def test_no_other_port_is_sent_the_token_whatever_it_asks(
    browser: Browser, tmp_path: Path, scene: Scene
) -> None:
    files = (scene.photo, scene.model, "--pose", scene.start)
    with AppProcess(tmp_path, *files) as app, other_port() as (other, sent):
        address, _, token = app.url.partition("?token=")
        with AppPage(browser, app.url) as tab:
            tab.wait_for_text("at this pose")
            assert tab.page.context.cookies() == []
            stranger = open_beside(tab, other)
            said = stranger.evaluate(ASKS, address)
            assert token not in str(said)
            assert said["cookie"] == ""
            assert said["storage"] == "{}"
            for way in ("fetch", "post", "request", "websocket", "script", "popup", "opener"):
                assert said[way].startswith("refused"), way
            # By links there and back, by a form, and by what a page that it opens tells.
            link = f"document.body.innerHTML = '<a href=\"{other}link\">there</a>'"
            for target in (address, app.url):
                page = open_beside(tab, target)
                page.wait_for_function("document.body")
                page.evaluate(link)
                page.get_by_text("there").click()
                page.wait_for_url(f"{other}link")
                assert token not in page.evaluate("document.referrer + window.name")
                page.close()
            form = f"<form action={address}></form>"
            stranger.evaluate(f"document.body.innerHTML = '{form}'")
            with stranger.expect_navigation():
                stranger.evaluate("document.forms[0].submit()")
            assert stranger.url.startswith(address)
    assert len([line for line in sent if line.startswith("GET /link")]) == 2
    assert token not in "".join(sent)


@pytest.mark.slow
@pytest.mark.long
def test_a_log_that_is_sent_to_others_has_no_token(
    browser: Browser, tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("POSEVIEWER_LOG", "1")
    with AppProcess(tmp_path, scene.photo, scene.model, "--pose", scene.start) as app:
        with AppPage(browser, app.url) as tab:
            tab.wait_for_text("at this pose")
            tab.reload()
        app.interrupt()
    token = app.url.partition("?token=")[2]
    assert sum("GET /?token=..." in line for line in app.lines) >= 4
    assert [line for line in app.lines if token in line] == [f"poseviewer is at {app.url}"]
