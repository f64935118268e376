// The page of `portmetd view`: draws the messages of its websocket (daemon/app/command_view.c), and
// sends the words of its buttons where the service lets views control runs. All frames that have come
// are kept, at most MOST; when there are more, every second one of the older half is forgotten, and
// the next one keeps its bounds.
"use strict";

const MOST = 2000;
const MANY = 24; // nodes, beyond which they are small and without names
const LONG = 5; // times as many steps from end to end as nodes at a step
const BETWEEN_ROWS = 1.5; // lengths of an edge between the rows of a long graph
const COLORS = ["#3b7ea1", "#c4691c", "#4f8f4f", "#a14a76", "#8a7a1f", "#6b5fb0", "#2f9188", "#b0483f",
  "#7a6a5a", "#5f7f9f"];
const NS = "http://www.w3.org/2000/svg";
const byId = id => document.getElementById(id);

let scene = null, frames = [], health = null, paused = false, shown = -1, dirty = true;
let socket = null, connected = false, lastFrame = 0, lastHealth = 0, place = [], selected = -1;
let pressed = false; // a pointer is down on the graph, whose nodes stay until it has clicked
let hasStates = false; // frames have states
let zoom = null, cursor = null; // the times shown, [first, last], null: all; and the time pointed at

// --- numbers ---

function text(value, unit) {
  if (value === null || value === undefined || !isFinite(value)) return "-";
  if (value === 0) return "0" + (unit ? " " + unit : "");
  if (!unit) return Number(value.toPrecision(4)).toString();
  const prefixes = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];
  const size = Math.abs(value);
  const found = prefixes.find(p => size >= p[0]);
  if (!found || size >= 1e12) return value.toExponential(2) + " " + unit;
  return Number((value / found[0]).toPrecision(4)) + " " + found[1] + unit;
}

// Returns ticks of a scale from low to high: multiples of 1, 2 or 5 times a power of ten, at most `most` intervals.
function ticks(low, high, most) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find(f => f * power >= rough * (1 - 1e-9));
  const result = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) result.push(k * step);
  return {step, values: result};
}

// Returns the text of each tick, with one prefix and as many digits as tell neighbours apart.
function tickTexts(t, unit) {
  const size = Math.max(...t.values.map(Math.abs), t.step);
  const prefixes = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];
  const found = unit && /^[A-Z]/.test(unit) && prefixes.find(p => size >= p[0]);
  if (!found && size !== 0 && (size < 1e-3 || size >= 1e6)) {
    const power = 10 ** Math.floor(Math.log10(size)), digits = Math.max(0, Math.ceil(-Math.log10(t.step / power) - 1e-9));
    return t.values.map(v => v === 0 ? "0" : (v / power).toFixed(digits) + "e" + Math.round(Math.log10(power)) + " " + unit);
  }
  const scale = found ? found[0] : 1, digits = Math.max(0, Math.ceil(-Math.log10(t.step / scale) - 1e-9));
  return t.values.map(v => (v / scale).toFixed(digits).replace(/^-(0[.0]*)$/, "$1") + " " + (found ? found[1] : "") + unit);
}

// --- receiving ---

function connect() {
  socket = new WebSocket("ws://" + location.host + "/");
  socket.onopen = () => { connected = true; scene = null; dirty = true; socket.send("query"); };
  socket.onmessage = event => receive(JSON.parse(event.data));
  socket.onclose = () => { connected = false; dirty = true; setTimeout(connect, 1000); };
}

function receive(message) {
  if (message.scene) {
    scene = message.scene;
    frames = [];
    health = null;
    paused = false;
    selected = -1;
    zoom = cursor = null;
    place = layOut(scene);
    hasStates = false;
    for (const panel of panels) panel.offer();
    document.title = scene.name + " - portmet";
  } else if (message.frame) {
    addFrame(message.frame);
  } else if (message.control) {
    byId("control").hidden = !message.control.allowed;
    byId("said").textContent = message.control.said;
  } else if (message.health) {
    health = message.health;
    lastHealth = performance.now();
  }
  dirty = true;
}

function addFrame(frame) {
  if (frames.length && frames[0].session !== frame.session) {
    frames = [];
    paused = false;
    if (byId("control").hidden) socket.send("query");
  }
  lastFrame = performance.now();
  frames.push(frame);
  if (hasStates !== frame.states[0].some(value => value !== null)) { // a run has them while it is recorded
    hasStates = !hasStates;
    for (const panel of panels) panel.offer();
  }
  if (frames.length > MOST) {
    const old = MOST / 2, at = frames[shown];
    frames = thin(frames, old);
    if (paused) shown = Math.max(0, frames.findIndex(f => f.step >= at.step));
  }
}

