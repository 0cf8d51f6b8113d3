// The page's own part: the view of the photo (zoom, pan), and what the mouse and the keys do there.
// Everything else on the page is viser's. Sent by client_script.py, which fills in CONFIG:
// channel (uuid of the text field that takes reports), plane {depth, side} (world units), steps
// (labels of the left panel's tabs), first (the one that is open at first), keys (by event.code or
// event.key: call, a function of this page, else it is reported; label, of its button; opens,
// whether it opens its step, "forward" only from an earlier one, or "always"; leave, whether the
// browser has it while ctrl is held), largest and most (bytes and files of an upload), style, icon.
//
// viser's camera stays at the origin and looks along +z at the photo's plane; zoom and pan are
// three.js view offsets, which cut a piece out of the picture and leave the registration alone.
// Pointer and key events over the photo are taken before viser sees them, so that its own camera
// controls cannot move.
// The script comes again after a lost connection: the page is loaded anew, and says what it was
// sending.
if (window.poseviewer) {
  const sending = document.querySelector(".mantine-Notification-root[id^='upload-']");
  if (sending) window.name = `cut off ${window.poseviewer.sent()}`;
  location.reload();
  return;
}
const CONFIG = /*CONFIG*/ {};
const state = {
  photo: [1, 1], // width, height in px
  zoom: 1, // canvas px per px of the fitted view
  centre: [0.5, 0.5], // the photo's point, in shares of its size, in the middle of the view
  size: [0, 0],
  large: -1, // index of the large photo in the strip
  pointer: null, // "drag", "draw" or "pan" while a button is down
  anchor: [0, 0], // the photo's point that is panned with the pointer, px
  sequence: Date.now(), // viser drops a report that equals the last one, of an earlier page too
  sent: "", // the name of the set that was sent last
  step: CONFIG.first, // to be opened as soon as it is there
  frames: 0, // since the steps are there
};
const SETTLED = 15; // frames in which viser lays the panels out
const vm = () => window.__viserMutable;

function send(message) {
  message.sequence = ++state.sequence;
  vm().sendMessage({
    type: "GuiUpdateMessage",
    uuid: CONFIG.channel,
    updates: { value: JSON.stringify(message) },
  });
}

// --- the view -----------------------------------------------------------------------------------
// CSS px per photo px: with the whole photo in the canvas, and as it is shown.
const fitted = () => Math.min(state.size[0] / state.photo[0], state.size[1] / state.photo[1]);
const scale = () => fitted() * state.zoom;
const unit = () => CONFIG.plane.side / Math.max(...state.photo); // world units per photo px

// Where the photo's upper left corner lies on the canvas, CSS px.
const corner = () =>
  state.size.map((side, i) => side / 2 - state.centre[i] * state.photo[i] * scale());

function photoFromCanvas(x, y) {
  const [left, top] = corner();
  return [(x - left) / scale(), (y - top) / scale()];
}

function applyView() {
  const { canvas, camera } = vm();
  const [w, h] = [canvas?.clientWidth, canvas?.clientHeight];
  if (!camera || !w || !h) return;
  state.size = [w, h];
  const k = fitted();
  const seen = (h / k) * unit(); // height of the plane that the whole view shows
  camera.fov = (2 * Math.atan(seen / 2 / CONFIG.plane.depth) * 180) / Math.PI;
  camera.aspect = w / h;
  const [left, top] = state.size.map((side, i) =>
    (side - side / state.zoom) / 2 + (state.centre[i] - 0.5) * state.photo[i] * k);
  camera.setViewOffset(w, h, left, top, w / state.zoom, h / state.zoom);
  camera.updateProjectionMatrix();
  vm().requestRender();
  document.documentElement.dataset.poseviewerView = JSON.stringify({
    zoom: state.zoom, centre: state.centre, scale: scale(),
  });
}

