// The page's own part: the view of the photo (zoom, pan), and what the mouse and the keys do there.
// Everything else on the page is viser's. Sent by client_script.py, which fills in CONFIG:
// channel (uuid of the text field that takes reports), plane {depth, side} (world units), steps (labels of the left panel's folders, of which one is open) and search (the one
// that a search opens), keys (event.code or event.key that are taken), leave (of them, those left to
// the browser where ctrl is held), largest and most (bytes and files of an upload), title, style,
// icon.
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
  covered: 0, // CSS px at the canvas's lower end that the strip of photos lies over
  pointer: null, // "drag", "draw" or "pan" while a button is down
  anchor: [0, 0], // the photo's point that is panned with the pointer, px
  pending: null,
  sequence: Date.now(), // viser drops a report that equals the last one, of an earlier page too
  hint: "",
  modifiers: "",
  sent: "", // the name of the set that was sent last
};
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

function fitted() {
  // Where the whole photo lies in the canvas at zoom 1: CSS px per photo px.
  const [w, h] = state.photo;
  return Math.min(state.size[0] / w, (state.size[1] - state.covered) / h);
}

const scale = () => fitted() * state.zoom; // CSS px per photo px
const unit = () => CONFIG.plane.side / Math.max(...state.photo); // world units per photo px

function middle() {
  // The middle of what the photo has of the canvas.
  return [state.size[0] / 2, (state.size[1] - state.covered) / 2];
}

function photoFromCanvas(x, y) {
  const k = scale();
  const [mx, my] = middle();
  return [
    state.centre[0] * state.photo[0] + (x - mx) / k,
    state.centre[1] * state.photo[1] + (y - my) / k,
  ];
}

function canvasFromPhoto(x, y) {
  const k = scale();
  const [mx, my] = middle();
  return [
    (x - state.centre[0] * state.photo[0]) * k + mx,
    (y - state.centre[1] * state.photo[1]) * k + my,
  ];
}

function applyView() {
  const viewer = vm();
  if (!viewer || !viewer.camera || !viewer.canvas) return;
  const canvas = viewer.canvas;
  const [w, h] = [canvas.clientWidth, canvas.clientHeight];
  if (!w || !h) return;
  state.size = [w, h];
  const camera = viewer.camera;
  const k = fitted();
  const seen = (h / k) * unit(); // height of the plane that the whole view shows
  camera.fov = (2 * Math.atan(seen / 2 / CONFIG.plane.depth) * 180) / Math.PI;
  camera.aspect = w / h;
  const [mx, my] = middle();
  const left = w / 2 + (state.centre[0] - 0.5) * state.photo[0] * k - mx / state.zoom;
  const top = h / 2 + (state.centre[1] - 0.5) * state.photo[1] * k - my / state.zoom;
  camera.setViewOffset(w, h, left, top, w / state.zoom, h / state.zoom);
  camera.updateProjectionMatrix();
  sizeHandles();
  drawSheet();
  viewer.requestRender();
  document.documentElement.dataset.poseviewerView = JSON.stringify({
    zoom: state.zoom, centre: state.centre, scale: scale(), covered: state.covered,
  });
}

function sizeHandles() {
  // Handles are drawn in screen px: their nodes are scaled to it, whatever the zoom.
  const viewer = vm();
  if (!viewer) return;
  const perPixel = unit() / scale();
  let changed = false;
  for (const name in viewer.nodeRefFromName) {
    const node = viewer.nodeRefFromName[name];
    if (!node || !name.startsWith("/handles/")) continue;
    if (Math.abs(node.scale.x - perPixel) > 1e-9 * perPixel) {
      node.scale.setScalar(perPixel);
      changed = true;
    }
  }
  if (changed) viewer.requestRender();
}

