"use strict";
const MAX_PINS = 4;
const $ = (id) => document.getElementById(id);
const state = { limits: {}, design: {}, shown: null, before: null, undo: [], redo: [], pins: [], asking: false, again: false, solving: false };

// who answers: the program that serves the page, or without one a worker with the model that the page holds
let worker = null;
const asked = new Map();
function startWorker() {
  worker = new Worker(URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" })));
  worker.onmessage = ({ data }) => {
    const { done, fail } = asked.get(data.id);
    asked.delete(data.id);
    if (data.error === undefined) done(data.found); else fail(new Error(data.error));
  };
  worker.onerror = (fault) => { for (const { fail } of asked.values()) fail(new Error(`the page's own model failed: ${fault.message}`)); asked.clear(); };
  return askWorker({ document: $("model").textContent, numbers: $("numbers-of-model").textContent });
}
const askWorker = (words) => new Promise((done, fail) => {
  const id = ++asked.last || (asked.last = 1);
  asked.set(id, { done, fail });
  worker.postMessage({ id, ...words });
});

async function ask(path, body) {
  if (worker) {
    const found = await askWorker({ path, body });
    return typeof found === "string" ? found : JSON.stringify(found);
  }
  let response;
  try {
    response = await fetch(path, body === undefined ? {} : { method: "POST", body: JSON.stringify(body) });
  } catch {
    throw new Error("the program that serves this page has ended: start it again, the address bar keeps the design");
  }
  const text = await response.text();
  if (!response.ok) {
    let why = text;
    try { why = JSON.parse(text).error; } catch { /* the text itself says it */ }
    throw new Error(why);
  }
  return text;
}
const answer = async (path, body) => JSON.parse(await ask(path, body));

function say(text, bad) {
  $("said").textContent = text;
  $("said").className = bad ? "bad" : "";
}

function fromAddress(own) {
  const query = new URLSearchParams(location.hash.slice(1));
  const design = { ...own };
  for (const name of Object.keys(own)) {
    const text = query.get(name);
    if (text !== null && text.trim() !== "" && Number.isFinite(Number(text))) design[name] = Number(text);
  }
  return design;
}
function intoAddress() {
  history.replaceState(null, "", "#" + new URLSearchParams(state.design).toString());
}

function buildForm() {
  for (const [name, limit] of Object.entries(state.limits)) {
    const label = document.createElement("label");
    const title = document.createElement("span");
    title.textContent = `${limit.word}${limit.unit ? ` (${limit.unit})` : ""}, ${limit.low} to ${limit.high}`;
    label.append(title);
    for (const kind of ["range", "number"]) {
      const input = document.createElement("input");
      Object.assign(input, { type: kind, id: `${name}-${kind}`, min: limit.low, max: limit.high, step: kind === "range" ? limit.step : "any" });
      input.setAttribute("aria-label", `${limit.word}, ${kind === "range" ? "slider" : "typed"}`);
      input.addEventListener("input", () => changed(name, input));
      if (kind === "range") input.addEventListener("change", () => { state.dragging = false; });
      label.append(input);
    }
    $("design").append(label);
  }
  $("design").addEventListener("submit", (event) => event.preventDefault());
}
function show(design) {
  for (const [name, value] of Object.entries(design)) {
    $(`${name}-range`).value = value;
    if (document.activeElement !== $(`${name}-number`)) $(`${name}-number`).value = value;
  }
}
function changed(name, input) {
  if (input.value.trim() === "") return;
  if (!state.dragging) remember();
  state.dragging = input.type === "range";
  state.design = { ...state.design, [name]: Number(input.value) };
  show(state.design);
  refresh();
}
function remember() {
  state.undo.push({ ...state.design });
  if (state.undo.length > 100) state.undo.shift();
  if (state.shown) state.before = state.shown;
  state.redo = [];
  buttons();
}
function buttons() {
  $("undo").disabled = !state.undo.length;
  $("redo").disabled = !state.redo.length;
}
function step(from, onto) {
  state.before = state.shown;
  onto.push({ ...state.design });
  state.design = from.pop();
  buttons();
  show(state.design);
  refresh();
}

const LATE_MS = 200; // an answer sooner needs no words
// one question at a time: what was dragged meanwhile is asked as soon as the answer is here
async function refresh() {
  intoAddress();
  drawPlate();
  if (state.asking) { state.again = true; return; }
  state.asking = true;
  document.body.classList.add("stale"); // until an answer is here: figures of another design are grey and still
  const late = setTimeout(() => say("computing this design ...", false), LATE_MS);
  try {
    state.shown = await answer("answer", state.design);
    say("", false);
    if (!state.again) document.body.classList.remove("stale");
    draw();
  } catch (fault) {
    say(fault.message, true);
  }
  clearTimeout(late);
  state.asking = false;
  if (state.again) { state.again = false; refresh(); }
}

function headline(found) {
  const plate = found.plate;
  const numbers = [];
  if (plate.why_not) numbers.push(["Target mode", "none", plate.why_not]);
  else {
    numbers.push(["Target frequency", frequency(plate.frequency_hz, plate.frequency_error), `${frequencyBar(plate.frequency_hz, plate.frequency_error)}${plate.status === "split" ? ", split among several modes" : ""}`]);
    for (const one of plate.others) numbers.push(["or", frequency(one.frequency_hz, one.frequency_error), `${one.confinement_db === null ? "" : `confinement ${level(one.confinement_db, one.confinement_error_db)}; `}another mode that may be the strongest`]);
    numbers.push(["Confinement", plate.confinement_db === null ? "no passive part" : level(plate.confinement_db, plate.confinement_error_db), plate.confinement_error_db === null ? "no bar known" : `${ofBar(plate.confinement_error_db, "dB")}${plate.near_hz === null ? "" : `, a mode at ${frequency(plate.near_hz, null)} is near`}`]);
    if (plate.extension_db !== null) numbers.push(["Zone over extension", level(plate.extension_db, plate.extension_error_db), ofBar(plate.extension_error_db, "dB")]);
    const decay = decayAt(found.rows, plate.frequency_hz);
    if (decay !== null) numbers.push(["Decay per row", level(decay, null), "at the target frequency and wavenumber"]);
  }
  numbers.push(["Decay band", ...decayBand(found)]);
  const worst = Math.max(...found.bands.error);
  const mesh = found.bands.mesh_error, told = mesh === null ? "at most by the bases; what the mesh adds is not known" : `at most, and ${figure(100 * Math.max(...mesh), 100 * Math.max(...mesh))} % by the mesh`;
  numbers.push(["Error of the bands", `${figure(100 * worst, 100 * worst)} %`, told]);
  return numbers;
}
// where the rows take CONFINED_DB from the flexural wave: about the target frequency, else the widest such interval
const CONFINED_DB = 10;
function decayBand(found) {
  const rows = found.design.rows, hz = found.rows.frequency_hz, least = CONFINED_DB / rows, bands = [];
  if (!rows || !hz.length) return ["none", rows ? "the target wavenumber lies beyond the zone's edge" : "there are no rows"];
  const level = found.rows.db_per_row.map((v) => v === null ? Infinity : v); // null: steeper than any that is followed
  const edge = (i, j) => Number.isFinite(level[i] + level[j]) ? hz[i] + (hz[j] - hz[i]) * (least - level[i]) / (level[j] - level[i]) : hz[j];
  for (let i = 0; i < hz.length; i++) {
    if (level[i] < least) continue;
    const first = i;
    while (i + 1 < hz.length && level[i + 1] >= least) i++;
    bands.push([first ? edge(first - 1, first) : hz[0], i + 1 < hz.length ? edge(i + 1, i) : hz[i]]);
  }
  const tone = found.plate.why_not ? NaN : found.plate.frequency_hz, wide = (band) => band[1] - band[0];
  const own = bands.find(([low, high]) => low <= tone && tone <= high) || bands.sort((a, b) => wide(b) - wide(a))[0];
  const who = rows === 1 ? "the row takes" : `${rows} rows take`;
  if (!own) return ["none", `nowhere from ${interval(hz[0], hz[hz.length - 1])} ${rows === 1 ? "does the row" : `do ${rows} rows`} take ${CONFINED_DB} dB`];
  const whole = own[0] === hz[0] && own[1] === hz[hz.length - 1] ? ", or more widely" : "";
  return [interval(...own), `${who} at least ${CONFINED_DB} dB${whole}`];
}
function decayAt(rows, hz) {
  const x = rows.frequency_hz, y = rows.db_per_row;
  for (let i = 1; i < x.length; i++)
    if (x[i - 1] <= hz && hz <= x[i] && y[i - 1] !== null && y[i] !== null)
      return y[i - 1] + (y[i] - y[i - 1]) * (hz - x[i - 1]) / (x[i] - x[i - 1]);
  return null;
}

function draw() {
  const found = state.shown;
  $("numbers").replaceChildren(...headline(found).map(([name, value, note]) => {
    const card = document.createElement("div"), title = document.createElement("dt"), text = document.createElement("dd"), small = document.createElement("small");
    card.className = "card"; title.textContent = name; text.textContent = value; small.textContent = note;
    text.append(small); card.append(title, text);
    return card;
  }));
  $("warnings").replaceChildren(...found.warnings.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  drawPlate();
  drawBands(found, state.before);
  drawDecay(found, state.before);
  drawProfile(found, state.before);
}

const NS = "http://www.w3.org/2000/svg";
function put(svg, tag, attributes, text) {
  const element = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text !== undefined) element.textContent = text;
  svg.append(element);
  return element;
}
// letters of at least LETTER px on the screen, in the units of a picture whose width follows the window
const LETTER = 12, WIDTH = 620;
const letters = (svg) => Math.max(13, LETTER * WIDTH / (svg.clientWidth || WIDTH));
// round values between two ends: pairs of value and text
function ticks(low, high) {
  const raw = (high - low) / 5 || 1, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= raw), first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.max(0, Math.floor(high / step + 1e-9) - first + 1) }, (_, i) => [(first + i) * step, String(Number(((first + i) * step).toPrecision(6)))]);
}
// axes between two ends each; what is drawn `inside` them ends at the frame
function frame(svg, [xLow, xHigh], [yLow, yHigh], xText, yText, xTicks = ticks(xLow, xHigh)) {
  svg.replaceChildren();
  const size = letters(svg), box = svg.viewBox.baseVal, left = 28 + 2.5 * size, top = 1.1 * size, width = box.width - left - 1.2 * size, height = box.height - top - 3.4 * size;
  const x = (v) => left + width * (v - xLow) / (xHigh - xLow), y = (v) => top + height * (1 - (v - yLow) / (yHigh - yLow));
  const words = (place, text, more = {}) => put(svg, "text", { "font-size": size, "text-anchor": "middle", ...place, ...more }, text);
  for (const [v, text] of ticks(yLow, yHigh)) {
    put(svg, "line", { class: "grid", x1: left, x2: left + width, y1: y(v), y2: y(v) });
    words({ x: left - 6, y: y(v) + size / 3 }, text, { "text-anchor": "end" });
  }
  for (const [v, text] of xTicks) {
    if (v < xLow || v > xHigh) continue;
    put(svg, "line", { class: "grid", x1: x(v), x2: x(v), y1: top, y2: top + height });
    words({ x: x(v), y: top + height + 1.4 * size }, text);
  }
  words({ x: left + width / 2, y: top + height + 2.9 * size }, xText);
  words({ x: 1.1 * size, y: top + height / 2 }, yText, { transform: `rotate(-90 ${1.1 * size} ${top + height / 2})` });
  put(put(svg, "clipPath", { id: `${svg.id}-frame` }), "rect", { x: left, y: top, width, height });
  const inside = put(svg, "g", { "clip-path": `url(#${svg.id}-frame)` });
  put(svg, "rect", { class: "frame", x: left, y: top, width, height });
  return { x, y, left, top, width, height, inside };
}
const shaded = (at, name, [x0, x1], [y0, y1]) => put(at.inside, "rect", { class: name, x: at.x(x0), y: at.y(y1), width: at.x(x1) - at.x(x0), height: at.y(y0) - at.y(y1) });
const across = (at, name, v) => put(at.inside, "line", { class: name, x1: at.left, x2: at.left + at.width, y1: at.y(v), y2: at.y(v) });
const upright = (at, name, v) => put(at.inside, "line", { class: name, x1: at.x(v), x2: at.x(v), y1: at.top, y2: at.top + at.height });
// through points, smooth between them without a value beyond theirs (Fritsch and Carlson): harmonic means of the slopes
function curve(at, name, xs, ys) {
  const known = (i) => i >= 0 && i < xs.length && ys[i] !== null && ys[i] !== undefined;
  const slope = (i) => (ys[i + 1] - ys[i]) / (xs[i + 1] - xs[i]);
  const turn = (i) => {
    if (!known(i - 1) || !known(i + 1)) return known(i + 1) ? slope(i) : known(i - 1) ? slope(i - 1) : 0;
    const before = slope(i - 1), after = slope(i), [h, k] = [xs[i] - xs[i - 1], xs[i + 1] - xs[i]];
    return before * after <= 0 ? 0 : 3 * (h + k) / ((2 * k + h) / before + (k + 2 * h) / after);
  };
  const place = (v, u) => `${at.x(v).toFixed(1)} ${at.y(u).toFixed(1)}`;
  let path = "";
  xs.forEach((v, i) => {
    if (!known(i)) return;
    if (!known(i - 1)) { path += `M${place(v, ys[i])}`; return; }
    const third = (v - xs[i - 1]) / 3;
    path += `C${place(xs[i - 1] + third, ys[i - 1] + third * turn(i - 1))} ${place(v - third, ys[i] - third * turn(i))} ${place(v, ys[i])}`;
  });
  if (path) put(at.inside, "path", { class: name, d: path });
}
// the path in units of pi over the pitch, so that designs of different pitch share the axis
function arc(labels) {
  const at = labels.flatMap((text, i) => text ? [i] : []), xs = [0];
  for (let s = 0; s + 1 < at.length; s++) {
    const [from, to] = [state.corners[labels[at[s]]], state.corners[labels[at[s + 1]]]];
    const step = Math.hypot(to[0] - from[0], to[1] - from[1]) / (at[s + 1] - at[s]);
    for (let i = at[s]; i < at[s + 1]; i++) xs.push(xs[i] + step);
  }
  return xs;
}
// the target shape along the zone, s from -1 to 1: that of a free beam with as many nodal lines
function along(s, lines) {
  if (lines < 2) return lines ? s : 1;
  const half = (lines - 0.5) * Math.PI / 2, [round, hyper] = lines % 2 ? [Math.sin, Math.sinh] : [Math.cos, Math.cosh];
  return (round(half * s) / round(half) + hyper(half * s) / hyper(half)) / 2;
}
const STOPS = 12; // of a gradient, for each nodal line
// from above, to scale: zone, pillars and, as shade, the target shape with the motion across the plate that was computed last
function drawPlate() {
  const svg = $("plate"), d = state.design, shown = state.shown && !state.shown.plate.why_not ? state.shown.plate : null;
  if (!state.plate || !state.zone) return;
  const pitch = d.pitch * state.plate.ratio, rows = d.rows ? (d.rows - 1) * pitch + d.side : 0, half = state.zone / 2 + rows + d.extension, length = state.plate.length_mm;
  svg.replaceChildren();
  const size = letters(svg), scale = Math.min(430 / length, 350 / (2 * half)), x = (v) => 20 + scale * (v + length / 2), y = (v) => 200 + scale * v;
  put(svg, "rect", { class: "plate", x: x(-length / 2), y: y(-half), width: scale * length, height: 2 * scale * half });
  if (shown) {
    const shade = put(svg, "linearGradient", { id: "along" }), count = STOPS * (state.plate.lines + 1);
    for (let i = 0; i <= count; i++) {
      const u = along(2 * i / count - 1, state.plate.lines);
      put(shade, "stop", { class: u < 0 ? "down" : "up", offset: i / count, "stop-opacity": Math.abs(u).toFixed(3) });
    }
    const at = [0, ...shown.profile.y_mm.slice(1)], level = shown.profile.level;
    const swing = put(svg, "g", { class: "swing" });
    for (let i = 0; i + 1 < at.length && at[i] < half; i++)
      for (const side of [-1, 1]) {
        const ends = [side * at[i], side * Math.min(at[i + 1], half)].sort((a, b) => a - b);
        put(swing, "rect", { class: "motion", fill: "url(#along)", "fill-opacity": (0.9 * (level[i] + level[i + 1]) / 2).toFixed(3), x: x(-length / 2), y: y(ends[0]), width: scale * length, height: scale * (ends[1] - ends[0]) });
      }
  }
  put(svg, "rect", { class: "edge", x: x(-length / 2), y: y(-state.zone / 2), width: scale * length, height: scale * state.zone });
  const columns = Math.floor((length - d.side) / d.pitch + 1e-9) + 1, square = scale * d.side;
  let feet = "";
  for (let row = 0; row < d.rows; row++) {
    const across = columns - (state.plate.stagger && row % 2 ? 1 : 0); // a shifted row stands between the others
    for (let n = 0; n < across; n++)
      for (const side of [-1, 1])
        feet += `M${(x((n - (across - 1) / 2) * d.pitch) - square / 2).toFixed(1)} ${(y(side * (state.zone / 2 + d.side / 2 + row * pitch)) - square / 2).toFixed(1)}h${square.toFixed(1)}v${square.toFixed(1)}h${(-square).toFixed(1)}z`;
  }
  if (feet) put(svg, "path", { class: "pillars", d: feet });
  const tall = 290 / Math.max(state.limits.height.high + state.limits.thickness.high, 1), foot = 320, width = tall * d.side, middle = 545;
  put(svg, "rect", { class: "plate", x: middle - 60, y: foot, width: 120, height: tall * d.thickness });
  put(svg, "rect", { class: "pillars", x: middle - width / 2, y: foot - tall * d.height, width, height: tall * d.height });
  put(svg, "text", { x: 612, y: 392, "text-anchor": "end", "font-size": size }, `${d.height} mm on ${d.thickness} mm`);
  put(svg, "text", { x: x(0), y: y(half) + 1.3 * size, "text-anchor": "middle", "font-size": size }, `${figure(length)} × ${figure(2 * half)} mm`);
}
const WINDOW = 1.8; // times the target frequency: where it counts
const LETTERS = { G: "Γ" };
// what moves in a wave: the pillar, where it moves farther than the plate; else the plate, across or in its plane; null at rest
function motionOf(found, point, band) {
  const share = found.bands.pillar[point][band], { times, flexural } = state.motion;
  if (share === null) return null;
  return share > times ** 2 * carried(found.design) * (1 - share) ? "pillar" : found.bands.flexural[point][band] > flexural ? "flexural" : "plane";
}
function carried(design) { // a pillar's mass over that of the plate of its cell
  const grown = (name) => design[name] / state.own[name];
  return state.motion.carried * grown("side") ** 2 * grown("height") / (grown("pitch") ** 2 * grown("thickness"));
}
// which wave of the next point goes on with a wave: the same one of its mirror sector, for those of one sector do not cross;
// where the path turns and has other sectors, the one of the same number; -1 beyond the last band
function following(bands, point, band) {
  const [here, there] = [bands.sector[point], bands.sector[point + 1]], number = (row, i) => row.slice(0, i).filter((each) => each === row[i]).length;
  if (!here.some((each) => there.includes(each))) return band;
  return there.findIndex((each, i) => each === here[band] && number(there, i) === number(here, band));
}
function branches(found, at, xs) { // a path for each kind of motion; a line that changes its kind does so halfway
  const bands = found.bands, paths = { plane: "", flexural: "", pillar: "" }, place = (x, y) => `${at.x(x).toFixed(1)} ${at.y(y).toFixed(1)}`;
  for (let i = 0; i + 1 < xs.length; i++)
    bands.frequency_hz[i].forEach((hz, band) => {
      const next = following(bands, i, band);
      if (next < 0) return;
      const [y0, y1] = [hz / 1000, bands.frequency_hz[i + 1][next] / 1000], first = motionOf(found, i, band), last = motionOf(found, i + 1, next);
      const from = place(xs[i], y0), half = place((xs[i] + xs[i + 1]) / 2, (y0 + y1) / 2), to = place(xs[i + 1], y1);
      if ((first || last) === (last || first)) paths[first || last || "flexural"] += `M${from}L${to}`;
      else { paths[first] += `M${from}L${half}`; paths[last] += `M${half}L${to}`; }
    });
  return paths;
}
// what part of the diagram is seen: null is the window that counts, or all bands
let view = null;
function limits(found, xs) {
  const top = Math.max(...found.bands.frequency_hz.flat()) / 1000, target = found.plate.why_not ? null : found.plate.frequency_hz / 1000;
  const high = $("whole").checked || target === null ? top : Math.min(top, WINDOW * target);
  return { own: { x: [0, xs[xs.length - 1]], y: [0, 1.03 * high] }, whole: { x: [0, xs[xs.length - 1]], y: [0, 1.03 * top] } };
}
const LEAST = 1e-3; // of the whole: the closest look
function look(factor, about, shift) { // about, shift: in parts of what is seen
  if (!state.shown) return false;
  const { own, whole } = limits(state.shown, arc(state.shown.bands.labels)), now = view || own;
  const along = (axis, i) => {
    const [low, high] = now[axis], [least, most] = whole[axis], size = Math.max(Math.min((high - low) * factor, most - least), LEAST * (most - least));
    const from = Math.min(Math.max(low + (high - low) * (about[i] + shift[i]) - about[i] * size, least), most - size);
    return [from, from + size];
  };
  const next = { x: along("x", 0), y: along("y", 1) }, isSame = (one, other) => ["x", "y"].every((axis) => one[axis].every((v, i) => Math.abs(v - other[axis][i]) < 1e-9 * whole[axis][1]));
  const moves = !isSame(now, next);
  view = isSame(next, own) ? null : next;
  if (moves) drawBands(state.shown, state.before);
  return moves;
}
const MIDDLE = [0.5, 0.5], STILL = [0, 0], CLOSER = 0.8, PACE = 0.1;
const KEYS = { "+": [CLOSER, STILL], "=": [CLOSER, STILL], "-": [1 / CLOSER, STILL], ArrowLeft: [1, [-PACE, 0]], ArrowRight: [1, [PACE, 0]], ArrowUp: [1, [0, PACE]], ArrowDown: [1, [0, -PACE]] };
function lookAround() { // wheel, pointer, keys and buttons of the band diagram
  const svg = $("bands"), again = () => { view = null; if (state.shown) drawBands(state.shown, state.before); };
  let held = null;
  const place = (event) => { const box = svg.getBoundingClientRect(), unit = box.width / WIDTH, { left, top, width, height } = state.frame; return [((event.clientX - box.left) / unit - left) / width, 1 - ((event.clientY - box.top) / unit - top) / height]; };
  svg.addEventListener("wheel", (event) => { if (state.frame && look(1.0015 ** event.deltaY, place(event), STILL)) event.preventDefault(); }, { passive: false });
  svg.addEventListener("pointerdown", (event) => { if (state.frame && (view || event.pointerType === "mouse")) { held = place(event); svg.setPointerCapture(event.pointerId); } });
  svg.addEventListener("pointermove", (event) => { if (held) { const now = place(event); look(1, MIDDLE, [held[0] - now[0], held[1] - now[1]]); held = now; } });
  for (const name of ["pointerup", "pointercancel"]) svg.addEventListener(name, () => { held = null; });
  svg.addEventListener("dblclick", again);
  svg.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "0") again(); else if (KEYS[event.key]) look(KEYS[event.key][0], MIDDLE, KEYS[event.key][1]); else return;
    event.preventDefault();
  });
  $("closer").addEventListener("click", () => look(CLOSER, MIDDLE, STILL));
  $("farther").addEventListener("click", () => look(1 / CLOSER, MIDDLE, STILL));
  $("again").addEventListener("click", again);
  $("whole").addEventListener("change", again);
}
function drawBands(found, before) {
  const bands = found.bands, xs = arc(bands.labels), svg = $("bands"), { x, y } = view || limits(found, xs).own;
  $("path").textContent = bands.labels.filter(Boolean).map((text) => LETTERS[text] || text).join("–");
  const at = state.frame = frame(svg, x, y, "wavevector", "frequency (kHz)", bands.labels.map((text, i) => [xs[i], LETTERS[text] || text]).filter(([, text]) => text));
  for (const gap of bands.gaps) shaded(at, "gap", x, [gap.lower_hz / 1000, gap.upper_hz / 1000]);
  if (before) put(at.inside, "path", { class: "before", d: Object.values(branches(before, at, xs)).join("") });
  for (const [motion, d] of Object.entries(branches(found, at, xs))) put(at.inside, "path", { class: `line ${motion}`, d });
  if (!found.plate.why_not) across(at, "target", found.plate.frequency_hz / 1000);
  svg.classList.toggle("near", view !== null);
  svg.setAttribute("aria-label", `Dispersion diagram, bands from ${interval(1000 * y[0], 1000 * y[1])}, ${bands.gaps.length} complete gaps. Plus and minus zoom, arrow keys move, 0 goes back`);
}
const kHz = (hz) => hz.map((v) => v / 1000);
function drawDecay(found, before) {
  const rows = found.rows, svg = $("decay");
  if (!rows.frequency_hz.length) { svg.replaceChildren(); put(svg, "text", { x: 20, y: 40, "font-size": letters(svg) }, "the target wavenumber lies beyond the zone's edge"); return; }
  const hz = kHz(rows.frequency_hz), high = Math.max(1, ...rows.db_per_row.filter((v) => v !== null)) * 1.08;
  const at = frame(svg, [hz[0], hz[hz.length - 1]], [0, high], "frequency (kHz)", "decay per row (dB)");
  across(at, "least", CONFINED_DB / found.design.rows);
  if (before) curve(at, "before", kHz(before.rows.frequency_hz), before.rows.db_per_row);
  curve(at, "line", hz, rows.db_per_row);
  if (!found.plate.why_not) upright(at, "target", found.plate.frequency_hz / 1000);
}
function drawProfile(found, before) {
  const plate = found.plate, svg = $("profile");
  if (plate.why_not) { svg.replaceChildren(); put(svg, "text", { x: 20, y: 40, "font-size": letters(svg) }, plate.why_not); return; }
  const at = frame(svg, [0, plate.half_span_mm], [0, 1.05], "distance from the zone's middle (mm)", "|u|, largest 1");
  shaded(at, "zone", [0, plate.half_width_mm], [0, 1.05]);
  if (before && !before.plate.why_not) curve(at, "before", before.plate.profile.y_mm, before.plate.profile.level);
  curve(at, "line", plate.profile.y_mm, plate.profile.level);
}