// Show a point of the photo at a place of the canvas.
function showAt(point, ...spot) {
  const centre = state.size.map(
    (side, i) => (point[i] - (spot[i] - side / 2) / scale()) / state.photo[i]);
  state.centre = centre.map((v) => Math.min(Math.max(v, -0.5), 1.5));
  applyView();
}

function zoomAt(x, y, factor) {
  const anchor = photoFromCanvas(x, y);
  state.zoom = Math.min(Math.max(state.zoom * factor, 0.25), 64);
  showAt(anchor, x, y);
}

function showAll() {
  state.zoom = 1;
  state.centre = [0.5, 0.5];
  applyView();
}

// --- mouse --------------------------------------------------------------------------------------
function place(event) {
  const box = vm().canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

const overPhoto = (event) => event.target === vm()?.canvas;

function taken(event) {
  event.stopImmediatePropagation();
  event.preventDefault();
}

const ctrl = (event) => event.ctrlKey || event.metaKey;

function at(event) {
  const [x, y] = photoFromCanvas(...place(event));
  return { x, y, zoom: scale(), shift: event.shiftKey, ctrl: ctrl(event) };
}

addEventListener("pointerdown", (event) => {
  if (!overPhoto(event) || state.pointer) return;
  taken(event);
  document.activeElement?.blur();
  try { vm().canvas.setPointerCapture(event.pointerId); } catch (error) { /* a synthetic pointer */ }
  state.anchor = photoFromCanvas(...place(event));
  if (event.button === 0 && pen.shape) {
    state.pointer = "draw";
    beginStroke(event);
  } else if (event.button === 0) {
    state.pointer = "drag";
    send({ kind: "press", ...at(event) });
  } else {
    state.pointer = "pan";
  }
}, true);

addEventListener("pointermove", (event) => {
  hover(event);
  if (!state.pointer) {
    if (overPhoto(event)) event.stopImmediatePropagation();
    return;
  }
  taken(event);
  if (state.pointer === "draw") { goOn(event); return; }
  if (state.pointer === "pan") { showAt(state.anchor, ...place(event)); return; }
  send({ kind: "drag", ...at(event) }); // browsers give one move a frame
}, true);

function ended(event, kind) {
  if (!state.pointer) return;
  taken(event);
  if (state.pointer === "drag") send({ kind });
  if (state.pointer === "draw") lift(kind);
  state.pointer = null;
}
addEventListener("pointerup", (event) => ended(event, "release"), true);
addEventListener("pointercancel", (event) => ended(event, "cancel"), true);

for (const kind of ["mousedown", "mousemove", "mouseup", "click", "contextmenu"]) {
  addEventListener(kind, (event) => { if (overPhoto(event)) taken(event); }, true);
}

addEventListener("dblclick", (event) => {
  if (!overPhoto(event)) return;
  taken(event);
  if (pen.shape) finishStroke();
  else send({ kind: "double", ...at(event) });
}, true);

addEventListener("wheel", (event) => {
  if (!overPhoto(event)) return;
  taken(event);
  const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
  const factor = Math.exp(-event.deltaY * lines * 0.0016);
  if (pen.shape === "brush" && !ctrl(event)) {
    pen.radius = Math.min(Math.max(pen.radius * factor, 2), 240);
  } else {
    zoomAt(...place(event), factor);
  }
}, { capture: true, passive: false });

// --- strokes ------------------------------------------------------------------------------------
// On a sheet over the photo lie pins and marks, as the server draws them, and strokes: where a tool
// draws, the main button leaves one. It is drawn here at once, and sent when it is done; it stays on
// the sheet until the server has taken it.
const sheet = document.createElementNS("http://www.w3.org/2000/svg", "svg");
sheet.classList.add("pv-sheet");
sheet.innerHTML = '<g></g><g></g><path class="pv-line pv-hovered"/>';
const [handles, strokes, hovered] = sheet.children;
const pen = {
  shape: "", // "brush", "polygon", "scribble"
  erases: false, // unless alt or shift is held
  radius: 18, // of the brush, CSS px
  at: null, // where the pointer is, photo px
  now: null, // the stroke that is being drawn: {shape, points (photo px), radius (photo px), erase}
  done: [], // strokes that the server has not taken yet
  drawn: "", // what the sheet shows
};
const SCRIBBLE = 3; // half its width, CSS px
const STEP = 1.5; // CSS px between a stroke's points
const NEAR = 9; // CSS px: a press so near to a polygon's first corner closes it
const LASSO = 12; // points of one drag from which on a polygon is closed when the button goes up

function setPen(shape, erases) {
  if (shape !== pen.shape) pen.now = null;
  Object.assign(pen, { shape, erases });
}

const erasing = (event) => pen.erases !== (event.altKey || event.shiftKey);
const apart = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]) * scale();
const penRadius = () => (pen.shape === "scribble" ? SCRIBBLE : pen.radius) / scale();