// Forgets every second one of the first frames; the frame behind it takes its bounds.
function thin(all, old) {
  const forgotten = i => i > 0 && i <= old && i % 2 !== 0;
  all.forEach((f, i) => {
    if (!forgotten(i) || i + 1 === all.length) return;
    const next = all[i + 1], numbers = g => [...g.parts.flat(), ...g.edges.flat(), ...g.states.flat()];
    const bounds = (g, which) => g[which] ? g[which][0] : numbers(g);
    const widen = (which, choose) => bounds(f, which).map((v, k) => {
      const other = bounds(next, which)[k];
      return v === null ? other : other === null ? v : choose(v, other);
    });
    const low = widen("low", Math.min), high = widen("high", Math.max);
    next.low = [low];
    next.high = [high];
  });
  return all.filter((f, i) => !forgotten(i));
}

// --- placing the parts ---

// Returns the numbers of edges between all pairs of nodes; far apart without a path.
function distances(count, edges) {
  const near = Array.from({length: count}, () => []);
  for (const e of edges) { near[e.a].push(e.b); near[e.b].push(e.a); }
  return near.map((_, start) => {
    const far = new Array(count).fill(-1), queue = [start];
    far[start] = 0;
    for (const k of queue) {
      for (const n of near[k]) if (far[n] < 0) { far[n] = far[k] + 1; queue.push(n); }
    }
    const most = Math.max(2, ...far);
    return far.map(d => d < 0 ? most + 1 : d);
  });
}

// Returns places [step, rank] by steps from one end, if there are many nodes and few of them at each step; else null.
function layOutLong(level, forward) {
  const count = [];
  const p = level.map(step => {
    count[step] = (count[step] || 0) + 1;
    return [step, count[step] - 1];
  });
  const steps = count.length, thick = Math.max(...count.filter(c => c));
  if (p.length <= MANY || steps < LONG * thick) return null;
  const places = p.map(([step, rank]) => [forward ? step : steps - 1 - step, rank]);
  return Object.assign(places, {steps, thick});
}

// Majorises the stress of the distances (Gansner, Koren, North, Graph Drawing 2004), from a circle in
// the order of a search from one end, and turns the longest direction to the horizontal.
function layOut(s) {
  const n = s.nodes.length, d = distances(n, s.edges);
  if (n === 0) return [];
  const end = d[0].indexOf(Math.max(...d[0])), long = layOutLong(d[end], d[end][0] < d[end][n - 1]);
  if (long) return long;
  const order = [...Array(n).keys()].sort((i, k) => d[end][i] - d[end][k]);
  let p = new Array(n);
  order.forEach((node, i) => {
    const angle = Math.PI * i / Math.max(1, n - 1);
    p[node] = [-n * Math.cos(angle), n * 0.3 * Math.sin(angle)];
  });
  for (let round = 0; round < (n < 60 ? 500 : 150); ++round) {
    // One node after the other: if both of a pair moved at once, they would meet.
    for (let i = 0; i < n; ++i) {
      let sum = 0, x = 0, y = 0;
      for (let k = 0; k < n; ++k) {
        if (k === i) continue;
        const w = 1 / (d[i][k] * d[i][k]), dx = p[i][0] - p[k][0], dy = p[i][1] - p[k][1];
        const length = Math.hypot(dx, dy) || 1e-9;
        sum += w;
        x += w * (p[k][0] + d[i][k] * dx / length);
        y += w * (p[k][1] + d[i][k] * dy / length);
      }
      if (sum > 0) p[i] = [x / sum, y / sum];
    }
  }
  return turn(p);
}

function turn(p) {
  const mean = [0, 1].map(c => p.reduce((sum, q) => sum + q[c], 0) / p.length);
  let xx = 0, xy = 0, yy = 0;
  for (const q of p) {
    const x = q[0] - mean[0], y = q[1] - mean[1];
    xx += x * x; xy += x * y; yy += y * y;
  }
  const angle = -0.5 * Math.atan2(2 * xy, xx - yy), c = Math.cos(angle), s = Math.sin(angle);
  let turned = p.map(q => [c * (q[0] - mean[0]) - s * (q[1] - mean[1]), s * (q[0] - mean[0]) + c * (q[1] - mean[1])]);
  if (turned[0][0] > turned[turned.length - 1][0]) turned = turned.map(q => [-q[0], q[1]]);
  return turned;
}

// --- the graph ---

function element(name, attributes, parent, content) {
  const e = document.createElementNS(NS, name);
  for (const key in attributes) e.setAttribute(key, attributes[key]);
  if (content !== undefined) e.textContent = content;
  parent.appendChild(e);
  return e;
}

// Returns the pixels of a long graph in rows, each of which goes back the way of the one before.
function fold(width, height) {
  const {steps, thick} = place, row = thick - 1 + BETWEEN_ROWS;
  let size = 0, columns = steps;
  for (let c = 1; c <= steps; ++c) {
    const rows = Math.ceil(steps / c);
    const own = Math.min((width - 60) / Math.max(1, c - 1), (height - 60) / Math.max(1, rows * row - BETWEEN_ROWS), 120);
    if (own > size) { size = own; columns = c; }
  }
  const rows = Math.ceil(steps / columns), left = width / 2 - (columns - 1) / 2 * size;
  const top = height / 2 - (rows * row - BETWEEN_ROWS) / 2 * size;
  return place.map(([step, rank]) => {
    const k = Math.floor(step / columns), along = step % columns;
    return [left + (k % 2 ? columns - 1 - along : along) * size, top + (k * row + rank) * size];
  });
}

