// The page of `portmetd view`: draws the messages of its websocket (daemon/app/command_view.c), and
// sends the words of its buttons where the service lets views control runs. All frames that have come are kept, at most MOST; when there are more, every second
// one of the older half is forgotten.
"use strict";

const MOST = 2000;
const COLORS = ["#3b7ea1", "#c4691c", "#4f8f4f", "#a14a76", "#8a7a1f", "#6b5fb0", "#2f9188", "#b0483f",
  "#7a6a5a", "#5f7f9f"];
const NS = "http://www.w3.org/2000/svg";
const byId = id => document.getElementById(id);

let scene = null, frames = [], health = null, paused = false, shown = -1, dirty = true;
let socket = null, connected = false, lastFrame = 0, lastHealth = 0, place = [], selected = -1;

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
    paused = scene.recording !== null;
    place = layOut(scene);
    drawLegend();
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
  if (frames.length > MOST) {
    const old = MOST / 2, at = frames[shown];
    frames = frames.filter((f, i) => i === 0 || i > old || i % 2 === 0);
    if (paused) shown = Math.max(0, frames.findIndex(f => f.step >= at.step));
  }
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

// Majorises the stress of the distances (Gansner, Koren, North, Graph Drawing 2004), from a circle in
// the order of a search from one end, and turns the longest direction to the horizontal.
function layOut(s) {
  const n = s.nodes.length, d = distances(n, s.edges);
  if (n === 0) return [];
  const end = d[0].indexOf(Math.max(...d[0]));
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

// Returns a function from places to pixels that keeps proportions unless the graph is a line.
function fit(width, height) {
  const xs = place.map(q => q[0]), ys = place.map(q => q[1]);
  const x0 = Math.min(...xs), x1 = Math.max(...xs), y0 = Math.min(...ys), y1 = Math.max(...ys);
  const room = [width - 110, height - 90];
  const scale = [room[0] / Math.max(x1 - x0, 1e-6), room[1] / Math.max(y1 - y0, 1e-6)];
  scale[1] = Math.min(scale[1], scale[0] * 2);
  scale[0] = Math.min(scale[0], scale[1] * 4, 260);
  scale[1] = Math.min(scale[1], scale[0] * 2);
  return q => [width / 2 + (q[0] - (x0 + x1) / 2) * scale[0], height / 2 + (q[1] - (y0 + y1) / 2) * scale[1]];
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
  const svg = byId("graph"), width = svg.clientWidth, height = svg.clientHeight;
  svg.replaceChildren();
  if (!scene || !width) return;
  const many = scene.nodes.length > 24, radius = many ? 7 : 22, widest = many ? 10 : 26;
  const to = fit(width, height), most = largestPower(), offset = lanes();
  const nodes = place.map(to);
  scene.edges.forEach((e, k) => {
    const p = frame ? power(frame, k) : 0, share = most > 0 && p !== null ? Math.abs(p) / most : 0;
    const [a, b] = p < 0 ? [e.b, e.a] : [e.a, e.b];
    drawArrow(svg, nodes[a], nodes[b], radius, widest, share, p < 0 ? -offset[k] : offset[k]);
    if (many) return;
    const x = (nodes[e.a][0] + nodes[e.b][0]) / 2, y = (nodes[e.a][1] + nodes[e.b][1]) / 2;
    const below = y + widest / 2 + 14 + Math.max(0, offset[k]) * (widest + 6) + (offset[k] < 0 ? -widest - 22 : 0);
    element("text", {x: x, y: below, class: "value"}, svg, frame ? text(Math.abs(p), "W") : e.name);
  });
  scene.nodes.forEach((node, i) => drawNode(svg, node, i, nodes[i], radius, many));
  byId("scale").textContent = most > 0 ? "the widest arrow of the run is " + text(most, "W") +
    (scene.subsystems > scene.parts ? "; " + scene.subsystems + " subsystems in " + scene.parts + " groups" : "") : "";
}

function drawNode(svg, node, i, at, radius, many) {
  const input = i >= scene.parts, group = element("g", {}, svg);
  const shape = input
    ? element("rect", {x: at[0] - radius, y: at[1] - radius, width: 2 * radius, height: 2 * radius, class: "node input"}, group)
    : element("circle", {cx: at[0], cy: at[1], r: radius, class: "node"}, group);
  if (!input) shape.style.stroke = color(i);
  shape.style.strokeWidth = i === selected ? 4 : 2;
  element("title", {}, group, node.name);
  if (!many) element("text", {x: at[0], y: at[1] - radius - 7}, group, node.name);
  group.onclick = () => { selected = selected === i ? -1 : i; drawLegend(); dirty = true; };
}

// --- curves ---

function color(i) {
  return COLORS[i % COLORS.length];
}

function drawLegend() {
  const legend = byId("legend");
  legend.replaceChildren();
  if (!scene) return;
  const count = Math.min(scene.parts, 24);
  for (let i = 0; i < count; ++i) {
    const span = document.createElement("span"), mark = document.createElement("i");
    mark.style.background = color(i);
    span.append(mark, scene.nodes[i].name);
    if (selected >= 0 && selected !== i) span.style.opacity = 0.4;
    legend.append(span);
  }
  if (scene.parts > count) legend.append("and " + (scene.parts - count) + " more: click a node to see its curve");
}

// Draws curves over time. Each curve is a function of a frame; `fill` fills the area below it.
function drawCurves(id, curves, unit) {
  const canvas = byId(id), ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight, style = getComputedStyle(document.body);
  if (canvas.width !== width * ratio || canvas.height !== height * ratio) {
    canvas.width = width * ratio;
    canvas.height = height * ratio;
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, width, height);
  if (frames.length < 2) return;
  const t0 = frames[0].time, t1 = frames[frames.length - 1].time;
  const values = curves.map(curve => frames.map(curve.value));
  let low = Infinity, high = -Infinity;
  for (const row of values) for (const v of row) {
    if (v < low) low = v;
    if (v > high) high = v;
  }
  if (!isFinite(low)) return;
  if (high === low) { high += 1e-15; low -= 1e-15; }
  const left = 84, right = 8, top = 8, bottom = 18;
  const x = t => left + (t - t0) / Math.max(t1 - t0, 1e-12) * (width - left - right);
  const y = v => height - bottom - (v - low) / (high - low) * (height - top - bottom);
  const faint = style.getPropertyValue("--faint"), line = style.getPropertyValue("--line");
  drawAxes(c, {x, y, low, high, t0, t1, left, right, width, height, bottom, unit, faint, line});
  values.forEach((row, i) => {
    c.strokeStyle = curves[i].color;
    c.globalAlpha = curves[i].alpha;
    c.lineWidth = 1.5;
    c.beginPath();
    row.forEach((v, k) => { if (v !== null && isFinite(v)) c.lineTo(x(frames[k].time), y(v)); });
    c.stroke();
  });
  c.globalAlpha = 1;
  if (paused && frames[shown]) {
    c.strokeStyle = faint;
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(x(frames[shown].time), top);
    c.lineTo(x(frames[shown].time), height - bottom);
    c.stroke();
  }
}

function drawAxes(c, a) {
  c.font = "11px system-ui, sans-serif";
  c.fillStyle = a.faint;
  c.strokeStyle = a.line;
  c.lineWidth = 1;
  c.textAlign = "right";
  for (const v of [a.low, a.high]) {
    c.beginPath();
    c.moveTo(a.left, a.y(v));
    c.lineTo(a.width - a.right, a.y(v));
    c.stroke();
    c.fillText(text(v, a.unit), a.left - 6, a.y(v) + 4);
  }
  c.fillText(text(a.t1, "s"), a.width - a.right, a.height - 4);
  c.textAlign = "left";
  c.fillText(text(a.t0, "s"), a.left, a.height - 4);
}

function change(get) {
  const first = get(frames[0]);
  return f => get(f) === null ? null : get(f) - first;
}

function drawAllCurves() {
  if (!scene || !frames.length) return;
  const style = getComputedStyle(document.body);
  const law = (id, field, name, unit) => drawCurves(id,
    [{value: change(f => f[field]), color: style.getPropertyValue(name), alpha: 1}], unit);
  law("law1", "energy", "--power", "J");
  law("law2", "entropy", "--heat", "J/K");
  const parts = [...Array(scene.parts).keys()];
  const curves = row => parts.map(i => ({
    value: change(f => f.parts[row][i]), color: color(i),
    alpha: selected < 0 || selected === i ? (parts.length > 24 && selected < 0 ? 0.5 : 1) : 0.15}));
  drawCurves("energies", curves(0), "J");
  drawCurves("entropies", curves(1), "J/K");
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
  byId("pause").textContent = paused ? "Follow" : "Pause";
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
  byId("shown").textContent = paused ? "shown: " + text(frame.time, "s") : "follows the run";
}

function draw() {
  if (!paused) shown = frames.length - 1;
  shown = Math.min(Math.max(shown, frames.length ? 0 : -1), frames.length - 1);
  const frame = frames[shown];
  drawFacts(frame);
  drawGraph(frame);
  drawAllCurves();
  drawHealth();
}

byId("pause").onclick = () => { paused = !paused; dirty = true; };
byId("control").onclick = event => { if (connected && event.target.value) socket.send(event.target.value); };
byId("at").oninput = event => { paused = true; shown = Number(event.target.value); dirty = true; };
document.onkeydown = event => {
  if (event.key === " " && event.target.tagName !== "BUTTON") { paused = !paused; dirty = true; event.preventDefault(); }
};
window.onresize = () => { dirty = true; };
matchMedia("(prefers-color-scheme: dark)").onchange = () => { dirty = true; };

// Draws at most ten times a second, and only what has changed.
setInterval(() => {
  if (dirty) { dirty = false; draw(); }
}, 100);
setInterval(() => { dirty = true; }, 1000);
connect();