function hover(event) {
  if (!pen.shape) return;
  pen.at = overPhoto(event) || state.pointer ? photoFromCanvas(...place(event)) : null;
  pen.preview = erasing(event);
}

function beginStroke(event) {
  const point = photoFromCanvas(...place(event));
  const stroke = pen.now;
  if (stroke && pen.shape === "polygon") {
    if (stroke.points.length > 2 && apart(point, stroke.points[0]) < NEAR) finishStroke();
    else if (apart(point, stroke.points.at(-1)) >= STEP) stroke.points.push(point);
    stroke.before = stroke.points.length;
  } else {
    const [shape, radius, erase] = [pen.shape, penRadius(), erasing(event)];
    pen.now = { shape, points: [point], radius, erase, before: 1 };
  }
}

function goOn(event) {
  if (!pen.now) return;
  const events = event.getCoalescedEvents?.() ?? [];
  for (const one of events.length ? events : [event]) {
    const point = photoFromCanvas(...place(one));
    if (apart(point, pen.now.points.at(-1)) >= STEP) pen.now.points.push(point);
  }
}

function lift(kind) {
  const stroke = pen.now;
  if (!stroke) return;
  if (kind === "cancel") pen.now = null;
  else if (stroke.shape !== "polygon" || stroke.points.length - stroke.before >= LASSO) {
    finishStroke();
  }
}

function finishStroke() {
  const stroke = pen.now;
  if (!stroke || (stroke.shape === "polygon" && stroke.points.length < 3)) return;
  pen.done.push(stroke);
  const points = stroke.points.flat().map((v) => Math.round(v * 100) / 100);
  const { shape, radius, erase } = stroke;
  send({ kind: "stroke", shape, points, radius, erase });
  pen.now = null;
}

function forgetStrokes() {
  const taken = pen.done;
  // The tint's picture is decoded after it has come.
  setTimeout(() => { pen.done = pen.done.filter((stroke) => !taken.includes(stroke)); }, 150);
}

// The sheet's unit is a px of the photo, --pv-px one of the screen.
function drawSheet() {
  const drawn = [...pen.done, pen.now].map((stroke) => stroke && pathOf(stroke)).join("") +
    (pen.at && (pen.shape === "brush" || pen.shape === "scribble") ? cursor() : "");
  const box = [...photoFromCanvas(0, 0), ...state.size.map((side) => side / scale())].join(" ");
  if (pen.drawn === box + drawn) return;
  pen.drawn = box + drawn;
  sheet.setAttribute("viewBox", box);
  sheet.style.setProperty("--pv-px", 1 / scale());
  strokes.innerHTML = drawn;
}

const circle = (kind, [x, y], radius) =>
  `<circle class="pv-${kind}" cx="${x}" cy="${y}" r="${radius}"/>`;
const cursor = () => circle("halo", pen.at, penRadius()) +
  circle(pen.preview ? "erase" : "hide", pen.at, penRadius());