// Returns the pixels of all places, which keep proportions unless the graph is a line. `upright`: the longest
// direction is vertical, as a narrow page has room there.
function fit(width, height, upright) {
  if (place.steps) return fold(width, height);
  const p = upright ? place.map(q => [q[1], q[0]]) : place;
  const xs = p.map(q => q[0]), ys = p.map(q => q[1]);
  const x0 = Math.min(...xs), x1 = Math.max(...xs), y0 = Math.min(...ys), y1 = Math.max(...ys);
  const room = upright ? [width - 180, height - 60] : [width - 110, height - 90];
  const scale = [room[0] / Math.max(x1 - x0, 1e-6), room[1] / Math.max(y1 - y0, 1e-6)];
  const [short, long] = upright ? [0, 1] : [1, 0];
  scale[short] = Math.min(scale[short], scale[long] * 2);
  scale[long] = Math.min(scale[long], scale[short] * 4, 260);
  scale[short] = Math.min(scale[short], scale[long] * 2);
  return p.map(q => [(upright ? width / 3 : width / 2) + (q[0] - (x0 + x1) / 2) * scale[0],
    height / 2 + (q[1] - (y0 + y1) / 2) * scale[1]]);
}

// The power from a to b: the energy flux into b.
function power(frame, k) {
  return frame.edges[1][k];
}

// The largest power of any port in all frames: the arrows keep one scale over the run.
function largestPower() {
  let most = 0;
  for (const f of frames) for (const p of f.edges[1]) if (Math.abs(p) > most) most = Math.abs(p);
  return most;
}

// Ports between the same two nodes lie side by side.
function lanes() {
  const count = new Map();
  const lane = scene.edges.map(e => {
    const key = e.a + " " + e.b, i = count.get(key) || 0;
    count.set(key, i + 1);
    return i;
  });
  return scene.edges.map((e, k) => lane[k] - (count.get(e.a + " " + e.b) - 1) / 2);
}

function drawArrow(svg, from, to, radius, widest, share, offset) {
  const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy) || 1;
  const u = [dx / length, dy / length], v = [-u[1], u[0]], side = offset * (widest + 6);
  const at = (along, across) => [from[0] + u[0] * along + v[0] * (across + side),
    from[1] + u[1] * along + v[1] * (across + side)];
  const start = radius + 2, end = length - radius - 2, width = widest * share;
  if (end <= start) return;
  const line = [at(start, 0), at(end, 0)];
  element("path", {class: "wire", d: "M" + line.map(q => q.join(" ")).join("L")}, svg);
  if (width < 0.3) return;
  const head = Math.min(width * 0.9 + 5, (end - start) * 0.6), h = width / 2, wide = h + 3;
  const outline = [at(start, -h), at(end - head, -h), at(end - head, -wide), at(end, 0),
    at(end - head, wide), at(end - head, h), at(start, h)];
  element("path", {class: "arrow", d: "M" + outline.map(q => q.join(" ")).join("L") + "Z"}, svg);
}

function drawGraph(frame) {
  const svg = byId("graph"), many = scene && scene.nodes.length > MANY, focused = nodeInFocus();
  const narrow = svg.clientWidth < 600, folded = narrow && place.steps;
  const upright = scene && scene.nodes.length > 1 && narrow && !folded;
  svg.style.height = folded ? "420px" : upright ? Math.max(230, Math.min((many ? 22 : 62) * scene.nodes.length, 1400)) + "px" : "";
  const width = svg.clientWidth, height = svg.clientHeight;
  svg.replaceChildren();
  if (!scene || !width) return;
  const most = largestPower(), offset = lanes(), nodes = fit(width, height, upright);
  // Nodes are as large as the shortest edge allows.
  const shortest = Math.min(Infinity, ...scene.edges.map(e => Math.hypot(nodes[e.a][0] - nodes[e.b][0], nodes[e.a][1] - nodes[e.b][1])));
  const radius = many ? Math.max(3, Math.min(7, 0.35 * shortest)) : Math.max(8, Math.min(22, 0.3 * shortest)), widest = (many ? 1.4 : 1.2) * radius;
  const named = upright || shortest > 70;
  scene.edges.forEach((e, k) => {
    const p = frame ? power(frame, k) : 0, share = most > 0 && p !== null ? Math.abs(p) / most : 0;
    const [a, b] = p < 0 ? [e.b, e.a] : [e.a, e.b];
    drawArrow(svg, nodes[a], nodes[b], radius, widest, share, p < 0 ? -offset[k] : offset[k]);
    if (many || !named) return;
    const x = (nodes[e.a][0] + nodes[e.b][0]) / 2, y = (nodes[e.a][1] + nodes[e.b][1]) / 2;
    const value = !frame ? e.name : p === null ? "-" : text(Math.abs(p), "W");
    if (upright) {
      element("text", {x: x + widest / 2 + 12, y: y + 4 + 15 * offset[k], class: "value beside"}, svg, value);
    } else {
      // Between nodes that are close, the value has room below both.
      const flat = Math.abs(nodes[e.a][0] - nodes[e.b][0]) > 2 * Math.abs(nodes[e.a][1] - nodes[e.b][1]);
      const clear = shortest < 110 && flat ? Math.max(nodes[e.a][1], nodes[e.b][1]) + radius + 12 : 0;
      const below = Math.max(clear, y + widest / 2 + 14) + Math.max(0, offset[k]) * (widest + 6) + (offset[k] < 0 ? -widest - 22 : 0);
      element("text", {x: x, y: below, class: "value"}, svg, value);
    }
  });
  scene.nodes.forEach((node, i) => drawNode(svg, node, i, nodes[i], radius, many ? "none" : upright ? "beside" : named ? "above" : i % 2 ? "above" : "below", frame));
  if (focused >= 0 && svg.querySelector("g[data-node='" + focused + "']")) svg.querySelector("g[data-node='" + focused + "']").focus();
  byId("scale").textContent = most > 0 ? "the widest arrow of the run is " + text(most, "W") +
    (scene.subsystems > scene.parts ? "; " + scene.subsystems + " subsystems in " + scene.parts + " groups" : "") : "";
}

