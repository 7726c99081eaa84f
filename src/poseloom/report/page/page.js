"use strict";
// The page around the figure: what is shown at which moment, the controls, the plots and the tables.

const DATA = JSON.parse(document.getElementById("report-data").textContent);
const $ = (id) => document.getElementById(id);
const FIGURES = DATA.sequences.filter((sequence) => sequence.truth);
const HEAT = [[0, [0.82, 0.85, 0.9]], [0.3, [0.97, 0.8, 0.42]], [0.65, [0.88, 0.36, 0.2]], [1, [0.42, 0.04, 0.24]]];
const HEAT_TOP = 25; // degrees
const state = {
  sequence: 0, frame: 0, playing: false, speed: 1, overlay: false, heat: false, measure: DATA.measures[0].key, whole: false,
  hidden: new Set(), // -1 is the truth, else a method's index
};
let scene = null;

function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  Object.entries(attributes).forEach(([name, value]) => {
    if (name === "style") Object.assign(node.style, value);
    else if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else node.setAttribute(name, value);
  });
  node.append(...children);
  return node;
}

/** Digits after the point that show about three figures. */
const decimals = (value) => Math.min(4, Math.max(0, 2 - Math.floor(Math.log10(Math.max(Math.abs(value), 1e-4)))));

function number(value, digits = null) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (Math.abs(value) >= 1000) return Math.round(value).toLocaleString("en").replaceAll(",", "\u202f");
  return value.toFixed(value === 0 ? 0 : digits === null ? decimals(value) : digits);
}

const with_unit = (value, unit) => `${number(value)}${unit === "°" ? "" : "\u00a0"}${unit}`;
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
const measure = () => DATA.measures.find((entry) => entry.key === state.measure);
const mean = (values) => {
  let sum = 0, count = 0;
  values.forEach((value) => { if (Number.isFinite(value)) { sum += value; count += 1; } });
  return count ? sum / count : NaN;
};

function heat_colour(degrees) {
  const t = Math.min(1, degrees / HEAT_TOP);
  const i = Math.min(HEAT.length - 2, HEAT.findIndex(([stop], k) => k + 1 === HEAT.length || t <= HEAT[k + 1][0]));
  const [a, first] = HEAT[i], [b, second] = HEAT[i + 1];
  return first.map((value, k) => value + ((second[k] - value) * (t - a)) / (b - a));
}

// --- the figure -----------------------------------------------------------------------------------------------------