function pathOf(stroke) {
  const kind = stroke.erase ? "erase" : "hide";
  const path = (end) => `<path class="pv-${kind} pv-${stroke.shape}" ` +
    `stroke-width="${2 * stroke.radius}" d="M${stroke.points.join("L")}${end}"/>`;
  if (stroke.shape !== "polygon") return path("h0"); // a single point is a dot
  if (stroke !== pen.now) return path("Z");
  return path(pen.at ? `L${pen.at}` : "") + circle(`${kind} pv-full`, stroke.points[0], 4.5 / scale());
}

// --- keys ---------------------------------------------------------------------------------------
function typing(event) {
  const element = event.target;
  // viser's dropdowns are text fields: they take keys only while their list is open.
  if (element.ariaHasPopup === "listbox") return element.ariaExpanded === "true";
  return element.matches?.("textarea, select, [contenteditable=true], input:not([type=checkbox], " +
    "[type=radio], [type=range], [type=button])");
}

// A dialog that is open has the keys; Esc, and ? again, close it where it may be closed.
function dialogTakes(event) {
  const open = document.querySelector('[role="dialog"][aria-modal="true"]');
  if (!open) return false;
  const close = [...open.querySelectorAll("button")].find((b) => b.textContent.trim() === "Close");
  if (close && (event.key === "Escape" || event.key === "?")) {
    taken(event);
    close.click();
  }
  return true;
}

addEventListener("keydown", (event) => {
  noteModifiers(event);
  // Else the browser's own menu has the keys next.
  if (event.key === "Alt" && pen.shape) event.preventDefault();
  if (typing(event) || dialogTakes(event)) return;
  if (pen.now && ["Enter", "Escape"].includes(event.key)) {
    taken(event);
    if (event.key === "Enter") finishStroke();
    else pen.now = null;
    return;
  }
  const action = CONFIG.keys[event.code] ?? CONFIG.keys[event.key];
  if (!action || (ctrl(event) && action.leave)) return;
  taken(event);
  document.activeElement?.blur();
  if (action.call) { window.poseviewer[action.call](); return; }
  forward(action);
  if (event.key === "Escape" && state.pointer === "drag") state.pointer = null;
  const { code, key, repeat } = event;
  send({ kind: "key", code, key, repeat, shift: event.shiftKey, ctrl: ctrl(event) });
}, true);
// Then it is typed, and the keys are the page's again: once viser has seen the key, and before the
// next one comes.
addEventListener("keydown", (event) => {
  const done = event.key === "Enter" || event.key === "Escape";
  if (done && typing(event) && event.target.tagName === "INPUT") event.target.blur();
});
addEventListener("keyup", noteModifiers, true);
addEventListener("blur", noteModifiers);
// A pressed button must not take the keys with it: neither itself, nor the field that it steps.
addEventListener("pointerup", (event) => setTimeout(() => {
  const element = document.activeElement;
  const stepped = element?.tagName === "INPUT" && element !== event.target;
  const pressed = event.target.closest?.("button");
  if (element?.tagName === "BUTTON" || (stepped && pressed)) element.blur();
}, 0));

function noteModifiers(event) {
  bar.dataset.held = ctrl(event) ? "ctrl" : event.shiftKey ? "shift" : "plain";
}

// --- files --------------------------------------------------------------------------------------
// All that is chosen or dropped at once is one set, sent as one file: a line of JSON, a list of
// [path, bytes], then the bytes of all files. The browser reads them only as they are sent.
const packed = new WeakSet();

function give(input, files) {
  if (!files.length) return;
  const size = files.reduce((sum, [, file]) => sum + file.size, 0);
  const folder = files[0][0].includes("/") ? files[0][0].split("/")[0] : "";
  const name = folder || files[0][1].name;
  if (size > CONFIG.largest || files.length > CONFIG.most) {
    send({ kind: "unfit", name, size, count: files.length });
    return;
  }
  const head = JSON.stringify(files.map(([path, file]) => [path, file.size])) + "\n";
  const more = files.length > 1 && !folder ? ` and ${files.length - 1} more` : "";
  const set = new File([head, ...files.map(([, file]) => file)], name + more);
  packed.add(set);
  state.sent = set.name;
  const held = new DataTransfer();
  held.items.add(set);
  input.files = held.files;
  input.dispatchEvent(new Event("change", { bubbles: true }));
}