// The node that the keyboard has reached; -1: none.
function nodeInFocus() {
  const node = document.activeElement && document.activeElement.dataset ? document.activeElement.dataset.node : undefined;
  return node === undefined ? -1 : Number(node);
}

function drawNode(svg, node, i, at, radius, label, frame) {
  const input = i >= scene.parts;
  const says = node.name + (input ? ", from outside" : frame ? ", " + text(frame.parts[0][i], "J") : "");
  const group = element("g", {tabindex: 0, role: "button", "aria-pressed": i === selected, "aria-label": says, "data-node": i}, svg);
  const shape = input
    ? element("rect", {x: at[0] - radius, y: at[1] - radius, width: 2 * radius, height: 2 * radius, class: "node input"}, group)
    : element("circle", {cx: at[0], cy: at[1], r: radius, class: "node"}, group);
  if (!input) shape.style.stroke = color(i);
  shape.style.strokeWidth = i === selected ? 4 : 2;
  element("title", {}, group, says);
  if (label === "beside") element("text", {x: at[0] + radius + 8, y: at[1] + 4, class: "beside"}, group, node.name);
  else if (label !== "none") element("text", {x: at[0], y: label === "below" ? at[1] + radius + 16 : at[1] - radius - 7}, group, node.name);
  group.onclick = () => select(i);
  group.onkeydown = event => {
    if (event.key !== "Enter" && event.key !== " ") return;
    select(i);
    event.preventDefault();
    event.stopPropagation();
  };
}

function select(i) {
  selected = selected === i ? -1 : i;
  dirty = true;
}

// --- curves ---

function color(i) {
  return COLORS[i % COLORS.length];
}

// What a panel may show: the unit, whether curves begin at zero, and a list of curves: the number's place in a frame
// (parts, edges and states, one after the other), its name, and the nodes that it belongs to.
const KINDS = {
  energies: {title: "Energies", unit: "J", change: true, byNode: true, of: s => rows(s.nodes.slice(0, s.parts), i => i, i => [i])},
  entropies: {title: "Entropies", unit: "J/K", change: true, byNode: true, of: s => rows(s.nodes.slice(0, s.parts), i => s.parts + i, i => [i])},
  productions: {title: "Entropy production within", unit: "W/K", byNode: true, of: s => rows(s.nodes.slice(0, s.parts), i => 2 * s.parts + i, i => [i])},
  powers: {title: "Powers through the ports", unit: "W", of: s => edgeRows(s, 1)},
  fluxes: {title: "Entropy fluxes into the second ends", unit: "W/K", of: s => edgeRows(s, 3)},
  firstFluxes: {title: "Entropy fluxes into the first ends", unit: "W/K", of: s => edgeRows(s, 2)},
};

function rows(items, at, nodes) {
  return items.map((item, i) => ({name: item.name, at: at(i), nodes: nodes(i)}));
}

function edgeRows(s, which) {
  return rows(s.edges, i => 3 * s.parts + which * s.edges.length + i, i => [s.edges[i].a, s.edges[i].b]);
}

// States are offered by their unit.
function stateKinds(s) {
  const kinds = {}, first = 3 * s.parts + 4 * s.edges.length;
  s.states.forEach((state, i) => {
    const key = "state " + state.unit, owner = state.name.split(".")[0];
    kinds[key] = kinds[key] || {title: "States in " + state.unit, unit: state.unit, list: []};
    kinds[key].list.push({name: state.name, at: first + i, nodes: [s.nodes.findIndex(n => n.name === owner)]});
    kinds[key].of = () => kinds[key].list;
  });
  return kinds;
}

// Returns number `at` of a frame, or its bound "low" or "high".
function number(f, at, bound) {
  if (bound && f[bound]) return f[bound][0][at];
  if (at < 3 * scene.parts) return f.parts[Math.floor(at / scene.parts)][at % scene.parts];
  at -= 3 * scene.parts;
  const n = scene.edges.length;
  return at < 4 * n ? f.edges[Math.floor(at / n)][at % n] : f.states[0][at - 4 * n];
}