class Stage {
  constructor() {
    this.painter = make_painter($("figure"));
    this.canvas = $("figure");
    this.camera = new Camera();
    this.dirty = true;
    this.pointers = new Map();
    new ResizeObserver(() => this.resize()).observe($("stage"));
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); this.pointers.set(event.pointerId, event); });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    ["pointerup", "pointercancel"].forEach((name) => canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId)));
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.camera.zoom(Math.exp(0.001 * event.deltaY)); this.dirty = true; }, { passive: false });
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    if (this.pointers.size === 1) {
      this.camera.turn(0.008 * (event.clientX - before.clientX), 0.006 * (event.clientY - before.clientY));
    } else {
      const other = [...this.pointers.entries()].find(([id]) => id !== event.pointerId)[1];
      const gap = (a) => Math.hypot(a.clientX - other.clientX, a.clientY - other.clientY);
      this.camera.zoom(gap(before) / Math.max(1, gap(event)));
    }
    this.pointers.set(event.pointerId, event);
    this.dirty = true;
  }

  resize() {
    const ratio = Math.min(2, window.devicePixelRatio || 1), box = $("stage").getBoundingClientRect();
    this.canvas.width = Math.max(1, Math.round(box.width * ratio));
    this.canvas.height = Math.max(1, Math.round(box.height * ratio));
    this.dirty = true;
    this.labels();
  }

  /** The camera before the truth's face, a little to its side. */
  face(track) {
    const q = track.quats, at = JOINT_FLOATS * track.joints * Math.floor(track.frames / 2);
    Object.assign(this.camera, new Camera());
    this.camera.yaw = 2 * Math.atan2(q[at + 2], q[at]) + 0.62;
    this.dirty = true;
  }

  /** Who stands in which panel, and the panels' boxes as fractions of the stage. */
  panels() {
    const shown = scene.actors.filter((actor) => !state.hidden.has(actor.method));
    const groups = state.overlay ? [shown] : shown.map((actor) => [actor]);
    const count = Math.max(1, groups.length), box = $("stage").getBoundingClientRect();
    const columns = Math.min(count, Math.max(2, Math.floor(box.width / 190)));
    const rows = Math.ceil(count / columns);
    return groups.map((actors, i) => {
      const row = Math.floor(i / columns), inRow = Math.min(columns, count - row * columns);
      return { actors, left: (i % columns) / inRow, top: row / rows, width: 1 / inRow, height: 1 / rows };
    });
  }

  labels() {
    if (!scene) return;
    $("labels").replaceChildren(...this.panels().map((panel) => element("div", {
      class: "label", style: { left: `${100 * panel.left}%`, top: `${100 * panel.top}%` },
    }, ...panel.actors.map((actor) => element("span", {}, element("i", { style: { background: actor.colour } }), actor.name)))));
    $("dividers").replaceChildren(...this.panels().filter((panel) => panel.left > 0).map((panel) => element("div", {
      style: { left: `${100 * panel.left}%`, top: `${100 * panel.top}%`, height: `${100 * panel.height}%` },
    })));
  }

  draw() {
    this.dirty = false;
    const truth = scene.actors[0], truthPose = truth.track.pose(state.frame);
    const centre = truth.track.middle(state.frame, 0.5 * scene.rate);
    const target = [centre[0], 0.86 * centre[1] + 0.02, centre[2]];
    const { width, height } = this.canvas;
    this.panels().forEach((panel) => {
      const box = [
        Math.round(panel.left * width), Math.round((1 - panel.top - panel.height) * height),
        Math.round((panel.left + panel.width) * width) - Math.round(panel.left * width), Math.round(panel.height * height),
      ];
      const bodies = panel.actors.filter((actor) => actor.track.present[Math.round(state.frame)]).map((actor) => {
        const pose = actor === truth ? truthPose : actor.track.pose(state.frame);
        const single = rgb(actor.colour);
        const colours = state.heat && actor !== truth
          ? Array.from(bone_angles(truthPose, pose, actor.track.joints), heat_colour) : single;
        return { limbs: place_limbs(actor.track, pose, colours), alpha: state.overlay && actor !== truth ? 0.62 : 1 };
      });
      this.painter.paint(box, this.camera.look(target, box[2] / box[3]), target, bodies);
    });
  }
}

// --- time -----------------------------------------------------------------------------------------------------------

function seek(frame) {
  state.frame = Math.min(Math.max(frame, 0), scene.frames - 1);
  stage.dirty = true;
  $("scrub").value = state.frame;
  $("scrub").style.setProperty("--done", `${(100 * state.frame) / Math.max(1, scene.frames - 1)}%`);
  $("clock").textContent = `${(state.frame / scene.rate).toFixed(2)} / ${((scene.frames - 1) / scene.rate).toFixed(2)} s`;
  scene.actors.forEach((actor) => {
    if (actor.live) actor.live.textContent = `now ${with_unit(actor.errors[state.measure][Math.round(state.frame)], measure().unit)}`;
  });
  move_cursor();
}

function play(on) {
  if (on && state.frame >= scene.frames - 1) seek(0);
  state.playing = on;
  $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  $("play").classList.toggle("on", on);
}

let lastTick = null;
function tick(now) {
  if (state.playing && lastTick !== null) {
    const next = state.frame + ((now - lastTick) / 1000) * scene.rate * state.speed;
    if (next >= scene.frames - 1) { seek(0); } else seek(next);
  }
  lastTick = now;
  if (stage.dirty) stage.draw();
  requestAnimationFrame(tick);
}

// --- plots ----------------------------------------------------------------------------------------------------------

const FONT = { family: "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif", size: 12, color: "#3b4252" };
const CONFIG = { responsive: true, displaylogo: false, displayModeBar: false, scrollZoom: false };
const coarse = matchMedia("(pointer: coarse)").matches;
const layout = (more) => ({
  font: FONT, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false,
  margin: { l: 46, r: 12, t: 8, b: 38 }, dragmode: coarse ? false : "zoom",
  hoverlabel: { bgcolor: "#fff", bordercolor: "#cfd6e1", font: { ...FONT, color: "#1d2330" } }, ...more,
});
const axis = (title, more = {}) => ({
  title: { text: title, font: { size: 12 }, standoff: 6 }, gridcolor: "#e6eaf0", zerolinecolor: "#c9d0db", linecolor: "#c9d0db", automargin: true, ...more,
});
const methods_shown = () => scene.actors.slice(1).filter((actor) => !state.hidden.has(actor.method));

