"use strict";
// Dispersion diagram: drawn from the stored bands, with values at the pointer and arrow keys, zoom, and wave shapes.
(() => {
  const host = document.querySelector("#dispersion-diagram");
  const source = document.querySelector("#bands-data");
  if (!host || !source) return;
  const { cells } = JSON.parse(source.textContent);
  const KINDS = ["flexural", "shear", "longitudinal"];
  const NAMES = { G: "Γ" };
  const [LEFT, RIGHT, TOP, BOTTOM] = [58, 12, 10, 44];
  const REACH = 26; // px: largest distance from the pointer at which a wave is picked
  const DEEPEST = 400; // largest magnification
  const svg = host.querySelector("svg");
  const tip = host.querySelector(".tip");
  const legend = document.querySelector("#dispersion-legend");
  const picker = document.querySelector("#dispersion-cell");
  const note = document.querySelector("#dispersion-note");
  let cell, view, whole, frame, cursor = null, chosen = null, drawing = 0;

  const element = (parent, name, attributes = {}, text = "") => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text) made.textContent = text;
    parent.append(made);
    return made;
  };
  const label = (name) => NAMES[name] ?? name;
  const px = (s) => LEFT + ((s - view.x[0]) / (view.x[1] - view.x[0])) * (frame.width - LEFT - RIGHT);
  const py = (hz) => frame.height - BOTTOM - ((hz - view.y[0]) / (view.y[1] - view.y[0])) * (frame.height - TOP - BOTTOM);
  const band_count = () => Math.min(...cell.hz.map((row) => row.length));

  function choose(index) {
    cell = cells[index];
    const top = 1.04 * Math.max(...cell.hz.flat());
    const end = cell.arc.at(-1) || 1;
    whole = { x: [-0.02 * end, 1.02 * end], y: [0, top] };
    cursor = chosen = null;
    tip.hidden = true;
    document.querySelector("#dispersion-gap").hidden = !cell.gaps.length;
    document.querySelector("#dispersion-target").hidden = !cell.target_hz;
    zoom_to(cell.target_hz ? about_target() : whole);
    draw(); // at once, so that early pointer or keyboard input finds the diagram
    write_legend();
  }

  // --- drawing -----------------------------------------------------------------------------------------------------
  function draw() {
    drawing = 0;
    const width = Math.max(300, Math.round(host.clientWidth));
    frame = { width, height: Math.round(Math.min(560, Math.max(330, 0.62 * width))) };
    svg.setAttribute("viewBox", `0 0 ${frame.width} ${frame.height}`);
    svg.setAttribute("width", frame.width);
    svg.setAttribute("height", frame.height);
    svg.replaceChildren();
    const clip = element(element(element(svg, "defs"), "clipPath", { id: "plot-area" }), "rect", plot_area());
    clip.removeAttribute("class");
    const plot = element(svg, "g", { "clip-path": "url(#plot-area)" });
    draw_gaps(plot);
    draw_axes(plot);
    draw_bands(plot);
    if (cell.target_hz) draw_target(plot);
    for (const [wave, name] of [[chosen, "chosen"], [cursor, "cursor"]]) {
      if (wave) element(plot, "circle", { class: name, cx: px(cell.arc[wave.point]), cy: py(cell.hz[wave.point][wave.band]), r: 8 });
    }
    svg.dataset.waves = plot.querySelectorAll(".wave").length;
    svg.dataset.zoom = ((whole.y[1] - whole.y[0]) / (view.y[1] - view.y[0])).toFixed(2);
  }
  const plot_area = () => ({ x: LEFT, y: TOP, width: frame.width - LEFT - RIGHT, height: frame.height - TOP - BOTTOM });
  const later = () => { drawing ||= requestAnimationFrame(draw); };

  function draw_gaps(plot) {
    for (const gap of cell.gaps) {
      const [top, bottom] = [py(gap.upper_hz), py(gap.lower_hz)];
      element(plot, "rect", { class: "gap", x: LEFT, width: frame.width - LEFT - RIGHT, y: top, height: Math.max(0, bottom - top) });
      if (bottom < TOP || top > frame.height - BOTTOM) continue;
      const words = `complete gap ${gap.shown}`;
      const middle = (Math.max(top, TOP) + Math.min(bottom, frame.height - BOTTOM)) / 2;
      element(plot, "text", { class: "gap-label", x: (LEFT + frame.width - RIGHT) / 2, y: middle + 4, "text-anchor": "middle" }, words);
    }
  }

  function ticks([low, high], count) {
    const raw = (high - low) / count, decade = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].find((factor) => factor * decade >= raw) * decade;
    const found = [];
    for (let at = Math.ceil(low / step); at * step <= high; at++) found.push(at * step);
    return { found, digits: Math.max(0, 3 - Math.floor(Math.log10(step) + 1e-9)) };
  }

  function draw_axes(plot) {
    const bottom = frame.height - BOTTOM;
    element(svg, "rect", { class: "frame", ...plot_area() });
    const { found, digits } = ticks(view.y, 6);
    for (const hz of found) {
      element(svg, "line", { class: "axis", x1: LEFT - 5, x2: LEFT, y1: py(hz), y2: py(hz) });
      element(svg, "text", { x: LEFT - 8, y: py(hz) + 4, "text-anchor": "end" }, (hz / 1e3).toFixed(Math.max(0, digits)));
    }
    cell.labels.forEach((name, point) => {
      const at = px(cell.arc[point]);
      if (!name || at < LEFT - 1 || at > frame.width - RIGHT + 1) return;
      element(plot, "line", { class: "grid", x1: at, x2: at, y1: TOP, y2: bottom });
      element(svg, "text", { x: at, y: bottom + 17, "text-anchor": "middle" }, label(name));
    });
    const middle = (TOP + bottom) / 2;
    element(svg, "text", { x: 14, y: middle, "text-anchor": "middle", transform: `rotate(-90 14 ${middle})` }, "frequency (kHz)");
    const words = "wavevector along the path (to scale, rad/m)";
    element(svg, "text", { x: (LEFT + frame.width - RIGHT) / 2, y: frame.height - 8, "text-anchor": "middle" }, words);
  }

  function draw_bands(plot) {
    for (let band = 0; band < band_count(); band++) {
      const line = cell.arc.map((s, point) => `${px(s).toFixed(1)},${py(cell.hz[point][band]).toFixed(1)}`).join(" ");
      element(plot, "polyline", { class: "band", points: line });
    }
    const near = (s) => s >= view.x[0] - 1e-9 * whole.x[1] && s <= view.x[1] + 1e-9 * whole.x[1];
    cell.arc.forEach((s, point) => {
      if (!near(s)) return;
      cell.hz[point].forEach((hz, band) => {
        if (hz >= view.y[0] && hz <= view.y[1]) mark(plot, px(s), py(hz), cell.kind?.[point][band] ?? -1, cell.pillar?.[point][band]);
      });
    });
  }

  function mark(parent, x, y, kind, hollow) {
    const name = `wave ${KINDS[kind] ?? "unknown"}${hollow ? " hollow" : ""}`;
    if (kind === 1) return element(parent, "rect", { class: name, x: x - 2.7, y: y - 2.7, width: 5.4, height: 5.4 });
    if (kind === 2) return element(parent, "path", { class: name, d: `M${x} ${y - 3.8}l3.7 6.4h-7.4z` });
    return element(parent, "circle", { class: name, cx: x, cy: y, r: kind < 0 ? 2 : 2.8 });
  }

  function draw_target(plot) {
    const y = py(cell.target_hz);
    element(plot, "line", { class: "target-line", x1: LEFT, x2: frame.width - RIGHT, y1: y, y2: y });
  }

  function write_legend() {
    const rows = [];
    const there = (kind, hollow) => cell.kind?.some((row, point) => row.some((k, band) => k === kind && Boolean(cell.pillar?.[point][band]) === hollow));
    KINDS.forEach((name, kind) => {
      if (there(kind, false)) rows.push([name, kind, false]);
      if (there(kind, true)) rows.push([`${name}, mostly in the pillar`, kind, true]);
    });
    legend.replaceChildren();
    for (const [name, kind, hollow] of rows) {
      const item = document.createElement("li");
      mark(element(item, "svg", { width: 14, height: 14, "aria-hidden": "true" }), 7, 7, kind, hollow);
      item.append(` ${name}`);
      legend.append(item);
    }
    if (!cell.kind) legend.append(Object.assign(document.createElement("li"), { textContent: "polarisation: not stored in this record" }));
    if (cell.target_hz) {
      const item = document.createElement("li");
      const line = element(item, "svg", { width: 22, height: 14, "aria-hidden": "true" });
      element(line, "line", { class: "target-line", x1: 0, x2: 22, y1: 7, y2: 7 });
      item.append(` target mode of the plate, ${cell.target_shown}`);
      legend.append(item);
    }
  }

  // --- values of a wave---------------------------------------------------------------------------------------------
  function where(point) {
    if (cell.labels[point]) return label(cell.labels[point]);
    const before = cell.labels.slice(0, point).reverse().find(Boolean), after = cell.labels.slice(point).find(Boolean);
    return `between ${label(before)} and ${label(after)}`;
  }
  function words({ point, band }) {
    const [kx, ky] = cell.k[point];
    const kind = KINDS[cell.kind?.[point][band]] ?? "polarisation not stored";
    const speed = cell.speed?.[point][band];
    return [
      `band ${band + 1}`,
      cell.shown[point][band],
      `${where(point)}, k = (${kx.toFixed(1)}, ${ky.toFixed(1)}) rad/m`,
      kind + (cell.pillar?.[point][band] ? ", mostly in the pillar" : ""),
      ...(speed == null ? [] : [`group velocity ${speed} m/s`]),
    ];
  }
  function tell(wave) {
    cursor = wave;
    tip.hidden = !wave;
    if (wave) {
      tip.replaceChildren(...words(wave).map((line, index) => Object.assign(document.createElement(index ? "div" : "strong"), { textContent: line })));
      const [x, y] = [px(cell.arc[wave.point]), py(cell.hz[wave.point][wave.band])];
      const right = x > frame.width / 2;
      tip.style.left = right ? "auto" : `${x + 14}px`;
      tip.style.right = right ? `${frame.width - x + 14}px` : "auto";
      tip.style.top = `${Math.max(0, Math.min(y - 30, frame.height - 110))}px`;
    }
    later();
  }
  function nearest(event) {
    const [x, y] = at(event);
    let best = null, least = REACH;
    cell.arc.forEach((s, point) => cell.hz[point].forEach((hz, band) => {
      const distance = Math.hypot(px(s) - x, py(hz) - y);
      if (distance < least) [least, best] = [distance, { point, band }];
    }));
    return best;
  }
  function at(event) {
    const box = svg.getBoundingClientRect();
    return [((event.clientX - box.left) * frame.width) / box.width, ((event.clientY - box.top) * frame.height) / box.height];
  }

  // --- shapes ------------------------------------------------------------------------------------------------------
  function select(wave) {
    if (!wave) return;
    chosen = wave;
    later();
    if (!cell.shapes) {
      note.textContent = "No wave shapes are stored for this cell; antinode run stores them.";
      return;
    }
    const stored = cell.labels.map((name, point) => ({ name, point })).filter(({ name }) => cell.shapes[name]?.[wave.band] !== undefined);
    if (!stored.length) {
      note.textContent = `Only the lowest bands have stored shapes; band ${wave.band + 1} has none.`;
      return;
    }
    const far = ({ point }) => Math.abs(cell.arc[point] - cell.arc[wave.point]);
    const { name, point } = stored.reduce((best, other) => (far(other) < far(best) ? other : best));
    chosen = { point, band: wave.band };
    const moved = point === wave.point ? "" : ", the nearest wavevector with a stored shape";
    note.textContent = `Shown: band ${wave.band + 1} at ${label(name)}, ${cell.shown[point][wave.band]}${moved}.`;
    dispatchEvent(new CustomEvent("antinode:wave", { detail: cell.shapes[name][wave.band] }));
  }

  // --- zoom --------------------------------------------------------------------------------------------------------
  function zoom_to(next) {
    const held = ([low, high], [first, last]) => {
      const span = Math.min(high - low, last - first);
      const start = Math.min(Math.max(low, first), last - span);
      return [start, start + span];
    };
    view = { x: held(next.x, whole.x), y: held(next.y, whole.y) };
    tip.hidden = true;
    later();
  }
  function zoom(factor, centre, axes = "xy") {
    const deep = (whole.y[1] - whole.y[0]) / (view.y[1] - view.y[0]);
    const by = Math.min(factor, DEEPEST / deep);
    const about = centre ?? [(view.x[0] + view.x[1]) / 2, (view.y[0] + view.y[1]) / 2];
    const part = (range, middle) => range.map((end) => middle + (end - middle) / by);
    zoom_to({ x: axes.includes("x") ? part(view.x, about[0]) : view.x, y: part(view.y, about[1]) });
  }
  const is_whole = () => view.y[1] - view.y[0] > 0.999 * (whole.y[1] - whole.y[0]);
  const value_at = ([x, y]) => [
    view.x[0] + ((x - LEFT) / (frame.width - LEFT - RIGHT)) * (view.x[1] - view.x[0]),
    view.y[0] + ((frame.height - BOTTOM - y) / (frame.height - TOP - BOTTOM)) * (view.y[1] - view.y[0]),
  ];
  function to_gap() {
    const widest = cell.gaps.reduce((best, gap) => (gap.upper_hz - gap.lower_hz > best.upper_hz - best.lower_hz ? gap : best));
    const room = 0.6 * (widest.upper_hz - widest.lower_hz);
    zoom_to({ x: whole.x, y: [widest.lower_hz - room, widest.upper_hz + room] });
  }
  const about_target = () => ({ x: whole.x, y: [0, 2 * cell.target_hz] });
  const to_target = () => zoom_to(about_target());
  const on_cursor = () => cursor && [cell.arc[cursor.point], cell.hz[cursor.point][cursor.band]];

  // --- interaction -------------------------------------------------------------------------------------------------
  let grip = null;
  svg.addEventListener("pointermove", (event) => {
    if (!grip) return tell(nearest(event));
    const [x, y] = at(event);
    const [dx, dy] = [x - grip.at[0], y - grip.at[1]];
    grip.moved ||= Math.hypot(dx, dy) > 5;
    if (!grip.moved) return;
    const sx = (dx * (grip.view.x[1] - grip.view.x[0])) / (frame.width - LEFT - RIGHT);
    const sy = (dy * (grip.view.y[1] - grip.view.y[0])) / (frame.height - TOP - BOTTOM);
    zoom_to({ x: grip.view.x.map((end) => end - sx), y: grip.view.y.map((end) => end + sy) });
  });
  svg.addEventListener("pointerdown", (event) => { grip = { at: at(event), view, moved: false }; });
  addEventListener("pointerup", (event) => {
    if (grip && !grip.moved && svg.contains(event.target)) select(nearest(event));
    grip = null;
  });
  addEventListener("pointercancel", () => { grip = null; });
  svg.addEventListener("pointerleave", () => { if (document.activeElement !== svg) tell(null); });
  svg.addEventListener("wheel", (event) => {
    if (event.deltaY > 0 && is_whole()) return; // already zoomed out: let the page scroll
    event.preventDefault();
    const turned = event.deltaY || event.deltaX; // with Shift some browsers report horizontal scrolling
    zoom(turned < 0 ? 1.25 : 0.8, value_at(at(event)), event.shiftKey ? "y" : "xy");
  }, { passive: false });

  function step(points, bands) {
    const start = cursor ?? { point: 0, band: 0 };
    const inside = (value, count) => Math.min(Math.max(value, 0), count - 1);
    const next = cursor ? { point: inside(start.point + points, cell.arc.length), band: inside(start.band + bands, band_count()) } : start;
    const [s, hz] = [cell.arc[next.point], cell.hz[next.point][next.band]];
    const outside = (value, [low, high]) => value < low || value > high;
    if (outside(s, view.x) || outside(hz, view.y)) { // follow the cursor
      const about = (range, value) => range.map((end) => end - (range[0] + range[1]) / 2 + value);
      zoom_to({ x: about(view.x, s), y: about(view.y, hz) });
    }
    tell(next);
  }
  const KEYS = {
    ArrowRight: () => step(1, 0), ArrowLeft: () => step(-1, 0), ArrowUp: () => step(0, 1), ArrowDown: () => step(0, -1),
    Home: () => step(-cell.arc.length, 0), End: () => step(cell.arc.length, 0),
    Enter: () => select(cursor), " ": () => select(cursor), Escape: () => tell(null),
    "+": () => zoom(1.5, on_cursor()), "=": () => zoom(1.5, on_cursor()), "-": () => zoom(1 / 1.5, on_cursor()), 0: () => zoom_to(whole),
  };
  svg.addEventListener("keydown", (event) => {
    const act = !event.ctrlKey && !event.metaKey && !event.altKey && KEYS[event.key];
    if (act) { event.preventDefault(); act(); }
  });
  const buttons = { in: () => zoom(1.5), out: () => zoom(1 / 1.5), all: () => zoom_to(whole), gap: to_gap, target: to_target };
  for (const [name, act] of Object.entries(buttons)) document.querySelector(`#dispersion-${name}`).addEventListener("click", act);
  picker?.addEventListener("change", () => choose(picker.selectedIndex));
  new ResizeObserver(later).observe(host);
  frame = { width: 600, height: 400 };
  choose(0);
})();
