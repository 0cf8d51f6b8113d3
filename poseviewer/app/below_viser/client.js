// The page's script: zoom and pan of the photo, mouse, keys, files. Sent by client_script.py, which
// fills in CONFIG: channel (uuid of the text field that takes reports), plane {depth, side} (of the
// photo, world units), steps (labels of the left panel's tabs), first (the tab that opens first),
// widths (of the window, px, at which the panels become narrower), palette (sRGB of the maps'
// colours, the lowest loss first), keys (by event.code or event.key: call, a function of this page,
// else the key is reported; label, of its button; opens, whether it opens its step, "forward" only
// from an earlier one, or "always";
// leave, whether the browser keeps it while ctrl is held), largest and most (bytes and files of an
// upload), style, icon.
//
// viser's camera stays at the origin and looks along +z at the photo's plane. Zoom and pan are view
// offsets of three.js, which crop the picture and keep the registration. Events over the photo are
// consumed before viser's camera controls see them.
// After a lost connection viser sends the script again: the page reloads, reports a cut upload, and
// sends what was typed meanwhile.
const AGAIN = "poseviewer "; // begin of the window's name, which a reload keeps
if (window.poseviewer) {
  const sending = document.querySelector(".mantine-Notification-root[id^='upload-']");
  const { sent, unsent } = window.poseviewer;
  window.name = AGAIN + JSON.stringify({ cutOff: sending ? sent() : "", unsent });
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
  pressed: null, // element that the mouse has just let go
  pointer: null, // "drag", "draw" or "pan" while a button is down
  target: 0, // timer that ends showing the page as a drop target
  turn: null, // press on what a drag turns: {message, box, at, kind, moved}
  anchor: [0, 0], // point of the photo, px, that follows the pointer in a pan
  sequence: Date.now(), // makes reports differ: viser drops repeated ones, also of earlier pages
  sent: "", // name of the last upload
  step: CONFIG.first, // to be opened once its tab exists
  frames: 0, // since the tabs exist
  sheet: 0, // height of the sheet that holds all panels on a phone, CSS px
};
const before = sessionStorage.getItem("step"); // of a page that is loaded again, or of another app
if (CONFIG.steps.includes(before)) state.step = before;
const LAYOUT_FRAMES = 15; // in which viser lays out the panels
const vm = () => window.__viserMutable;
const update = (uuid, value) => ({ type: "GuiUpdateMessage", uuid, updates: { value } });

function send(message) {
  message.sequence = ++state.sequence;
  vm().sendMessage(update(CONFIG.channel, JSON.stringify(message)));
}

// --- fields -------------------------------------------------------------------------------------
// What is typed stays in its field until it is applied, as one edit: a number when its field is left
// or its arrows are let go, a text also when typing pauses. Till then viser's own message of each
// key is dropped, and the server's values for the field wait. A number field shows what it makes of
// the keys ("1.3905" of 1,390.5): what stands there otherwise than it was written is no number.
const NUMBER = ".mantine-NumberInput-input";
const TYPED = `${NUMBER}, .mantine-TextInput-input`;
const NUMERAL = /^-?\d*\.?\d*$/;
const PAUSE_MS = 500;
const LATE_MS = 100; // twice the time by which viser may send a key later
const field = {
  node: null, // that has the focus; a slider's root, too
  uuid: "",
  applied: "", // its text at first, or as it was last applied
  told: undefined, // the server's value, where it came later
  isTyped: false, // since then
  written: "", // what the field holds with the last key, before it is changed for being no number
  wrong: "", // what was written that is no number
  timer: 0, // that applies a text
  isLost: false, // it went while it had the focus: its keys still come, and are nobody's
};
const typed = new Map(); // uuids of fields that are, or just were, typed into: timer of its end
const unsent = {}; // values by uuid that were applied without a connection

const [queue, sendNow] = [vm().messageQueue, vm().sendMessage];
queue.splice = (...range) => Array.prototype.splice.apply(queue, range).map(withoutTold);
function withoutTold(message) {
  const { type, uuid, updates } = message;
  if (type !== "GuiUpdateMessage" || uuid !== field.uuid || !("value" in updates)) return message;
  const { value, ...others } = updates;
  field.told = value;
  return { type, uuid, updates: others };
}
const sendMessage = (message) => {
  if (message.type !== "GuiUpdateMessage" || !typed.has(message.uuid)) sendNow(message);
};
vm().sendMessage = sendMessage; // viser puts another one there when the connection is lost

function uuidOf(node) {
  const own = node.querySelector("label");
  return own || !node.parentElement ? own?.htmlFor : uuidOf(node.parentElement);
}