function plot_time() {
  const { label, unit } = measure(), node = $("time-plot");
  const x = Array.from({ length: scene.frames }, (_, i) => i / scene.rate);
  const traces = methods_shown().map((actor) => ({
    x, y: Array.from(actor.errors[state.measure], (value) => (Number.isFinite(value) ? value : null)), name: actor.name, mode: "lines",
    line: { color: actor.colour, width: 1.6 }, hovertemplate: `%{y:.2f} ${unit}<extra>${actor.html}</extra>`,
  }));
  Plotly.react(node, traces, layout({
    hovermode: "x unified", hoverdistance: -1, xaxis: axis("time, s", { hoverformat: ".2f", range: [0, x[x.length - 1] || 1] }),
    yaxis: axis(`${label}, ${unit}`, { rangemode: "tozero", fixedrange: true }),
  }), CONFIG).then(() => {
    move_cursor();
    if (node.linked) return;
    node.linked = true;
    node.on("plotly_click", (event) => seek(Math.round(event.points[0].x * scene.rate)));
    node.on("plotly_relayout", move_cursor);
    node.on("plotly_afterplot", move_cursor);
  });
}

function move_cursor() {
  const full = $("time-plot")._fullLayout, cursor = $("cursor");
  if (!full || !full.xaxis || !scene) return;
  const at = full.xaxis.l2p(state.frame / scene.rate), inside = at >= -1 && at <= full.xaxis._length + 1;
  cursor.style.visibility = inside ? "visible" : "hidden";
  cursor.style.transform = `translateX(${full.xaxis._offset + at}px)`;
  cursor.style.top = `${full.yaxis._offset}px`;
  cursor.style.height = `${full.yaxis._length}px`;
}

function joint_errors(actor) {
  if (!state.whole) return actor.result.joints[state.measure];
  const parts = DATA.sequences.flatMap((sequence) => sequence.results.filter((result) => result.method === actor.method).map((result) => [sequence.frames, result.joints[state.measure]]));
  const total = parts.reduce((sum, [frames]) => sum + frames, 0);
  return DATA.bones.map((_, j) => parts.reduce((sum, [frames, joints]) => sum + (frames * joints[j]) / total, 0));
}

function plot_joints() {
  const { label, unit } = measure(), keep = DATA.joint_order;
  const words = (name) => name.replace(/([A-Z])/g, " $1").toLowerCase();
  const traces = methods_shown().map((actor) => {
    const errors = joint_errors(actor);
    return {
      type: "bar", orientation: "h", name: actor.name, y: keep.map((j) => words(DATA.bones[j])), x: keep.map((j) => errors[j]),
      marker: { color: actor.colour }, hovertemplate: `%{y}: %{x:.2f} ${unit}<extra>${actor.html}</extra>`,
    };
  });
  Plotly.react($("joint-plot"), traces, layout({
    barmode: "group", bargap: 0.28, bargroupgap: 0.05, margin: { l: 104, r: 12, t: 4, b: 38 },
    xaxis: axis(`${label}, ${unit}`, { rangemode: "tozero", fixedrange: true }),
    yaxis: axis("", { autorange: "reversed", fixedrange: true, tickfont: { size: 11 }, automargin: true, dtick: 1 }),
  }), CONFIG);
}