// many designs, gathered a batch at a time between the answers to drags: two questions at once, one for each process
const cloud = { points: [], next: 0, again: [], count: 0, running: false };
async function gather() {
  cloud.running = !cloud.running;
  if (!cloud.running) return;
  $("gather").textContent = "Stop";
  let fault = null, ended = false;
  const lane = async () => {
    while (cloud.running && !ended) {
      const first = cloud.again.pop() ?? (cloud.next += cloud.batch) - cloud.batch;
      let more;
      try { more = await answer("cloud", { first }); } catch (why) { fault = why; cloud.again.push(first); cloud.running = false; return; }
      cloud.count += more.length;
      cloud.points.push(...more.filter((point) => point.frequency_hz !== null && point.confinement_db !== null));
      drawCloud();
      ended ||= !more.length;
    }
  };
  await Promise.all([lane(), lane()]);
  cloud.running = false;
  if (fault) $("gathered").textContent = fault.message;
  $("gather").disabled = ended;
  $("gather").textContent = ended ? "Done" : "Go on";
}
function front(points) { // those that no other beats in all three
  const worth = (p) => [p.confinement_db, p.frequency_hz, -p.mass_g], kept = [];
  for (const p of [...points].sort((a, b) => b.confinement_db - a.confinement_db))
    if (!kept.some((q) => worth(q).every((v, i) => v >= worth(p)[i]))) kept.push(p);
  return new Set(kept);
}
function isAsked(point) { // by the fields after the button; an empty one is open
  const [low, high, least] = ["lowest", "highest", "confined"].map((id) => $(id).value === "" ? null : Number($(id).value));
  return (low === null || point.frequency_hz >= 1000 * low) && (high === null || point.frequency_hz <= 1000 * high) && (least === null || point.confinement_db >= least);
}
function drawCloud() {
  if (!cloud.count) return;
  const points = cloud.points.filter(isAsked), lacking = cloud.count - cloud.points.length;
  $("gathered").textContent = `${points.length} of ${cloud.count} designs shown${lacking ? `; ${lacking} have no target mode` : ""}`;
  const best = front(points), levels = points.map((p) => p.confinement_db);
  for (const id of ["by-frequency", "by-mass"]) $(id).replaceChildren();
  $("cloud").hidden = !points.length;
  if (!points.length) return;
  for (const [id, text, value] of [["by-frequency", "frequency (kHz)", (p) => p.frequency_hz / 1000], ["by-mass", "mass (g)", (p) => p.mass_g]]) {
    const svg = $(id), own = points.map(value), room = 0.03 * Math.max(...own), low = Math.min(...own) - room, far = Math.max(...own) + room;
    const at = frame(svg, [low, far], [Math.min(0, ...levels), 1.05 * Math.max(CONFINED_DB, ...levels)], text, "confinement (dB)");
    across(at, "least", CONFINED_DB);
    for (const p of [...points].sort((a, b) => best.has(a) - best.has(b))) {
      const label = `${level(p.confinement_db, p.confinement_error_db)}, ${frequency(p.frequency_hz, p.frequency_error)}, ${figure(p.mass_g)} g`;
      const dot = put(svg, "circle", { class: best.has(p) ? "dot front" : "dot", cx: at.x(value(p)).toFixed(1), cy: at.y(p.confinement_db).toFixed(1), r: best.has(p) ? 4.5 : 3 });
      if (best.has(p)) { dot.setAttribute("tabindex", "0"); dot.setAttribute("role", "button"); dot.setAttribute("aria-label", `Take the design with ${label}`); }
      put(dot, "title", {}, label);
      dot.addEventListener("click", () => take(p.design));
      dot.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); take(p.design); } });
    }
  }
}