function applyField() {
  const { node, uuid, applied, told, isTyped, wrong } = field;
  clearTimeout(field.timer);
  const value = node?.matches(NUMBER) ? Number(node.value || NaN) : node?.value;
  if (wrong || Math.abs(value) === Infinity) {
    const label = [...document.querySelectorAll("label")].find((own) => own.htmlFor === uuid);
    send({ kind: "no number", name: label?.textContent ?? "", text: wrong || node.value });
    leaveField(true);
    node.blur();
    return;
  }
  if (!node || (node.value === applied && (told === undefined || !isTyped))) return;
  if (Number.isNaN(value)) return;
  Object.assign(field, { applied: node.value, told: undefined, isTyped: false });
  if (vm().sendMessage === sendMessage) sendNow(update(uuid, value));
  else unsent[uuid] = value;
}

// Apply a field as it is left, or take back what was typed, as what is no number.
function leaveField(isTakenBack) {
  if (!isTakenBack) applyField();
  const { node, uuid, applied } = field;
  if (!node) return; // it was taken back
  const isWrong = node.value !== applied;
  const value = field.told ?? (isWrong ? Number(applied) : undefined);
  Object.assign(field, { node: null, uuid: "", wrong: "" });
  if (typed.has(uuid)) typed.set(uuid, setTimeout(() => typed.delete(uuid), LATE_MS));
  if (isWrong) show(uuid, ""); // else what viser has might not change
  if (value !== undefined) queueMicrotask(() => show(uuid, value));
}

function show(uuid, value) {
  queue.push(update(uuid, value));
  vm().drainMessageQueue?.();
}

addEventListener("focusin", (event) => {
  field.isLost = false;
  const node = event.target.closest?.(`${TYPED}, .mantine-Slider-root`);
  if (!node || node === field.node) return;
  const uuid = uuidOf(node);
  Object.assign(field, { node, uuid, applied: node.value, told: undefined, isTyped: false });
  clearTimeout(typed.get(uuid));
  if (node.matches(TYPED)) typed.set(uuid, 0);
});
addEventListener("focusout", () => {
  const { node } = field;
  if (!node || node === document.activeElement) return; // then it is the window that is left
  leaveField();
  queueMicrotask(() => { field.isLost = !node.getClientRects().length; });
});
addEventListener("pointerdown", (event) => {
  field.isLost = false;
  if (event.target !== field.node) applyField(); // before what the press does
}, true);
addEventListener("beforeinput", ({ target }) => {
  if (target !== field.node || !target.value) return;
  if (target.selectionStart === 0 && target.selectionEnd === target.value.length) field.wrong = "";
}, true);
addEventListener("input", (event) => {
  if (event.target !== field.node) return;
  field.written = field.node.value;
  if (!field.written) field.wrong = "";
}, true);
addEventListener("input", (event) => {
  if (event.target !== field.node) return;
  field.isTyped = true;
  if (field.node.matches(NUMBER)) {
    const text = field.written.replace(/^\+|\s/g, "").replace(",", "."); // 1 390 is 1390
    const shown = field.node.value;
    const isRead = Number(shown) === Number(text) && shown.includes(".") === text.includes(".");
    const isCut = shown.includes(".") && text.startsWith(shown); // after its last decimal
    if (field.wrong) field.wrong += event.data ?? "";
    else if (!NUMERAL.test(text) || !(shown === text || isRead || isCut)) field.wrong = field.written;
    return;
  }
  clearTimeout(field.timer);
  field.timer = setTimeout(applyField, PAUSE_MS);
});
addEventListener("keyup", (event) => {
  const isStep = event.target.matches?.(NUMBER) && ["ArrowUp", "ArrowDown"].includes(event.key);
  if (isStep) applyField();
});

// --- the view -----------------------------------------------------------------------------------
// CSS px per photo px: with the whole photo in the canvas, and with the zoom.
const fittedScale = () => Math.min(state.size[0] / state.photo[0], state.size[1] / state.photo[1]);
const scale = () => fittedScale() * state.zoom;
const unit = () => CONFIG.plane.side / Math.max(...state.photo); // world units per photo px

// Upper left corner of the photo on the canvas, CSS px.
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
  const k = fittedScale();
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