function makePanel(section) {
  const panel = {section, kinds: {}, curves: [], x: null};
  const make = (tag, attributes, parent) => {
    const e = document.createElement(tag);
    Object.assign(e, attributes);
    parent.append(e);
    return e;
  };
  panel.total = section.dataset.kind === "energy" || section.dataset.kind === "entropy" ? section.dataset.kind : null;
  const tools = make("div", {className: "tools"}, section);
  if (!panel.total) {
    panel.choice = make("select", {ariaLabel: "what the curves show"}, make("h2", {}, tools));
    panel.choice.onchange = () => { dirty = true; };
    make("small", {className: "since"}, tools);
  }
  for (const [name, save] of [["Whole run", () => { zoom = null; }], ["CSV", () => saveCsv(panel)], ["PNG", () => savePng(panel)]]) {
    make("button", {type: "button", textContent: name, ariaLabel: name + ", " + section.getAttribute("aria-label")}, tools)
      .onclick = () => { save(); dirty = true; };
  }
  make("canvas", {className: panel.total ? "low" : ""}, section);
  make("output", {className: "values"}, section);
  if (!panel.total) panel.legend = make("div", {className: "legend"}, section);
  panel.canvas = section.querySelector("canvas");
  panel.canvas.tabIndex = 0;
  panel.canvas.setAttribute("role", "img");
  panel.offer = () => {
    panel.kinds = panel.total ? {} : {...KINDS, ...(hasStates ? stateKinds(scene) : {})};
    if (panel.total) return;
    const chosen = panel.choice.value || section.dataset.kind;
    panel.choice.replaceChildren(...Object.keys(panel.kinds).map(key => new Option(panel.kinds[key].title, key)));
    panel.choice.value = panel.kinds[chosen] ? chosen : section.dataset.kind;
  };
  listen(panel);
  return panel;
}

// Pointing shows values, dragging chooses a time, and the keyboard does both.
function listen(panel) {
  const canvas = panel.canvas, timeAt = event => panel.x ? panel.x.time(event.clientX - canvas.getBoundingClientRect().left) : null;
  let from = null;
  canvas.onpointerdown = event => { from = timeAt(event); cursor = from; canvas.setPointerCapture(event.pointerId); dirty = true; };
  canvas.onpointermove = event => { cursor = timeAt(event); panel.drag = from === null ? null : [from, cursor]; dirty = true; };
  canvas.onpointerup = event => {
    const to = timeAt(event);
    if (from !== null && panel.x && Math.abs(panel.x.pixel(to) - panel.x.pixel(from)) > 5) zoom = [Math.min(from, to), Math.max(from, to)];
    from = panel.drag = null;
    dirty = true;
  };
  canvas.onpointerleave = () => { if (from === null) { cursor = null; dirty = true; } };
  canvas.onpointercancel = () => { from = panel.drag = cursor = null; };
  canvas.ondblclick = () => { zoom = null; dirty = true; };
  canvas.onkeydown = event => {
    if (!frames.length) return;
    const [a, b] = shownTimes(), middle = cursor === null ? (a + b) / 2 : cursor, length = b - a;
    const move = {ArrowLeft: -0.01, ArrowRight: 0.01, PageUp: -0.1, PageDown: 0.1}[event.key];
    if (move) cursor = Math.min(b, Math.max(a, middle + move * length));
    else if (event.key === "+") zoom = [Math.max(a, middle - length / 4), Math.min(b, middle + length / 4)];
    else if (event.key === "-") zoom = [middle - length, middle + length];
    else if (event.key === "Escape" || event.key === "Home") zoom = cursor = null;
    else return;
    dirty = true;
    event.preventDefault();
  };
}

// The times that all panels show.
function shownTimes() {
  const all = [frames[0].time, frames[frames.length - 1].time];
  if (!zoom) return all;
  const cut = [Math.max(all[0], zoom[0]), Math.min(all[1], zoom[1])];
  return cut[1] > cut[0] ? cut : all;
}

// The curves of a panel: names, units, values and bounds over all frames.
function curvesOf(panel) {
  const style = getComputedStyle(document.body);
  if (panel.total) {
    const value = f => f[panel.total];
    return {unit: panel.total === "energy" ? "J" : "J/K", change: true, title: "total " + panel.total, list: [{
      name: "total " + panel.total, value, low: value, high: value, alpha: 1,
      color: style.getPropertyValue(panel.total === "energy" ? "--power" : "--heat")}]};
  }
  const kind = panel.kinds[panel.choice.value], all = kind.of(scene);
  const chosen = all.filter(c => c.nodes.includes(selected));
  return {unit: kind.unit, change: kind.change, title: kind.title, list: all.map((c, i) => ({
    name: c.name, color: color(kind.byNode ? c.nodes[0] : i), alpha: chosen.length && !chosen.includes(c) ? 0.15 : all.length > 24 && !chosen.length ? 0.5 : 1,
    chosen: chosen.includes(c), value: f => number(f, c.at), low: f => number(f, c.at, "low"), high: f => number(f, c.at, "high")}))};
}