function drawPins() {
  $("pinned").hidden = !state.pins.length;
  const heads = ["Design", ...Object.values(state.limits).map((limit) => limit.word), "Target", "Confinement", "Decay band"];
  const row = (tag, texts) => {
    const tr = document.createElement("tr");
    tr.append(...texts.map((text) => text instanceof Node ? text : Object.assign(document.createElement(tag), { textContent: text })));
    return tr;
  };
  $("pins").tHead.replaceChildren(row("th", heads));
  $("pins").tBodies[0].replaceChildren(...state.pins.map((pin, number) => {
    const cell = document.createElement("td");
    for (const [text, act] of [["Take", () => take(pin.design)], ["Unpin", () => { state.pins.splice(number, 1); drawPins(); }]]) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: text });
      button.addEventListener("click", act);
      cell.append(button);
    }
    const plate = pin.plate;
    return row("td", [cell, ...Object.keys(state.limits).map((name) => String(pin.design[name])),
      plate.why_not ? "none" : frequency(plate.frequency_hz, plate.frequency_error), plate.why_not || plate.confinement_db === null ? "none" : level(plate.confinement_db, plate.confinement_error_db),
      decayBand(pin)[0]]);
  }));
  $("pin").disabled = state.pins.length >= MAX_PINS;
  $("pin").textContent = state.pins.length >= MAX_PINS ? `${MAX_PINS} designs pinned: unpin one below` : "Pin this design";
}
function take(design) {
  remember();
  state.design = { ...design };
  show(state.design);
  refresh();
}