// Show a point of the photo at a point of the canvas.
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
function canvasPoint(event) {
  const box = vm().canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

const isOverPhoto = (event) => event.target === vm()?.canvas;

function consume(event) {
  event.stopImmediatePropagation();
  event.preventDefault();
}

const ctrl = (event) => event.ctrlKey || event.metaKey;

function pointerFields(event) {
  const [x, y] = photoFromCanvas(...canvasPoint(event));
  return { x, y, zoom: scale(), shift: event.shiftKey, ctrl: ctrl(event) };
}

addEventListener("pointerdown", (event) => {
  if (!isOverPhoto(event) || state.pointer) return;
  consume(event);
  document.activeElement?.blur();
  try { vm().canvas.setPointerCapture(event.pointerId); } catch (error) { /* a synthetic pointer */ }
  state.anchor = photoFromCanvas(...canvasPoint(event));
  if (event.button === 0 && pen.shape) {
    state.pointer = "draw";
    beginStroke(event);
  } else if (event.button === 0) {
    state.pointer = "drag";
    send({ kind: "press", ...pointerFields(event) });
  } else {
    state.pointer = "pan";
  }
}, true);

addEventListener("pointermove", (event) => {
  hover(event);
  if (!state.pointer) {
    if (isOverPhoto(event) && !state.turn) event.stopImmediatePropagation();
    return;
  }
  consume(event);
  if (state.pointer === "draw") { extendStroke(event); return; }
  if (state.pointer === "pan") { showAt(state.anchor, ...canvasPoint(event)); return; }
  send({ kind: "drag", ...pointerFields(event) }); // browsers give one move a frame
}, true);

function endGesture(event, kind) {
  if (!state.pointer) return;
  consume(event);
  if (state.pointer === "drag") send({ kind });
  if (state.pointer === "draw") liftPen(kind);
  state.pointer = null;
}
addEventListener("pointerup", (event) => endGesture(event, "release"), true);
addEventListener("pointercancel", (event) => endGesture(event, "cancel"), true);

for (const kind of ["mousedown", "mousemove", "mouseup", "click", "contextmenu"]) {
  addEventListener(kind, (event) => { if (isOverPhoto(event)) consume(event); }, true);
}

addEventListener("dblclick", (event) => {
  if (!isOverPhoto(event)) return;
  consume(event);
  if (pen.shape) finishStroke();
  else send({ kind: "double", ...pointerFields(event) });
}, true);

addEventListener("wheel", (event) => {
  if (!isOverPhoto(event)) return;
  consume(event);
  const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
  const factor = Math.exp(-event.deltaY * lines * 0.0016);
  if (pen.shape === "brush" && !ctrl(event)) {
    pen.radius = Math.min(Math.max(pen.radius * factor, 2), 240);
  } else {
    zoomAt(...canvasPoint(event), factor);
  }
}, { capture: true, passive: false });

// --- strokes ------------------------------------------------------------------------------------
// A sheet over the photo shows pins and marks, as the server draws them, and strokes of the drawing
// tools. A stroke is sent when it is done, and stays on the sheet until the server has masked it.
const sheet = document.createElementNS("http://www.w3.org/2000/svg", "svg");
sheet.classList.add("pv-sheet");
sheet.innerHTML = '<g></g><g></g><path class="pv-line pv-hovered"/>';
const [handles, strokes, hovered] = sheet.children;
const pen = {
  shape: "", // "brush", "polygon", "scribble"
  erases: false, // unless alt or shift is held
  isIdle: true, // drags hold the model
  radius: 18, // of the brush, CSS px
  at: null, // the pointer, photo px
  now: null, // stroke under way: {shape, points (photo px), radius (photo px), erase}
  done: [], // strokes that the server has not masked yet
  drawn: "", // content of the sheet
};
const SCRIBBLE = 3; // half its width, CSS px
const STEP = 1.5; // CSS px between a stroke's points
const NEAR = 9; // CSS px: a press within this distance of the first corner closes a polygon
const LASSO = 12; // points: a longer drag closes its polygon when the button goes up

function setPen(shape, erases, isIdle) {
  if (shape !== pen.shape) pen.now = null;
  Object.assign(pen, { shape, erases, isIdle });
}

// The cursor shows what a drag would do: move, turn or roll.
const picture = (path) => `url("data:image/svg+xml,${encodeURIComponent(
  `<svg xmlns="http://www.w3.org/2000/svg" width="24" height="24" fill="none" stroke-linecap="round"
  ><path d="${path}" stroke="#000" stroke-width="4.4"/><path d="${path}" stroke="#fff"
  stroke-width="2"/></svg>`)}") 12 12, grab`;
const CURSORS = {
  plain: "grab",
  shift: picture("M3 12h18M6 9l-3 3 3 3M18 9l3 3-3 3M12 3v18M9 6l3-3 3 3M9 18l3 3 3-3"),
  ctrl: picture("M20 12a8 8 0 11-3-6.200M17.500 1.500v4.500h-4.500"),
};
function cursorOf() {
  if (state.pointer === "pan") return "move";
  if (!pen.isIdle) return "crosshair";
  const drag = CURSORS[bar.dataset.held];
  return drag === "grab" && state.pointer ? "grabbing" : drag;
}

const isErasing = (event) => pen.erases !== (event.altKey || event.shiftKey);
const screenDistance = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]) * scale();
const penRadius = () => (pen.shape === "scribble" ? SCRIBBLE : pen.radius) / scale();

function hover(event) {
  if (!pen.shape) return;
  pen.at = isOverPhoto(event) || state.pointer ? photoFromCanvas(...canvasPoint(event)) : null;
  pen.preview = isErasing(event);
}