function plot_steps() {
  const actors = methods_shown().filter((actor) => actor.steps.length);
  $("step-card").hidden = scene.actors.slice(1).every((actor) => !actor.steps.length);
  if ($("step-card").hidden) return;
  const all = actors.flatMap((actor) => Array.from(actor.steps)).sort((a, b) => a - b);
  const top = all.length ? Math.max(1.25 * all[Math.floor(0.985 * (all.length - 1))], 0.05) : 1;
  const traces = actors.map((actor) => ({
    type: "histogram", x: Array.from(actor.steps, (value) => Math.min(value, top)), name: actor.name, opacity: 0.68, histnorm: "percent",
    marker: { color: actor.colour }, xbins: { start: 0, end: 1.02 * top, size: top / 60 },
    hovertemplate: `%{x} ms: %{y:.1f} %<extra>${actor.html}</extra>`,
  }));
  Plotly.react($("step-plot"), traces, layout({
    barmode: "overlay", xaxis: axis("ms a step (last bar: all slower ones)", { range: [0, 1.03 * top], fixedrange: true }),
    yaxis: axis("steps, %", { fixedrange: true }),
  }), CONFIG);
  const rows = [["p50", "step_ms_p50"], ["p95", "step_ms_p95"], ["p99", "step_ms_p99"], ["look-ahead", "look_ahead_ms"]];
  $("step-table").replaceChildren(
    element("thead", {}, element("tr", {}, element("th", {}, "ms"), ...actors.map((actor) => name_cell("th", actor)))),
    element("tbody", {}, ...rows.map(([label, key]) => element("tr", {}, element("th", {}, label),
      ...actors.map((actor) => element("td", {}, number(actor.result.metrics[key])))))));
}

// --- tables ---------------------------------------------------------------------------------------------------------

const name_cell = (tag, { colour, name }) => element(tag, {}, element("i", { class: "dot", style: { background: colour } }), name);

function fill_summary() {
  const methods = DATA.methods;
  const rows = DATA.metrics.filter(({ name }) => methods.some((method) => method.metrics[name])).map(({ name, label, shared }) => {
    const cells = methods.map((method) => method.metrics[name]);
    const figures = cells.map((cell) => (cell ? Number(cell.value.toPrecision(3)) : Infinity));
    const best = !shared && methods.length > 1 ? Math.min(...figures) : NaN;
    return element("tr", {}, element("th", { title: name }, label), ...cells.map((cell, i) => element("td", { class: figures[i] === best ? "best" : "" },
      cell ? number(cell.value) : "–", ...(cell && cell.spread !== null ? [element("small", {}, ` ± ${number(cell.spread, decimals(cell.value))}`)] : []))));
  });
  $("summary").replaceChildren(
    element("thead", {}, element("tr", {}, element("th", {}, "metric"), ...methods.map((method) => name_cell("th", method)))),
    element("tbody", {}, ...rows));
  $("summary-note").textContent = DATA.sequences.length > 1
    ? `Mean ± standard deviation over ${DATA.sequences.length} sequences; smaller is better, the best in bold.`
    : "One sequence, so no spread; smaller is better, the best in bold.";
}

function fill_sequences() {
  $("sequences-card").hidden = DATA.sequences.length < 2;
  const head = element("tr", {}, element("th", {}, "sequence"), element("th", {}, "frames"), ...DATA.methods.map((method) => name_cell("th", method)));
  const rows = DATA.sequences.map((sequence) => {
    const index = FIGURES.indexOf(sequence);
    const name = index < 0 ? sequence.name : element("button", { class: "link", onclick: () => { choose(index); $("stage").scrollIntoView({ block: "center", behavior: "smooth" }); } }, sequence.name);
    return element("tr", {}, element("th", {}, name), element("td", {}, String(sequence.frames)), ...DATA.methods.map((_, m) => {
      const result = sequence.results.find((entry) => entry.method === m);
      return element("td", {}, result ? number(result.metrics.joint_angle_deg) : "–");
    }));
  });
  $("sequences").replaceChildren(element("thead", {}, head), element("tbody", {}, ...rows));
}