// Show a point of the photo at a place of the canvas.
function showAt(point, x, y) {
  const k = scale();
  const [mx, my] = middle();
  const centre = [point[0] - (x - mx) / k, point[1] - (y - my) / k];
  state.centre = centre.map((v, i) => Math.min(Math.max(v / state.photo[i], -0.5), 1.5));
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

function overPhoto(event) {
  const viewer = vm();
  return viewer && viewer.canvas && event.target === viewer.canvas;
}

function taken(event) {
  event.stopImmediatePropagation();
  event.preventDefault();
}

function at(event) {
  const [x, y] = place(event);
  const [u, v] = photoFromCanvas(x, y);
  return {
    x: u, y: v, zoom: scale(),
    shift: event.shiftKey, ctrl: event.ctrlKey || event.metaKey,
  };
}

addEventListener("pointerdown", (event) => {
  if (!overPhoto(event) || state.pointer) return;
  taken(event);
  if (document.activeElement) document.activeElement.blur();
  const canvas = vm().canvas;
  try { canvas.setPointerCapture(event.pointerId); } catch (error) { /* a synthetic pointer */ }
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
  showHint();
}, true);

function flush() {
  if (!state.pending) return;
  const message = state.pending;
  state.pending = null;
  send(message);
}

addEventListener("pointermove", (event) => {
  hover(event);
  if (!state.pointer) {
    if (overPhoto(event)) event.stopImmediatePropagation();
    return;
  }
  taken(event);
  if (state.pointer === "draw") { goOn(event); return; }
  if (state.pointer === "pan") { showAt(state.anchor, ...place(event)); return; }
  const first = !state.pending;
  state.pending = { kind: "drag", ...at(event) };
  if (first) requestAnimationFrame(flush); // one message a frame
}, true);

function ended(event, kind) {
  if (!state.pointer) return;
  taken(event);
  if (state.pointer === "drag") {
    flush();
    send({ kind });
  }
  if (state.pointer === "draw") lift(kind);
  state.pointer = null;
  showHint();
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
  const [x, y] = place(event);
  const factor = Math.exp(-event.deltaY * lines * 0.0016);
  if (pen.shape === "brush" && !event.ctrlKey && !event.metaKey) sizePen(factor);
  else zoomAt(x, y, factor);
}, { capture: true, passive: false });

// --- strokes ------------------------------------------------------------------------------------

// Where a tool draws, the main button leaves a stroke. It is drawn here at once, on a sheet over the
// photo, and sent when it is done; it stays on the sheet until the server has taken it.
const sheet = document.createElement("canvas");
sheet.id = "poseviewer-sheet";
sheet.style.cssText = "position:absolute;left:0;top:0;width:100%;height:100%;z-index:4;" +
  "pointer-events:none";
const pen = {
  shape: "", // "brush", "polygon", "scribble"
  erases: false, // unless alt or shift is held
  radius: 18, // of the brush, CSS px
  at: null, // where the pointer is, CSS px of the canvas
  now: null, // the stroke that is being drawn: {shape, points (photo px), radius (photo px), erase}
  done: [], // strokes that the server has not taken yet
};
const SCRIBBLE = 3; // half its width, CSS px
const STEP = 1.5; // CSS px between a stroke's points
const NEAR = 9; // CSS px: a press so near to a polygon's first corner closes it
const LASSO = 12; // points of one drag from which on a polygon is closed when the button goes up

function setPen(shape, erases) {
  if (shape !== pen.shape) pen.now = null;
  pen.shape = shape;
  pen.erases = erases;
  drawSheet();
}

function sizePen(factor) {
  pen.radius = Math.min(Math.max(pen.radius * factor, 2), 240);
  drawSheet();
}

const erasing = (event) => pen.erases !== (event.altKey || event.shiftKey);
const apart = (one, other) =>
  Math.hypot(one[0] - other[0], one[1] - other[1]) * scale();

function hover(event) {
  if (!pen.shape) return;
  pen.at = overPhoto(event) || state.pointer ? place(event) : null;
  pen.preview = erasing(event);
  drawSheet();
}

function beginStroke(event) {
  const point = photoFromCanvas(...place(event));
  const stroke = pen.now;
  if (stroke && pen.shape === "polygon") {
    if (stroke.points.length > 2 && apart(point, stroke.points[0]) < NEAR) finishStroke();
    else if (apart(point, stroke.points.at(-1)) >= STEP) stroke.points.push(point);
    if (pen.now) pen.now.before = pen.now.points.length;
  } else {
    const half = pen.shape === "scribble" ? SCRIBBLE : pen.radius;
    const radius = half / scale();
    pen.now = { shape: pen.shape, points: [point], radius, erase: erasing(event), before: 1 };
  }
  drawSheet();
}