// Before the browser's file chooser opens: what belongs together is chosen together.
addEventListener("click", (event) => {
  const input = event.target;
  if (!(input instanceof HTMLInputElement) || input.type !== "file") return;
  input.multiple = true;
  input.webkitdirectory = input.accept === "folder";
}, true);

// Before viser reads them: it would send one file alone, and all of one that the server refuses.
addEventListener("change", (event) => {
  const input = event.target;
  if (input.type !== "file" || !input.files.length || packed.has(input.files[0])) return;
  taken(event);
  give(input, [...input.files].map((file) => [file.webkitRelativePath || file.name, file]));
}, true);

// The files of a dropped file or folder, as [path, file] each.
async function filesOf(entry, files) {
  if (files.length > CONFIG.most) return;
  if (entry.isFile) {
    const file = await new Promise((done, failed) => entry.file(done, failed));
    files.push([entry.fullPath.replace(/^\/+/, ""), file]);
    return;
  }
  const reader = entry.createReader();
  for (;;) {  // a browser gives a hundred at a time
    const entries = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!entries.length) return;
    for (const inside of entries) await filesOf(inside, files);
  }
}

// What is dropped anywhere goes to the button that takes folders; else the browser would open it.
addEventListener("dragover", (event) => {
  if (event.dataTransfer?.types.includes("Files")) event.preventDefault();
}, true);
addEventListener("drop", async (event) => {
  const input = document.querySelector("input[type=file][accept=folder]");
  const dropped = event.dataTransfer;
  if (!dropped?.types.includes("Files") || !input) return;
  taken(event);
  // Both are gone after the first wait.
  const files = [...dropped.files].map((file) => [file.name, file]);
  const entries = [...dropped.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.some((entry) => entry.isDirectory)) { give(input, files); return; }
  const inside = [];
  try {
    for (const entry of entries) await filesOf(entry, inside);
  } catch (error) {
    send({ kind: "not sent", trouble: "unreadable", name: entries[0].name });
    return;
  }
  if (inside.length) give(input, inside);
  else send({ kind: "not sent", trouble: "empty", name: entries[0].name });
}, true);

// --- the panels ---------------------------------------------------------------------------------
// A button opens the step that its key opens.
addEventListener("click", (event) => {
  const label = event.target.closest?.("button")?.textContent.trim();
  const action = label && Object.values(CONFIG.keys).find((own) => own.label === label);
  if (action) forward(action);
});

// Open the step of an action, unless it has none or a later one is open.
function forward(action) {
  const isLater = CONFIG.steps.findIndex(isOpen) >= CONFIG.steps.indexOf(action.step);
  if (action.opens === "always" || (action.opens && !isLater)) openStep(action.step);
}

// Docked tabs are opened by Enter, those of a narrow page by a click.
const tabOf = (step) =>
  [...document.querySelectorAll("[role=tab]")].find((tab) => tab.textContent === step);
const isOpen = (step) => tabOf(step)?.ariaSelected === "true";

// Open a step; give whether it is open.
function openStep(step) {
  tabOf(step)?.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
  tabOf(step)?.click();
  return isOpen(step);
}

// Presses, by Enter too, on what has a report: with the place from its left and lower border, each
// as a share of its side.
function report(event) {
  const node = event.target.closest?.("[data-report]");
  if (!node || (event.type === "keydown" && event.key !== "Enter")) return;
  const box = node.getBoundingClientRect();
  const u = (event.clientX - box.left) / box.width;
  send({ ...JSON.parse(node.dataset.report), u, v: (box.bottom - event.clientY) / box.height });
}
addEventListener("pointerdown", report);
addEventListener("keydown", report);