function beginStroke(event) {
  const point = photoFromCanvas(...canvasPoint(event));
  const stroke = pen.now;
  if (stroke && pen.shape === "polygon") {
    if (stroke.points.length > 2 && screenDistance(point, stroke.points[0]) < NEAR) finishStroke();
    else if (screenDistance(point, stroke.points.at(-1)) >= STEP) stroke.points.push(point);
    stroke.before = stroke.points.length;
  } else {
    const [shape, radius, erase] = [pen.shape, penRadius(), isErasing(event)];
    pen.now = { shape, points: [point], radius, erase, before: 1 };
  }
}

function extendStroke(event) {
  if (!pen.now) return;
  const events = event.getCoalescedEvents?.() ?? [];
  for (const one of events.length ? events : [event]) {
    const point = photoFromCanvas(...canvasPoint(one));
    if (screenDistance(point, pen.now.points.at(-1)) >= STEP) pen.now.points.push(point);
  }
}

function liftPen(kind) {
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
  const masked = pen.done;
  // The browser still has to decode the picture of the mask.
  setTimeout(() => { pen.done = pen.done.filter((stroke) => !masked.includes(stroke)); }, 150);
}

// The sheet's unit is a photo px; --pv-px is a screen px.
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
// Texts, and viser's dropdowns.
const isTyping = ({ target }) => target.matches?.("textarea, select, [contenteditable=true], " +
  "input:not([type=checkbox], [type=radio], [type=range], [type=button])");

// The keys of what has the focus, beside those of a field that has just gone.
const MOVES = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"];
function isTaken({ key }) {
  const target = document.activeElement ?? document.body; // the event's may just have been left
  if (field.node && target === document.body) { // it is hidden, of which browsers do not tell
    leaveField();
    field.isLost = true;
  }
  const takers = [" ", "Enter"].includes(key) ? "button, a, input, [role=tab], [role=button], [data-report]" :
    MOVES.includes(key) ? "[role=slider], [role=tab]" : "";
  return isTyping({ target }) || (field.isLost && target === document.body) ||
    (takers && target.matches?.(takers));
}

// An open dialog gets the keys; Esc and ? press its button Close.
function dialogTakes(event) {
  const open = document.querySelector('[role="dialog"][aria-modal="true"]');
  if (!open) return false;
  const close = [...open.querySelectorAll("button")].find((b) => b.textContent.trim() === "Close");
  if (close && (event.key === "Escape" || event.key === "?")) {
    consume(event);
    close.click();
  }
  return true;
}

addEventListener("keydown", (event) => {
  leavePressed();
  noteModifiers(event);
  // Else the browser's menu gets the keys.
  if (event.key === "Alt" && pen.shape) event.preventDefault();
  const saves = ctrl(event) && event.code === "KeyS";
  if ((isTaken(event) && !saves) || dialogTakes(event)) return;
  if (pen.now && ["Enter", "Escape"].includes(event.key)) {
    consume(event);
    if (event.key === "Enter") finishStroke();
    else pen.now = null;
    return;
  }
  const action = CONFIG.keys[event.key] ?? CONFIG.keys[event.code];
  if (!action || (ctrl(event) && action.leave)) return;
  consume(event);
  if (isTyping(event)) applyField();
  else document.activeElement?.blur();
  if (action.call) { window.poseviewer[action.call](); return; }
  openStepOf(action);
  if (event.key === "Escape" && state.pointer === "drag") state.pointer = null;
  const { code, key, repeat } = event;
  const held = { shift: event.shiftKey, ctrl: ctrl(event), alt: event.altKey };
  send({ kind: "key", code, key, repeat, ...held });
}, true);
// Enter and Esc leave a field, after viser has seen the key; Esc takes a number back. Enter may open
// a dropdown.
addEventListener("keydown", (event) => {
  const [node, isEscape] = [event.target, event.key === "Escape"];
  const isDone = isEscape || (event.key === "Enter" && node.ariaExpanded !== "false");
  if (!isDone || !isTyping(event) || event.isComposing || node.tagName !== "INPUT") return;
  if (isEscape && node.matches(NUMBER)) leaveField(true);
  node.blur();
});
addEventListener("keyup", noteModifiers, true);
addEventListener("blur", noteModifiers);
// The mouse leaves the keys to the photo but where it is typed; so do the buttons that step a field
// and the options of a dropdown.
addEventListener("pointerup", ({ target }) => {
  state.pressed = target;
  setTimeout(leavePressed, 0); // after what the press does
});
function leavePressed() {
  const target = document.activeElement;
  const isPressed = state.pressed?.closest?.("button, [role=option]");
  if (state.pressed && target && (isPressed || !isTyping({ target }))) target.blur();
  state.pressed = null;
}

function noteModifiers(event) {
  bar.dataset.held = ctrl(event) ? "ctrl" : event.shiftKey ? "shift" : "plain";
}