function goOn(event) {
  if (!pen.now) return;
  const events = event.getCoalescedEvents ? event.getCoalescedEvents() : [];
  for (const one of events.length ? events : [event]) {
    const point = photoFromCanvas(...place(one));
    if (apart(point, pen.now.points.at(-1)) >= STEP) pen.now.points.push(point);
  }
  drawSheet();
}

function lift(kind) {
  const stroke = pen.now;
  if (!stroke) return;
  if (kind === "cancel") { pen.now = null; drawSheet(); return; }
  if (stroke.shape !== "polygon" || stroke.points.length - stroke.before >= LASSO) finishStroke();
}

function finishStroke() {
  const stroke = pen.now;
  if (!stroke || (stroke.shape === "polygon" && stroke.points.length < 3)) return;
  pen.now = null;
  pen.done.push(stroke);
  const points = stroke.points.flat().map((v) => Math.round(v * 100) / 100);
  const { shape, radius, erase } = stroke;
  send({ kind: "stroke", shape, points, radius, erase });
  drawSheet();
}

function forgetStrokes() {
  const taken = pen.done;
  // The tint's picture is decoded after it has come.
  setTimeout(() => {
    pen.done = pen.done.filter((stroke) => !taken.includes(stroke));
    drawSheet();
  }, 150);
}

let drawing = false;
function drawSheet() {
  if (drawing || (!pen.shape && !pen.done.length && !sheet.width)) return;
  drawing = true;
  requestAnimationFrame(() => { drawing = false; paintSheet(); });
}

function paintSheet() {
  const viewer = vm();
  if (!viewer || !viewer.canvas) return;
  viewer.canvas.style.cursor = pen.shape ? "crosshair" : "";
  const ratio = window.devicePixelRatio || 1;
  const size = [viewer.canvas.clientWidth, viewer.canvas.clientHeight].map((v) => v * ratio);
  const strokes = [...pen.done, ...(pen.now ? [pen.now] : [])];
  const empty = !strokes.length && !(pen.shape && pen.at);
  if (empty && !sheet.width) return;
  [sheet.width, sheet.height] = empty ? [0, 0] : size;
  if (empty) return;
  const ink = sheet.getContext("2d");
  ink.scale(ratio, ratio);
  ink.lineCap = ink.lineJoin = "round";
  for (const stroke of strokes) drawStroke(ink, stroke);
  if (!pen.shape || !pen.at || pen.shape === "polygon") return;
  const radius = pen.shape === "brush" ? pen.radius : SCRIBBLE;
  for (const [colour, width] of [["rgba(0,0,0,.6)", 3], [pen.preview ? "#fff" : "#ff4040", 1.4]]) {
    ink.beginPath();
    ink.arc(...pen.at, radius, 0, 2 * Math.PI);
    ink.strokeStyle = colour;
    ink.lineWidth = width;
    ink.stroke();
  }
}

function drawStroke(ink, stroke) {
  const places = stroke.points.map(([x, y]) => canvasFromPhoto(x, y));
  const open = stroke === pen.now;
  ink.beginPath();
  places.forEach(([x, y], i) => (i ? ink.lineTo(x, y) : ink.moveTo(x, y)));
  if (places.length === 1) ink.lineTo(...places[0]);
  const tint = stroke.erase ? "rgba(255,255,255,.4)" : "rgba(255,64,64,.5)";
  const line = stroke.erase ? "#fff" : "#ff4040";
  if (stroke.shape !== "polygon") {
    ink.strokeStyle = stroke.shape === "scribble" ? line : tint;
    ink.lineWidth = 2 * stroke.radius * scale();
    ink.stroke();
    return;
  }
  if (open && pen.at) ink.lineTo(...pen.at);
  ink.fillStyle = tint;
  ink.fill();
  ink.strokeStyle = line;
  ink.lineWidth = 1.6;
  if (!open) ink.closePath();
  ink.stroke();
  if (!open) return;
  ink.beginPath();
  ink.arc(...places[0], 4.5, 0, 2 * Math.PI);
  ink.fillStyle = line;
  ink.fill();
}