function drawLegend(panel, curves) {
  if (!panel.legend) return;
  const list = curves.list.some(c => c.chosen) ? curves.list.filter(c => c.chosen) : curves.list, most = 24;
  const spans = list.slice(0, most).map(c => {
    const span = document.createElement("span"), mark = document.createElement("i");
    mark.style.background = c.color;
    span.className = c.chosen ? "chosen" : "";
    span.append(mark, c.name);
    return span;
  });
  if (list.length > most) spans.push("and " + (list.length - most) + " more: click a node to see its curves");
  if (!list.length) spans.push("there are none");
  panel.legend.replaceChildren(...spans);
}

// The frame at a time: the last one not after it.
function frameAt(time) {
  let low = 0, high = frames.length - 1;
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (frames[middle].time <= time) low = middle; else high = middle - 1;
  }
  if (low + 1 < frames.length && frames[low + 1].time - time < time - frames[low].time) ++low;
  return frames[low];
}

function drawPanel(panel) {
  const canvas = panel.canvas, ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight, style = getComputedStyle(document.body);
  if (canvas.width !== width * ratio || canvas.height !== height * ratio) {
    canvas.width = width * ratio;
    canvas.height = height * ratio;
  }
  const c = canvas.getContext("2d"), values = panel.section.querySelector(".values");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, width, height);
  panel.x = null;
  values.textContent = "";
  if (!scene || frames.length < 2) return;
  const curves = curvesOf(panel), [t0, t1] = shownTimes();
  drawLegend(panel, curves);
  canvas.setAttribute("aria-label", curves.title + " over time, " + curves.list.length + " curves");
  // "Change" counts from the first frame that was heard, which the page says where the run had begun before.
  panel.section.querySelector(".since").textContent = !curves.change ? "" :
    frames[0].step > 0 ? "since " + text(frames[0].time, "s") + ", when it was first heard" : panel.total ? "" : "change since the start";
  const shownFrames = frames.filter((f, i) => f.time >= t0 && f.time <= t1 ||
    (i + 1 < frames.length && frames[i + 1].time >= t0 && f.time < t0) || (i > 0 && frames[i - 1].time <= t1 && f.time > t1));
  const scale = {low: Infinity, high: -Infinity};
  for (const curve of curves.list) {
    const known = curves.change && frames.find(f => curve.value(f) !== null), first = curve.first = known ? curve.value(known) : 0;
    curve.rows = shownFrames.map(f => [curve.value, curve.low, curve.high].map(get => get(f) === null ? null : get(f) - first));
    for (const [, low, high] of curve.rows) {
      if (low !== null && low < scale.low) scale.low = low;
      if (high !== null && high > scale.high) scale.high = high;
    }
  }
  if (!isFinite(scale.low) || !isFinite(scale.high)) return;
  if (scale.high - scale.low < 1e-13 * Math.max(Math.abs(scale.high), 1e-2)) {
    const middle = (scale.high + scale.low) / 2, half = 1e-13 * Math.max(Math.abs(middle), 1e-2);
    scale.low = middle - half;
    scale.high = middle + half;
  }
  const left = 84, right = 10, top = 8, bottom = 20;
  const x = t => left + (t - t0) / Math.max(t1 - t0, 1e-12) * (width - left - right);
  const y = v => height - bottom - (v - scale.low) / (scale.high - scale.low) * (height - top - bottom);
  panel.x = {pixel: x, time: p => Math.min(t1, Math.max(t0, t0 + (p - left) / (width - left - right) * (t1 - t0)))};
  drawAxes(c, {x, y, low: scale.low, high: scale.high, t0, t1, left, right, top, width, height, bottom, unit: curves.unit,
    faint: style.getPropertyValue("--faint"), line: style.getPropertyValue("--line")});
  c.save();
  c.beginPath();
  c.rect(left, 0, width - left - right, height - bottom + 1);
  c.clip();
  for (const curve of curves.list) drawCurve(c, curve, shownFrames, x, y);
  c.restore();
  drawMarks(c, panel, curves, {x, top, bottom: height - bottom, style, values});
}

// Draws what lies between the bounds of each frame as an area, and the values as a line.
function drawCurve(c, curve, shownFrames, x, y) {
  c.strokeStyle = c.fillStyle = curve.color;
  if (curve.rows.some(r => r[1] !== r[2])) {
    c.globalAlpha = 0.3 * curve.alpha;
    c.beginPath();
    curve.rows.forEach((r, k) => { if (r[1] !== null) c.lineTo(x(shownFrames[k].time), y(r[1])); });
    for (let k = curve.rows.length - 1; k >= 0; --k) if (curve.rows[k][2] !== null) c.lineTo(x(shownFrames[k].time), y(curve.rows[k][2]));
    c.fill();
  }
  c.globalAlpha = curve.alpha;
  c.lineWidth = 1.5;
  c.beginPath();
  curve.rows.forEach((r, k) => { if (r[0] !== null && isFinite(r[0])) c.lineTo(x(shownFrames[k].time), y(r[0])); });
  c.stroke();
  c.globalAlpha = 1;
}