// --- files --------------------------------------------------------------------------------------
// All files chosen or dropped at once are sent as one: a line of JSON (a list of [path, bytes]) and
// the bytes of all files, which the browser reads as they are sent.
const packed = new WeakSet();

function sendFiles(input, files) {
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

// viser's notices of uploads show a bar: they also say the share, and the time that is left.
const SOME_MS = 2000; // after which a pace is known
const begun = {}; // times of uploads' first notices, ms, by their ids
function sayUploads() {
  for (const progress of document.querySelectorAll("[id^='upload-'] [role=progressbar]")) {
    const [notice, share] = [progress.closest("[id^='upload-']"), progress.ariaValueNow / 100];
    const spent = performance.now() - (begun[notice.id] ??= performance.now());
    const left = Math.ceil((spent / 1000 / share) * (1 - share));
    const time = left < 60 ? `${left} s` : `${Math.round(left / 60)} min`;
    notice.dataset.said = `${Math.round(100 * share)} %` + (spent > SOME_MS && share ? `, ${time} left` : "");
  }
}

// Let the browser's file chooser take several files, or a folder.
addEventListener("click", (event) => {
  const input = event.target;
  if (!(input instanceof HTMLInputElement) || input.type !== "file") return;
  input.multiple = true;
  input.webkitdirectory = input.accept === "folder";
}, true);

// Before viser reads the files: it would send only one, and all of one that is refused.
addEventListener("change", (event) => {
  const input = event.target;
  if (input.type !== "file" || !input.files.length || packed.has(input.files[0])) return;
  consume(event);
  sendFiles(input, [...input.files].map((file) => [file.webkitRelativePath || file.name, file]));
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

// Files dropped anywhere go to the button for folders; else the browser would open them. While they
// are dragged over the page, it shows itself as their target.
const TARGET_MS = 1000; // browsers tell of a drag over the page at least each half second
function showTarget(on) {
  document.documentElement.classList.toggle("pv-target", on);
  clearTimeout(state.target);
  if (on) state.target = setTimeout(() => showTarget(false), TARGET_MS);
}
addEventListener("dragover", (event) => {
  if (!event.dataTransfer?.types.includes("Files")) return;
  event.preventDefault();
  showTarget(true);
}, true);
addEventListener("drop", async (event) => {
  showTarget(false);
  const input = document.querySelector("input[type=file][accept=folder]");
  const dropped = event.dataTransfer;
  if (!dropped?.types.includes("Files") || !input) return;
  consume(event);
  // Both are gone after the first await.
  const files = [...dropped.files].map((file) => [file.name, file]);
  const entries = [...dropped.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.some((entry) => entry.isDirectory)) { sendFiles(input, files); return; }
  const inside = [];
  try {
    for (const entry of entries) await filesOf(entry, inside);
  } catch (error) {
    send({ kind: "not sent", trouble: "unreadable", name: entries[0].name });
    return;
  }
  if (inside.length) sendFiles(input, inside);
  else send({ kind: "not sent", trouble: "empty", name: entries[0].name });
}, true);

// --- the panels ---------------------------------------------------------------------------------
// A button opens the step that its key opens.
addEventListener("click", (event) => {
  const label = event.target.closest?.("button")?.textContent.trim();
  const action = label && Object.values(CONFIG.keys).find((own) => own.label === label);
  if (action) openStepOf(action);
});

// A button over the photo presses the one of a step, by its label.
addEventListener("click", (event) => {
  const label = event.target.closest?.("[data-presses]")?.dataset.presses;
  const buttons = label ? [...document.querySelectorAll("button")] : [];
  buttons.find((button) => button.textContent.trim() === label)?.click();
});

// Open the step of an action, if the action opens it.
function openStepOf(action) {
  const isLater = CONFIG.steps.findIndex(isOpen) >= CONFIG.steps.indexOf(action.step);
  if (action.opens === "always" || (action.opens && !isLater)) openStep(action.step);
}

// Docked tabs are opened by Enter, those of a narrow page by a click.
const tabOf = (step) =>
  [...document.querySelectorAll("[role=tab]")].find((tab) => tab.textContent === step);
const isOpen = (step) => tabOf(step)?.ariaSelected === "true";

// Open a step; give whether it is open.
function openStep(step) {
  sessionStorage.setItem("step", step); // a page that is loaded again opens it
  tabOf(step)?.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
  tabOf(step)?.click();
  return isOpen(step);
}

addEventListener("click", (event) => {
  const step = event.target.closest?.("[role=tab]")?.textContent;
  if (event.isTrusted && CONFIG.steps.includes(step)) sessionStorage.setItem("step", step);
}, true);

// viser's folders open by the mouse alone: here also by Tab and Enter.
const FOLDER = ".mantine-Paper-root:has(> .tabler-icon-chevron-down, > .tabler-icon-chevron-up)";
function nameFolders() {
  for (const head of document.querySelectorAll(FOLDER)) {
    const ariaExpanded = String(Boolean(head.querySelector(".tabler-icon-chevron-up")));
    if (head.ariaExpanded === ariaExpanded) continue;
    Object.assign(head, { role: "button", tabIndex: 0, ariaExpanded });
  }
}
addEventListener("keydown", (event) => {
  if (![" ", "Enter"].includes(event.key) || !event.target.matches?.(FOLDER)) return;
  event.preventDefault();
  event.target.click();
});

// Panels that a user has folded are so in a page that is loaded again.
const FOLDING_MS = 300; // in which viser folds a panel that is pressed
const panelOn = (side, part) => document.querySelector(`[data-dock-region=${side}] [data-dock-${part}]`);
function noteFolds({ isTrusted }) {
  if (!isTrusted || state.frames <= LAYOUT_FRAMES) return;
  setTimeout(() => {
    const folded = ["left", "right"].filter((side) => panelOn(side, "column-rail"));
    sessionStorage.setItem("folded", folded.join(" "));
  }, FOLDING_MS);
}
addEventListener("pointerup", noteFolds, true);
addEventListener("keyup", noteFolds, true);
function foldAgain() {
  const sides = sessionStorage.getItem("folded")?.split(" ").filter(Boolean) ?? [];
  for (const side of sides) panelOn(side, "region-collapse")?.click();
}

const CLICK = 4; // CSS px that a press may move before it turns what it is on
// Presses, also by Enter or space, on elements with a report: sent with the point, in shares of the
// element's sides from its lower left corner. What is dragged with data-turns turns instead, and
// with data-slides each move is sent.
function report(event) {
  const node = event.target.closest?.("[data-report]");
  if (!node || (event.type === "keydown" && ![" ", "Enter"].includes(event.key))) return;
  if (event.type === "keydown") event.preventDefault();
  const box = node.getBoundingClientRect();
  const slides = "slides" in node.dataset;
  const u = slides ? along(box, event) : (event.clientX - box.left) / box.width;
  const message = { ...JSON.parse(node.dataset.report), u,
    v: (box.bottom - event.clientY) / box.height };
  const [at, kind] = [[event.clientX, event.clientY], node.dataset.turns];
  const isTurn = (kind || slides) && event.type === "pointerdown";
  if (isTurn) state.turn = { message, box, at, kind, slides, moved: slides };
  if (!isTurn || slides) send(message);
}
addEventListener("pointermove", (event) => {
  const turn = state.turn;
  if (!turn) return;
  if (turn.slides) {
    send({ ...turn.message, u: along(turn.box, event) });
    return;
  }
  const [right, down] = [event.clientX - turn.at[0], event.clientY - turn.at[1]];
  if (!turn.moved && Math.hypot(right, down) < CLICK) return;
  Object.assign(turn, { moved: true, at: [event.clientX, event.clientY] });
  send({ kind: turn.kind, right: right / turn.box.width, down: down / turn.box.height });
});
addEventListener("pointerup", () => {
  if (state.turn && !state.turn.moved) send(state.turn.message);
  state.turn = null;
});
addEventListener("pointercancel", () => { state.turn = null; });
addEventListener("pointerdown", report);
addEventListener("keydown", report);

// The outline of a start that is hovered is drawn over the photo.
addEventListener("pointerover", (event) => {
  const path = event.target.closest?.(".pv-starts button")?.querySelector("path");
  hovered.setAttribute("d", path?.getAttribute("d") ?? "");
});

// The labels of a plot's values have as many digits as tell them apart; uPlot has three at most.
function valueLabels(chart, splits) {
  const gap = Math.min(...splits.slice(1).map((value, i) => value - splits[i]));
  const isExact = (digits) =>
    splits.every((value) => Math.abs(Number(value.toFixed(digits)) - value) < 0.01 * gap);
  let digits = 0;
  while (digits < 9 && splits.length > 1 && !isExact(digits)) digits += 1;
  return splits.map((value) => (splits.length > 1 ? value.toFixed(digits) : String(value)));
}

function labelPlots() {
  for (const { chart } of Object.values(window.__viserTestpoints?.uplots ?? {})) {
    const axis = chart.axes[1];
    if (axis.values === valueLabels) continue;
    axis.values = valueLabels;
    chart.redraw(false, true);
  }
}

// The icon of viser's own settings, which are a developer's, opens our help.
const HELP = ".mantine-ActionIcon-root:has(.tabler-icon-adjustments)";
addEventListener("click", (event) => {
  if (!event.target.closest?.(HELP)) return;
  consume(event);
  send({ kind: "key", code: "?", key: "?" });
}, true);

// Buttons that would do nothing now are grey: by their labels, since viser disables no groups.
let idle = [];
function greyIdle() {
  for (const button of document.querySelectorAll(".mantine-Button-root")) {
    const isIdle = idle.includes(button.textContent.trim()) ? "true" : null;
    if (button.ariaDisabled !== isIdle) button.ariaDisabled = isIdle;
  }
  document.querySelector(HELP)?.setAttribute("aria-label", "Help");
}

// Texts are copied through a field: a page without TLS has no other clipboard.
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

// Light or dark, and the size of text, as the browser prefers.
const light = matchMedia("(prefers-color-scheme: light)");
const USUAL = 14.8; // px: viser's text at the browser's default size
const textSize = () =>
  Math.max(1, parseFloat(getComputedStyle(document.documentElement).fontSize) / USUAL);
const widths = CONFIG.widths.map((width) => matchMedia(`(max-width: ${width - 1}px)`));
const sendTheme = () =>
  send({ kind: "theme", light: light.matches, text: textSize(), width: innerWidth });
for (const query of [light, ...widths]) query.addEventListener("change", sendTheme);

// Maps that are folded away are not computed.
let seesMaps = null; // not told yet
function tellMaps() {
  if (state.frames <= LAYOUT_FRAMES) return;
  const sees = Boolean(document.querySelector(".pv-both")?.getClientRects().length);
  if (sees !== seesMaps) send({ kind: "maps", seen: sees });
  seesMaps = sees;
}

// --- what lies over the photo -------------------------------------------------------------------
const bar = document.createElement("div");
bar.className = "pv-hint";
bar.dataset.held = "plain";

// Without a server the page waits for one; a second tab says that it is one.
const gone = document.createElement("div");
gone.className = "pv-gone";
gone.role = "alert";
gone.innerHTML = "<b>poseviewer has ended, or is out of reach.</b> Your work is kept: start it " +
  "again, and this page comes back by itself.";
const tabs = document.createElement("div");
tabs.className = "pv-tabs";

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
  showSpan();
  const large = [...strip.children].findIndex((cell) => cell.classList.contains("pv-at"));
  if (large >= 0 && large !== state.large) {
    strip.children[large].scrollIntoView({ block: "nearest", inline: "nearest" });
  }
  state.large = large;
}

// --- the time line ------------------------------------------------------------------------------
// The wheel zooms into a span of it. What lies under the pointer is said beside it.
const FEWEST = 8; // frames that are shown at most zoom
const span = { from: 0, to: 1, count: 0, at: -1 }; // shares of its frames, number of these, shown one
const tip = document.createElement("div");
tip.className = "pv-tip";
let times = []; // of frames, s; null: not known

const lines = () => [...strip.querySelectorAll("svg[data-slides]")];
// Place of an event along the time line, in shares of all frames.
const along = (box, event) =>
  span.from + ((event.clientX - box.left) / box.width) * (span.to - span.from);

// Show a length of the line, with an anchor at a part of it.
function setSpan(length, anchor = 0, part = 0) {
  const wide = Math.min(Math.max(length, FEWEST / Math.max(span.count, FEWEST)), 1);
  span.from = Math.min(Math.max(anchor - part * wide, 0), 1 - wide);
  span.to = span.from + wide;
}

// Bring the lines to the span, which follows the frame that is shown.
function showSpan() {
  const [line] = lines();
  if (!line) { tip.hidden = true; return; }
  const [count, at] = [Number(line.dataset.slides), Number(line.dataset.at)];
  if (count !== span.count) {
    span.count = count;
    setSpan(1);
  }
  const [first, last] = [at / count, (at + 1) / count];
  if (at !== span.at && (first < span.from || last > span.to)) {
    setSpan(span.to - span.from, (first + last) / 2, 0.5);
  }
  span.at = at;
  for (const node of lines()) {
    node.setAttribute("viewBox", `${span.from * count} 0 ${(span.to - span.from) * count} 1`);
    node.classList.toggle("pv-zoomed", span.to - span.from < 1);
  }
}

function showTip(event) {
  const isSliding = state.turn?.slides;
  const map = event.target.closest?.("svg[data-map]");
  const line = isSliding ? lines()[0] : event.target.closest?.("svg[data-slides]");
  tip.hidden = !(line || map);
  if (!line) {
    if (map) sayMap(map, event);
    return;
  }
  const box = line.getBoundingClientRect();
  const share = along(isSliding ? state.turn.box : box, event);
  const index = Math.min(Math.max(Math.floor(share * span.count), 0), span.count - 1);
  const time = times[index] ?? null;
  sayAt(event.clientX, box, `${lines()[0].dataset.what} ${index + 1}` +
    (time === null ? "" : ` · ${time.toFixed(2)} s`));
}

// Show the tip above a box, within given borders.
function sayAt(x, box, text, [first, last] = [box.left, box.right]) {
  tip.textContent = text;
  const half = tip.offsetWidth / 2;
  const left = Math.max(Math.min(Math.max(x, first + half), last - half), 0);
  Object.assign(tip.style, { left: `${left - half}px`, top: `${box.top - tip.offsetHeight - 3}px` });
}

// Of a map the two parameters and the loss under the pointer, as its picture's colour has it.
const pixel = Object.assign(document.createElement("canvas"), { width: 1, height: 1 });
const ink = pixel.getContext("2d", { willReadFrequently: true });
const levels = new Map(CONFIG.palette.map((colour, level) => [String(colour), level]));
function sayMap(map, event) {
  const { axes, low, high, what, side } = JSON.parse(map.dataset.map);
  const box = map.getBoundingClientRect();
  const [u, v] = [event.clientX - box.left, box.bottom - event.clientY].map(
    (place) => Math.min(Math.max(place / box.width, 0), 1));
  const [column, row] = [u, 1 - v].map((share) => Math.round(share * (side - 1)));
  ink.drawImage(map.querySelector("image"), column, row, 1, 1, 0, 0, 1, 1);
  const level = levels.get(String([...ink.getImageData(0, 0, 1, 1).data.slice(0, 3)]));
  const loss = low + ((high - low) * level) / (CONFIG.palette.length - 1);
  const numbers = axes.map(([name, first, last], i) =>
    `${name} ${Number((first + [u, v][i] * (last - first)).toPrecision(4))}`);
  sayAt(event.clientX, box, [...numbers, `${what} ${Number.isFinite(loss) ? loss.toFixed(3) : "not known"}`].join(" · "), [0, innerWidth]);
}

addEventListener("pointermove", showTip);
addEventListener("pointerover", showTip); // of moves over the photo nobody else is told
addEventListener("wheel", (event) => {
  const line = event.target.closest?.("svg[data-slides]");
  if (!line) return;
  consume(event);
  const [box, length] = [line.getBoundingClientRect(), span.to - span.from];
  const unit = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
  const isPan = event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY);
  if (isPan) {
    setSpan(length, span.from + ((event.deltaX || event.deltaY) * unit * length) / box.width);
  } else {
    const part = (event.clientX - box.left) / box.width;
    setSpan(length * Math.exp(event.deltaY * unit * 0.0016), along(box, event), part);
  }
  showSpan();
  showTip(event);
}, { capture: true, passive: false });

// --- life ---------------------------------------------------------------------------------------
function watch() {
  const viewer = vm();
  if (viewer && viewer.canvas && viewer.cameraControl && viewer.camera) {
    // Only if needed: setting it makes viser redraw the scene.
    if (viewer.cameraControl.enabled) viewer.cameraControl.enabled = false;
    const host = viewer.canvas.parentElement;
    if (bar.parentElement !== host) {
      host.style.position = "relative";
      host.append(sheet, bar, tabs, gone);
      host.after(strip); // the canvas ends where it begins
    }
    host.style.height = `calc(100% - ${strip.offsetHeight + state.sheet}px)`;
    const { clientWidth, clientHeight } = viewer.canvas;
    const isAsWas = clientWidth === state.size[0] && clientHeight === state.size[1];
    if (!viewer.camera.view?.enabled || !isAsWas) applyView();
    drawSheet();
    labelPlots();
    if (state.frames % LAYOUT_FRAMES === 0) {
      state.sheet = document.querySelector("[style*='width: 20em'][style*=fixed]")?.offsetHeight ?? 0;
      greyIdle();
      nameFolders();
      sayUploads();
      tellMaps();
    }
    gone.hidden = viewer.sendMessage === sendMessage;
    viewer.canvas.style.cursor = cursorOf();
    if (!state.step || tabOf(state.step)) state.frames += 1;
    if (state.frames === LAYOUT_FRAMES) {
      foldAgain();
      document.documentElement.classList.add("pv-ready");
    }
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
  setTimes(known) { times = known; },
  setIdle(labels) { idle = labels; },
  setTabs(count) {
    tabs.textContent = count > 1 ? `open in ${count} tabs, which all show the same work` : "";
  },
  setPen, forgetStrokes, setPictures, setStrip, photoFromCanvas, zoomAt, showAll,
  sent: () => state.sent,
  unsent,
};
document.title = "poseviewer";
const style = document.createElement("style");
style.textContent = CONFIG.style;
document.head.append(style, pictures);
tip.hidden = true;
document.body.append(tip);
document.querySelector("link[rel~='icon']").href = CONFIG.icon;
sendTheme();
if (window.name.startsWith(AGAIN)) {
  const before = JSON.parse(window.name.slice(AGAIN.length));
  if (before.cutOff) send({ kind: "not sent", trouble: "cut off", name: before.cutOff });
  for (const [uuid, value] of Object.entries(before.unsent)) sendNow(update(uuid, value));
  window.name = "";
}
watch();