// --- keys ---------------------------------------------------------------------------------------

function typing(event) {
  const element = event.target;
  if (!element || !element.tagName) return false;
  const kind = element.tagName;
  // viser's dropdowns are text fields: they take keys only while their list is open.
  if (element.getAttribute("aria-haspopup") === "listbox") {
    return element.getAttribute("aria-expanded") === "true";
  }
  if (kind === "TEXTAREA" || kind === "SELECT" || element.isContentEditable) return true;
  const silent = ["checkbox", "radio", "range", "button"];
  return kind === "INPUT" && !silent.includes(element.type);
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
  if (typing(event)) return;
  if (dialogTakes(event)) return;
  if (pen.now && ["Enter", "Escape"].includes(event.key)) {
    taken(event);
    if (event.key === "Enter") finishStroke();
    else { pen.now = null; drawSheet(); }
    return;
  }
  if (!CONFIG.keys.includes(event.code) && !CONFIG.keys.includes(event.key)) return;
  if ((event.ctrlKey || event.metaKey) && CONFIG.leave.includes(event.code)) return;
  taken(event);
  if (document.activeElement) document.activeElement.blur();
  if (event.code === "KeyF") { showAll(); return; }
  if (event.code === "Space") openSearch();
  if (event.key === "Escape" && state.pointer === "drag") state.pointer = null;
  send({
    kind: "key", code: event.code, key: event.key, repeat: event.repeat,
    shift: event.shiftKey, ctrl: event.ctrlKey || event.metaKey,
  });
}, true);
// Then it is typed, and the keys are the page's again: once viser has seen the key, and before the
// next one comes.
addEventListener("keydown", (event) => {
  const done = event.key === "Enter" || event.key === "Escape";
  if (done && typing(event) && event.target.tagName === "INPUT") event.target.blur();
});
addEventListener("keyup", noteModifiers, true);
addEventListener("blur", () => { state.modifiers = ""; showHint(); });
// A pressed button must not take the keys with it: neither itself, nor the field that it steps.
addEventListener("pointerup", (event) => setTimeout(() => {
  const element = document.activeElement;
  const stepped = element && element.tagName === "INPUT" && element !== event.target;
  const pressed = event.target instanceof Element && event.target.closest("button");
  if (element && (element.tagName === "BUTTON" || (stepped && pressed))) element.blur();
}, 0));

function noteModifiers(event) {
  const held = event.ctrlKey || event.metaKey ? "ctrl" : event.shiftKey ? "shift" : "";
  if (held === state.modifiers) return;
  state.modifiers = held;
  showHint();
}

// --- files --------------------------------------------------------------------------------------

// All that is chosen or dropped at once is one set, sent as one file: a line of JSON, a list of
// [path, bytes], then the bytes of all files. The browser reads them only as they are sent.
const packed = new WeakSet();

function pack(files) {
  const size = files.reduce((sum, [, file]) => sum + file.size, 0);
  const folder = files[0][0].includes("/") ? files[0][0].split("/")[0] : "";
  const name = folder || files[0][1].name;
  if (size > CONFIG.largest || files.length > CONFIG.most) {
    send({ kind: "unfit", name, size, count: files.length });
    return null;
  }
  const head = JSON.stringify(files.map(([path, file]) => [path, file.size])) + "\n";
  const more = files.length > 1 && !folder ? ` and ${files.length - 1} more` : "";
  const set = new File([head, ...files.map(([, file]) => file)], name + more);
  packed.add(set);
  state.sent = set.name;
  return set;
}

function give(input, files) {
  const set = files.length ? pack(files) : null;
  if (!set) return;
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
async function filesOf(entry, found) {
  if (found.length > CONFIG.most) return;
  if (entry.isFile) {
    const file = await new Promise((done, failed) => entry.file(done, failed));
    found.push([entry.fullPath.replace(/^\/+/, ""), file]);
    return;
  }
  const reader = entry.createReader();
  for (;;) {  // a browser gives a hundred at a time
    const entries = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!entries.length) return;
    for (const inside of entries) await filesOf(inside, found);
  }
}