// Draws the time where the page is paused, the time pointed at with its values, and the time that is being chosen.
function drawMarks(c, panel, curves, a) {
  const line = (t, dash) => {
    c.setLineDash(dash);
    c.beginPath();
    c.moveTo(a.x(t), a.top);
    c.lineTo(a.x(t), a.bottom);
    c.stroke();
    c.setLineDash([]);
  };
  c.lineWidth = 1;
  c.strokeStyle = a.style.getPropertyValue("--faint");
  if (paused && frames[shown]) line(frames[shown].time, []);
  if (panel.drag) {
    c.globalAlpha = 0.15;
    c.fillStyle = a.style.getPropertyValue("--heat");
    c.fillRect(a.x(panel.drag[0]), a.top, a.x(panel.drag[1]) - a.x(panel.drag[0]), a.bottom - a.top);
    c.globalAlpha = 1;
  }
  if (cursor === null) return;
  const f = frameAt(cursor), list = curves.list.some(q => q.chosen) ? curves.list.filter(q => q.chosen) : curves.list;
  line(f.time, [3, 3]);
  a.values.textContent = text(f.time, "s") + ", step " + f.step + ": " +
    list.slice(0, 8).map(q => q.name + " " + text(q.value(f), curves.unit) +
      (curves.change && q.value(f) !== null ? ", change " + text(q.value(f) - q.first, curves.unit) : "")).join("; ") +
    (list.length > 8 ? "; and " + (list.length - 8) + " more" : "");
}

function drawAxes(c, a) {
  c.font = "12px system-ui, sans-serif";
  c.fillStyle = a.faint;
  c.strokeStyle = a.line;
  c.lineWidth = 1;
  c.textAlign = "right";
  const up = ticks(a.low, a.high, Math.max(2, Math.floor((a.height - a.top - a.bottom) / 28)));
  tickTexts(up, a.unit).forEach((label, i) => {
    const y = a.y(up.values[i]);
    c.beginPath();
    c.moveTo(a.left, y);
    c.lineTo(a.width - a.right, y);
    c.stroke();
    c.fillText(label, a.left - 6, y + 4);
  });
  if (a.t1 <= a.t0) return;
  const along = ticks(a.t0, a.t1, Math.max(2, Math.floor((a.width - a.left - a.right) / 80)));
  c.textAlign = "center";
  tickTexts(along, "s").forEach((label, i) => {
    const x = a.x(along.values[i]), half = c.measureText(label).width / 2;
    c.beginPath();
    c.moveTo(x, a.top);
    c.lineTo(x, a.height - a.bottom + 4);
    c.stroke();
    c.fillText(label, Math.min(x, a.width - half), a.height - 4);
  });
}

// --- saving ---