function fill_cards() {
  const card = (actor, ...content) => {
    const box = element("input", { type: "checkbox", "aria-label": `Show ${actor.name}`, onchange: (event) => {
      if (event.target.checked) state.hidden.delete(actor.method); else state.hidden.add(actor.method);
      refresh_plots();
    } });
    box.checked = !state.hidden.has(actor.method);
    box.style.accentColor = actor.colour;
    return element("section", { class: "method", style: { borderColor: actor.colour } }, element("label", {}, box, element("b", {}, actor.name)), ...content);
  };
  $("cards").replaceChildren(...scene.actors.map((actor) => {
    if (!actor.result) return card(actor, element("p", {}, `${scene.frames} frames at ${Number(scene.rate.toFixed(2))} Hz`));
    const metrics = actor.result.metrics;
    actor.live = element("span", { class: "now" });
    const others = DATA.measures.filter((other) => other !== measure());
    const lines = [others.map((other) => `${other.label} ${with_unit(metrics[other.metric], other.unit)}`).join(", ")];
    if (Number.isFinite(metrics.step_ms_p50)) lines.push(`${number(metrics.step_ms_p50)} ms a step, p99 ${number(metrics.step_ms_p99)}`);
    return card(actor, element("div", { class: "big" }, element("strong", {}, with_unit(metrics[measure().metric], measure().unit)), actor.live),
      ...lines.map((text) => element("p", {}, text)));
  }));
}

// --- putting it together ---------------------------------------------------------------------------------------------

function choose(index) {
  state.sequence = index;
  const sequence = FIGURES[index];
  const actor = (method, source, result) => ({
    ...source, method, result, html: source.name.replaceAll("&", "&amp;").replaceAll("<", "&lt;"),
    track: new Track(result ? result.track : sequence.truth, DATA.parents),
    errors: result ? Object.fromEntries(Object.entries(result.errors).map(([key, text]) => [key, unpack(text, Float32Array)])) : {},
    steps: result ? unpack(result.steps, Float32Array) : [],
  });
  scene = {
    rate: sequence.rate, frames: sequence.frames,
    actors: [actor(-1, DATA.truth, null), ...sequence.results.map((result) => actor(result.method, DATA.methods[result.method], result))],
  };
  $("scrub").max = scene.frames - 1;
  $("sequence").value = index;
  stage.face(scene.actors[0].track);
  seek(0);
  refresh_plots();
}

function refresh_plots() {
  fill_cards();
  stage.labels();
  stage.dirty = true;
  plot_time();
  plot_joints();
  plot_steps();
  seek(state.frame);
}

function press(button, on) { button.setAttribute("aria-pressed", on); }

function connect() {
  const controls = { side: () => { state.overlay = false; }, over: () => { state.overlay = true; }, heat: () => { state.heat = !state.heat; } };
  Object.entries(controls).forEach(([id, act]) => $(id).addEventListener("click", () => {
    act();
    press($("side"), !state.overlay); press($("over"), state.overlay); press($("heat"), state.heat);
    $("heat-scale").hidden = !state.heat;
    stage.labels();
    stage.dirty = true;
  }));
  $("view").addEventListener("click", () => stage.face(scene.actors[0].track));
  $("play").addEventListener("click", () => play(!state.playing));
  $("scrub").addEventListener("input", (event) => { play(false); seek(Number(event.target.value)); });
  $("speed").addEventListener("change", (event) => { state.speed = Number(event.target.value); });
  $("sequence").append(...FIGURES.map((sequence, i) => element("option", { value: i }, sequence.name)));
  $("sequence").addEventListener("change", (event) => choose(Number(event.target.value)));
  $("sequence").hidden = FIGURES.length < 2;
  $("measure").append(...DATA.measures.map(({ key, label, unit }) => element("option", { value: key }, `${label}, ${unit}`)));
  $("measure").addEventListener("change", (event) => { state.measure = event.target.value; refresh_plots(); });
  $("scope").hidden = DATA.sequences.length < 2;
  [["this-one", false], ["all-of-them", true]].forEach(([id, whole]) => $(id).addEventListener("click", () => {
    state.whole = whole;
    press($("this-one"), !whole); press($("all-of-them"), whole);
    plot_joints();
  }));
  document.addEventListener("keydown", (event) => {
    if (event.target.matches("select, textarea, input[type=checkbox]") || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? Math.round(scene.rate) : 1;
    const act = {
      " ": () => play(!state.playing), ArrowRight: () => { play(false); seek(Math.round(state.frame) + step); },
      ArrowLeft: () => { play(false); seek(Math.round(state.frame) - step); }, Home: () => seek(0), End: () => seek(scene.frames - 1),
    }[event.key];
    if (!act || (event.key === " " && event.target.matches("button, a, summary"))) return;
    event.preventDefault();
    act();
  });
}

const stage = new Stage();
connect();
fill_summary();
fill_sequences();
choose(0);
stage.resize();
requestAnimationFrame(tick);