// What is dropped anywhere goes to the button that takes folders; else the browser would open it.
addEventListener("dragover", (event) => {
  if (event.dataTransfer && event.dataTransfer.types.includes("Files")) event.preventDefault();
}, true);
addEventListener("drop", async (event) => {
  const input = document.querySelector("input[type=file][accept=folder]") ||
    document.querySelector("input[type=file]");
  const dropped = event.dataTransfer;
  if (!dropped || !dropped.types.includes("Files") || !input) return;
  taken(event);
  // Both are gone after the first wait.
  const files = [...dropped.files].map((file) => [file.name, file]);
  const entries = [...dropped.items].map((item) => item.webkitGetAsEntry && item.webkitGetAsEntry());
  if (!entries.some((entry) => entry && entry.isDirectory)) { give(input, files); return; }
  const found = [];
  try {
    for (const entry of entries) if (entry) await filesOf(entry, found);
  } catch (error) {
    send({ kind: "unreadable", name: entries.find((entry) => entry).name });
    return;
  }
  if (found.length) give(input, found);
  else send({ kind: "empty", name: entries.find((entry) => entry).name });
}, true);

// --- the panels ---------------------------------------------------------------------------------

const folders = () => [...document.querySelectorAll(".mantine-Paper-root > .mantine-Paper-root")]
  .filter((header) => CONFIG.steps.includes(header.textContent));
const isOpen = (header) => header.querySelector(".tabler-icon-chevron-up") !== null;

// Open a step and close the others; give whether it is open already.
function openStep(label) {
  for (const header of folders()) {
    if (isOpen(header) !== (header.textContent === label)) header.click();
  }
  return folders().some((header) => header.textContent === label && isOpen(header));
}

// What a search begun by its key leads to is kept or undone there.
function openSearch() {
  const open = folders().findIndex(isOpen);
  if (open < CONFIG.steps.indexOf(CONFIG.search)) openStep(CONFIG.search);
}

// A step that is opened closes the others.
addEventListener("click", (event) => {
  if (!event.isTrusted) return;
  const header = folders().find((one) => one.contains(event.target));
  if (header && !isOpen(header)) folders().filter(isOpen).forEach((other) => other.click());
}, true);

// The page is as light as the browser prefers.
const light = matchMedia("(prefers-color-scheme: light)");
const sendTheme = () => send({ kind: "theme", light: light.matches });
light.addEventListener("change", sendTheme);

// --- what lies over the photo -------------------------------------------------------------------

const bar = document.createElement("div");
bar.id = "poseviewer-hint";
bar.style.cssText =
  "position:absolute;left:50%;bottom:14px;transform:translateX(-50%);z-index:5;" +
  "pointer-events:none;padding:5px 12px;border-radius:14px;background:rgba(13,15,19,.78);" +
  "color:#d7dae0;font:12px/1.5 system-ui,sans-serif;width:max-content;max-width:94%;" +
  "box-sizing:border-box;text-align:center";

function showHint() {
  const strong = (text, on) => (on ? `<b style="color:#35e6ff">${text}</b>` : text);
  const held = state.modifiers;
  bar.innerHTML = state.hint || [
    strong("drag", held === "") + " move",
    strong("shift", held === "shift") + " turn",
    strong("ctrl", held === "ctrl") + " roll, scale",
    "<b>wheel</b> zoom", "<b>right drag</b> pan", "<b>F</b> all", "<b>space</b> search",
    "<b>?</b> keys",
  ].map((text) => `<span style="white-space:nowrap">${text}</span>`).join(" &nbsp; ");
}

// Several photos: a press on one makes it the large one.
const STRIP = 136; // CSS px: its height, as the style has it
const EYE = '<svg viewBox="0 0 16 16"><path d="M1 8s2.6-4.5 7-4.5S15 8 15 8s-2.6 4.5-7 4.5S1 8 1 8z"/>' +
  '<circle cx="8" cy="8" r="2"/></svg>';
const strip = document.createElement("div");
strip.className = "pv-strip";
strip.hidden = true;