function save(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

// All curves of a panel, also those that another node hides, at the times that are shown, with their bounds.
function csvOf(panel) {
  const curves = curvesOf(panel), [t0, t1] = shownTimes();
  const quoted = name => '"' + name.replace(/"/g, '""') + '"';
  const bounded = frames.some(f => f.low);
  const lines = [["step", "time [s]", ...curves.list.flatMap(c => (bounded ? ["", " least", " largest"] : [""])
    .map(end => quoted(c.name + end + " [" + curves.unit + "]")))].join(",")];
  for (const f of frames) {
    if (f.time < t0 || f.time > t1) continue;
    lines.push([f.step, f.time, ...curves.list.flatMap(c => bounded ? [c.value(f), c.low(f), c.high(f)] : [c.value(f)])].join(","));
  }
  return lines.join("\n") + "\n";
}

const fileName = panel => scene.name + "_" + curvesOf(panel).title.toLowerCase().replace(/[^a-z0-9]+/g, "_");

function saveCsv(panel) {
  if (scene && frames.length) save(fileName(panel) + ".csv", new Blob([csvOf(panel)], {type: "text/csv"}));
}

function savePng(panel) {
  if (!scene || !frames.length) return;
  const canvas = document.createElement("canvas"), from = panel.canvas;
  canvas.width = from.width;
  canvas.height = from.height;
  const c = canvas.getContext("2d");
  c.fillStyle = getComputedStyle(document.body).getPropertyValue("--panel");
  c.fillRect(0, 0, canvas.width, canvas.height);
  c.drawImage(from, 0, 0);
  canvas.toBlob(blob => save(fileName(panel) + ".png", blob));
}

// --- processes ---

function drawHealth() {
  const body = byId("health").tBodies[0];
  byId("health-section").hidden = !health;
  if (!health) return;
  const blocker = byId("blocker");
  blocker.textContent = health.blocker ? "all others wait for " + health.blocker :
    health.rows.length < health.processes ? health.rows.length + " of " + health.processes + ", those that hold up most" : "";
  body.replaceChildren(...health.rows.map(healthRow));
}

function peer(name, share) {
  return name === null ? "-" : name + " " + Math.round(100 * share) + " %";
}

function healthRow(r) {
  const row = document.createElement("tr"), quiet = r.silent < 0 || r.silent > Math.max(3, health.rate ? 0 : health.processes / 4);
  const add = (content, bad) => {
    const cell = row.insertCell();
    cell.textContent = content;
    if (bad) cell.className = "bad";
    return cell;
  };
  add(r.name + (r.silent < 0 ? " (not heard yet)" : quiet ? " (silent)" : ""), quiet || r.name === health.blocker);
  if (r.silent < 0) return row;
  add(r.step);
  add(text(r.rate));
  const busy = add(Math.round(100 * r.busy) + " %"), bar = document.createElement("span");
  bar.className = "bar";
  bar.style.width = Math.round(60 * Math.min(1, Math.max(0, r.busy))) + "px";
  busy.prepend(bar);
  add(peer(r.waits_for, r.waits));
  add(peer(r.loses_from, r.loss), r.loss > 0.05);
  add(text(r.asks));
  add(text(r.answers));
  add(r.drops);
  add(r.strange, r.strange > 0);
  add(r.checkpoint < 0 ? "none" : Math.round(r.checkpoint));
  add((r.memory / 1048576).toFixed(1));
  return row;
}

// --- the whole page ---

function stateText() {
  if (!connected) return ["no connection to portmetd view", true];
  if (!scene) return ["connecting", false];
  if (scene.recording !== null) return ["recording " + scene.recording, false];
  if (!frames.length) return ["no run is heard yet", false];
  if (health && health.over) return ["the run is over", false];
  const still = (performance.now() - lastFrame) / 1000, silent = (performance.now() - lastHealth) / 1000;
  if (still > 3 && silent < 3) return ["no new step for " + Math.round(still) + " s", true];
  return still > 3 ? ["silent for " + Math.round(still) + " s", true] : ["running", false];
}

function drawFacts(frame) {
  const [state, bad] = stateText();
  byId("state").textContent = state;
  byId("state").className = bad ? "bad" : "";
  byId("name").textContent = scene ? scene.name : "portmet";
  byId("pause").textContent = !paused ? "Pause" : scene && scene.recording !== null ? "To the end" : "Follow";
  const at = byId("at");
  at.max = Math.max(0, frames.length - 1);
  at.value = shown;
  if (!frame) return;
  const steps = health ? health.steps : scene.steps;
  byId("step").textContent = frame.step + (steps ? " of " + steps : "");
  byId("time").textContent = text(frame.time, "s");
  byId("rate").textContent = health ? text(health.rate) : "-";
  byId("energy").textContent = text(frame.energy, "J");
  byId("entropy").textContent = text(frame.entropy, "J/K");
  byId("violations").textContent = text(frame.violations);
  byId("violations").className = frame.violations > 0 ? "bad" : "";
  byId("energy-residual").textContent = "relative residual " + text(frame.energy_residual);
  byId("entropy-residual").textContent = "relative residual " + text(frame.entropy_residual);
  byId("shown").textContent = paused ? "shown: " + text(frame.time, "s") : scene.recording !== null ? "the end is shown" : "follows the run";
}

// How much of the run the curves are made of.
function drawHeard() {
  const last = frames[frames.length - 1], first = frames[0];
  if (!last || last.seen === null) { byId("heard").textContent = ""; return; }
  const all = scene.recording !== null ? last.step + 1 : last.step - first.step + 1, part = Math.min(1, last.seen / all);
  byId("heard").textContent = frames.length + " points of each curve are kept, made of " + last.seen + " of " + all +
    " steps (" + (part < 1 ? Math.min(99.9, 100 * part).toFixed(1) : "100") + " %)" +
    (frames.some(f => f.low) ? "; areas reach from the least to the largest value between two points." : ".");
}

const panels = [...document.querySelectorAll(".panel")].map(makePanel);

function draw() {
  if (!paused) shown = frames.length - 1;
  shown = Math.min(Math.max(shown, frames.length ? 0 : -1), frames.length - 1);
  const frame = frames[shown];
  drawFacts(frame);
  if (!pressed) drawGraph(frame);
  for (const panel of panels) drawPanel(panel);
  drawHealth();
  drawHeard();
}

byId("pause").onclick = () => { paused = !paused; dirty = true; };
byId("control").onclick = event => { if (connected && event.target.value) socket.send(event.target.value); };
byId("graph").onpointerdown = () => { pressed = true; };
window.onpointerup = window.onpointercancel = () => { pressed = false; };
byId("at").oninput = event => { paused = true; shown = Number(event.target.value); dirty = true; };
document.onkeydown = event => {
  if (event.key === " " && !["BUTTON", "SELECT"].includes(event.target.tagName)) { paused = !paused; dirty = true; event.preventDefault(); }
};
window.onresize = () => { dirty = true; };
matchMedia("(prefers-color-scheme: dark)").onchange = () => { dirty = true; };

// Draws at most ten times a second, and only what has changed.
setInterval(() => {
  if (dirty) { dirty = false; draw(); }
}, 100);
setInterval(() => { dirty = true; }, 1000);
connect();