async function computeFull() {
  const asked = state.shown;
  if (state.solving) { try { await answer("full/stop", {}); } catch (fault) { $("progress").textContent = fault.message; } return; }
  if (!asked) return;
  $("real").hidden = false;
  state.solving = true;
  $("full").textContent = "Stop";
  $("log").replaceChildren();
  try {
    await answer("full", { ...asked.design });
    for (;;) {
      const told = await answer("full");
      $("log").replaceChildren(...told.lines.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
      if (!told.running) { $("progress").textContent = compared(asked.plate, told.result); break; }
      $("progress").textContent = "solving the assembled plate ...";
      await new Promise((done) => setTimeout(done, 500));
    }
  } catch (fault) {
    $("progress").textContent = fault.message;
  }
  state.solving = false;
  $("full").textContent = "Compute for real";
}
function compared(live, real) {
  if (real.why_not) return `Full plate: ${real.why_not}.`;
  const bar = real.frequency_error === null ? "" : ` ${frequencyBar(real.frequency_hz, real.frequency_error)}`;
  const own = real.confinement_error_db, spread = isKnown(own) ? ` ${ofBar(own, "dB")}` : "";
  const confined = real.confinement_db === null ? "" : `, ${level(real.confinement_db, own)}${spread}`;
  const split = real.status === "split" ? ", split among several modes" : "";
  const text = `Full plate: ${frequency(real.frequency_hz, real.frequency_error)}${bar}${confined}${split}.`;
  if (live.why_not) return text;
  const off = 100 * (live.frequency_hz / real.frequency_hz - 1);
  const named = live.others.find((one) => Math.abs(one.frequency_hz / real.frequency_hz - 1) <= one.frequency_error + (real.frequency_error || 0));
  if ((split || live.status === "split") && Math.abs(off) > 100 * (live.frequency_error + (real.frequency_error || 0)) && named)
    return `${text} It is the mode that the live answer names at ${frequency(named.frequency_hz, named.frequency_error)}.`;
  if ((split || live.status === "split") && Math.abs(off) > 100 * (live.frequency_error + (real.frequency_error || 0)))
    return `${text} The live answer names another of the modes that share the target shape, at ${frequency(live.frequency_hz, live.frequency_error)}.`;
  const levels = real.confinement_db === null || live.confinement_db === null ? "" : `, ${level(live.confinement_db - real.confinement_db, own)}`;
  return `${text} The live answer was off by ${figure(off, isKnown(real.frequency_error) ? 100 * real.frequency_error : null)} %${levels}.`;
}

async function save() {
  try {
    const text = await ask("case", state.design);
    const link = Object.assign(document.createElement("a"), { download: "explored.toml", href: URL.createObjectURL(new Blob([text], { type: "application/toml" })) });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    say("the case of this design is in your downloads as explored.toml", false);
  } catch (fault) { say(fault.message, true); }
}

async function start() {
  try {
    if ($("model")) {
      $("full").hidden = true;
      $("alone").hidden = false;
      await startWorker();
    }
    const scene = await answer("scene");
    $("name").textContent = scene.name;
    state.limits = scene.limits;
    state.corners = scene.corners;
    state.plate = scene.plate;
    state.motion = scene.motion;
    state.own = scene.design;
    $("times").textContent = scene.motion.times;
    $("patched").hidden = scene.plate.patches;
    $("felt").textContent = `${figure(100 * scene.motion.flexural, 0)} %`;
    state.zone = scene.plate.zone_mm;
    cloud.batch = scene.batch;
    state.design = fromAddress(scene.design);
  } catch (fault) { say(fault.message, true); return; }
  buildForm();
  show(state.design);
  drawPins();
  $("undo").addEventListener("click", () => step(state.undo, state.redo));
  $("redo").addEventListener("click", () => step(state.redo, state.undo));
  lookAround();
  new ResizeObserver(() => { drawPlate(); if (state.shown) draw(); drawCloud(); }).observe($("bands"));
  $("pin").addEventListener("click", () => { if (state.shown && state.pins.length < MAX_PINS) { state.pins.push(state.shown); drawPins(); } });
  $("save").addEventListener("click", save);
  $("moves").checked = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  const still = () => $("plate").classList.toggle("still", !$("moves").checked);
  $("moves").addEventListener("change", still);
  still();
  $("gather").addEventListener("click", gather);
  $("confined").value = 0;
  for (const id of ["lowest", "highest", "confined"]) $(id).addEventListener("input", drawCloud);
  $("full").addEventListener("click", computeFull);
  $("copy").addEventListener("click", async () => {
    try { await navigator.clipboard.writeText(location.href); say("the address is copied; it holds the design", false); } catch { say("copy it from the address bar: it holds the design", false); }
  });
  window.addEventListener("hashchange", () => take(fromAddress(scene_own(state))));
  await refresh();
}
const scene_own = (known) => known.design;
start();