function setStrip(photos) {
  strip.replaceChildren(...photos.map((photo, index) => {
    const cell = document.createElement("div");
    cell.className = "pv-photo";
    cell.tabIndex = 0;
    cell.innerHTML = '<div class="pv-small"><img alt="" draggable="false">' +
      '<svg viewBox="0 0 1000 1000" preserveAspectRatio="none"></svg>' +
      `</div><div class="pv-said"><button type="button">${EYE}</button><b></b><span></span></div>`;
    cell.querySelector("img").src = photo.picture;
    cell.querySelector(".pv-small").style.aspectRatio = `${photo.width}/${photo.height}`;
    cell.querySelector("b").textContent = photo.name;
    const look = () => send({ kind: "photo", wish: "look", index });
    cell.onclick = look;
    cell.onkeydown = (event) => { if (event.key === "Enter") look(); };
    cell.querySelector("button").onclick = (event) => {
      event.stopPropagation();
      send({ kind: "photo", wish: cell.classList.contains("pv-off") ? "compare" : "leave", index });
    };
    return cell;
  }));
  strip.hidden = !photos.length;
  state.covered = strip.hidden ? 0 : STRIP;
  bar.style.bottom = `${14 + state.covered}px`;
  applyView();
}

function setStripRows(rows) {
  rows.forEach((row, index) => {
    const cell = strip.children[index];
    if (!cell) return;
    cell.classList.toggle("pv-at", row.large);
    cell.classList.toggle("pv-off", row.off);
    cell.title = row.large ? "the large photo" : "press: make it the large one";
    cell.querySelector("button").title = row.off ? "compare it again" : "do not compare it";
    cell.querySelector("span").textContent = [row.said, row.word].filter(Boolean).join(" · ");
    cell.querySelector(".pv-small svg").innerHTML = row.paths.map(([path, colour]) =>
      `<path class="pv-halo" d="${path}"/><path style="stroke:${colour}" d="${path}"/>`).join("");
    if (row.large && strip.dataset.at !== String(index)) {
      strip.dataset.at = index;
      cell.scrollIntoView({ block: "nearest", inline: "nearest" });
    }
  });
}

// --- life ---------------------------------------------------------------------------------------

function watch() {
  const viewer = vm();
  if (viewer && viewer.canvas && viewer.cameraControl && viewer.camera) {
    // Only where it is on: to set it has viser draw the scene anew.
    if (viewer.cameraControl.enabled) viewer.cameraControl.enabled = false;
    const host = viewer.canvas.parentElement;
    if (bar.parentElement !== host) { host.append(sheet, bar, strip); showHint(); }
    // The picture is shifted where the strip lies over it: what it leaves free is as dark.
    viewer.canvas.style.background = "#16181d";
    const [w, h] = [viewer.canvas.clientWidth, viewer.canvas.clientHeight];
    const view = viewer.camera.view;
    if (w !== state.size[0] || h !== state.size[1] || !view || !view.enabled) applyView();
    sizeHandles();
  }
  requestAnimationFrame(watch);
}

window.poseviewerPick = (first, second, u, v) => send({ kind: "pick", first, second, u, v });
window.poseviewerOpen = (first, second) => send({ kind: "enlarge", first, second });
window.poseviewerPart = (index) => send({ kind: "part", index });
window.poseviewerRow = (index) => send({ kind: "row", index });
window.poseviewerObject = (wish, number) => send({ kind: "object", wish, number });
window.poseviewer = {
  setPhoto(width, height) {
    state.photo = [width, height];
    showAll();
  },
  setHint(text) { state.hint = text; showHint(); },
  setPen, forgetStrokes, setStrip, setStripRows,
  canvasFromPhoto, photoFromCanvas,
  zoomAt, showAll, openStep, sent: () => state.sent,
};
document.title = CONFIG.title;
const style = document.createElement("style");
style.textContent = CONFIG.style;
document.head.appendChild(style);
document.querySelector("link[rel~='icon']").href = CONFIG.icon;
sendTheme();
if (window.name.startsWith("cut off ")) {
  send({ kind: "cut off", name: window.name.slice(8) });
  window.name = "";
}
watch();