// The outline of a start that is hovered is drawn over the photo.
addEventListener("pointerover", (event) => {
  const path = event.target.closest?.(".pv-starts button")?.querySelector("path");
  hovered.setAttribute("d", path?.getAttribute("d") ?? "");
});

// What has a text to copy is copied by way of a field: a page without TLS has no other clipboard.
addEventListener("click", (event) => {
  const node = event.target.closest?.("[data-copy]");
  if (!node) return;
  const field = document.createElement("textarea");
  field.value = node.dataset.copy;
  document.body.append(field);
  field.select();
  document.execCommand("copy");
  field.remove();
  node.classList.add("pv-copied");
  setTimeout(() => node.classList.remove("pv-copied"), 1500);
});

// The page is as light, and its panel as wide for the text, as the browser prefers.
const light = matchMedia("(prefers-color-scheme: light)");
const USUAL = 14.8; // px: viser's text where the browser's is of its usual size
const textSize = () =>
  Math.max(1, parseFloat(getComputedStyle(document.documentElement).fontSize) / USUAL);
const sendTheme = () => send({ kind: "theme", light: light.matches, text: textSize() });
light.addEventListener("change", sendTheme);

// --- what lies over the photo -------------------------------------------------------------------
const bar = document.createElement("div");
bar.className = "pv-hint";
bar.dataset.held = "plain";

// Several photos: small ones below the large one.
const strip = document.createElement("div");
strip.className = "pv-strip";
strip.hidden = true;
const pictures = document.createElement("style");

function setPictures(urls) {
  pictures.textContent = urls.map((url, index) =>
    `.pv-photo:nth-child(${index + 1}) .pv-small{background-image:url(${url})}`).join("");
}

function setStrip(cells) {
  strip.innerHTML = cells;
  strip.hidden = !cells;
  const large = [...strip.children].findIndex((cell) => cell.classList.contains("pv-at"));
  if (large >= 0 && large !== state.large) {
    strip.children[large].scrollIntoView({ block: "nearest", inline: "nearest" });
  }
  state.large = large;
}

// --- life ---------------------------------------------------------------------------------------
function watch() {
  const viewer = vm();
  if (viewer && viewer.canvas && viewer.cameraControl && viewer.camera) {
    // Only where it is on: to set it has viser draw the scene anew.
    if (viewer.cameraControl.enabled) viewer.cameraControl.enabled = false;
    const host = viewer.canvas.parentElement;
    if (bar.parentElement !== host) {
      host.style.position = "relative";
      host.append(sheet, bar);
      host.after(strip); // the canvas ends where it begins
    }
    host.style.height = `calc(100% - ${strip.offsetHeight}px)`;
    const { clientWidth, clientHeight } = viewer.canvas;
    const isAsWas = clientWidth === state.size[0] && clientHeight === state.size[1];
    if (!viewer.camera.view?.enabled || !isAsWas) applyView();
    drawSheet();
    viewer.canvas.style.cursor = pen.shape ? "crosshair" : "";
    if (!state.step || tabOf(state.step)) state.frames += 1;
    if (state.frames === SETTLED) document.documentElement.classList.add("pv-ready");
    if (state.step && openStep(state.step)) state.step = "";
  }
  requestAnimationFrame(watch);
}

window.poseviewer = {
  setPhoto(width, height) {
    state.photo = [width, height];
    showAll();
  },
  setHint(html) { bar.innerHTML = html; },
  setHandles(svg) { handles.innerHTML = svg; },
  setPen, forgetStrokes, setPictures, setStrip, photoFromCanvas, zoomAt, showAll,
  sent: () => state.sent,
};
document.title = "poseviewer";
const style = document.createElement("style");
style.textContent = CONFIG.style;
document.head.append(style, pictures);
document.querySelector("link[rel~='icon']").href = CONFIG.icon;
sendTheme();
if (window.name.startsWith("cut off ")) {
  send({ kind: "not sent", trouble: "cut off", name: window.name.slice(8) });
  window.name = "";
}
watch();
