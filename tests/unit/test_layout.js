// node test_layout.js VIEW.JS: no two nodes of the view's graph are drawn in the same place, and the nodes of an edge
// are about one apart. Ticks are round, inside their scale, and told apart by their texts. Frames that are forgotten
// leave their bounds to the next one.
const fs = require("fs");
const source = fs.readFileSync(process.argv[2], "utf8");
const constants = source.match(/^const (MANY|LONG|BETWEEN_ROWS) = [^;]*;/gm).join("");
const part = (from, to, names, place) => new Function(
  "place", constants + source.slice(source.indexOf(from), source.indexOf(to)) + `; return {${names}};`)(place);
const {layOut} = part("function distances", "// --- the graph ---", "layOut");
const chain = n => Array.from({length: n - 1}, (_, i) => ({a: i, b: i + 1}));
for (const [n, edges] of [[1, []], [2, chain(2)], [3, chain(3)], [10, chain(10)], [5, [...chain(5), {a: 4, b: 0}]]]) {
  const p = layOut({nodes: new Array(n).fill({}), edges});
  const apart = (i, k) => Math.hypot(p[i][0] - p[k][0], p[i][1] - p[k][1]);
  for (let i = 0; i < n; ++i) for (let k = 0; k < i; ++k) {
    if (!(apart(i, k) > 0.5)) throw new Error(`${n} nodes: ${i} and ${k} are ${apart(i, k)} apart`);
  }
  for (const e of edges) {
    if (Math.abs(apart(e.a, e.b) - 1) > 0.4) throw new Error(`${n} nodes: an edge is ${apart(e.a, e.b)} long`);
  }
}

// A long chain, and a ladder, in rows: inside the canvas, no two nodes close to each other, all edges short.
const ladder = Array.from({length: 49}, (_, i) => ({a: i, b: i + 2 < 50 ? i + 2 : i - 1}));
for (const [n, edges] of [[64, chain(64)], [50, [{a: 0, b: 1}, ...ladder]]]) for (const [width, height] of [[990, 250], [370, 420]]) {
  const place = layOut({nodes: new Array(n).fill({}), edges});
  const {fold} = part("// Returns the pixels of a long graph", "// Returns the pixels of all places", "fold", place);
  const p = fold(width, height), at = `${n} nodes in ${width} x ${height}`;
  const apart = (i, k) => Math.hypot(p[i][0] - p[k][0], p[i][1] - p[k][1]);
  if (p.some(q => q[0] < 20 || q[0] > width - 20 || q[1] < 20 || q[1] > height - 20)) throw new Error(`${at}: outside`);
  for (let i = 0; i < n; ++i) for (let k = 0; k < i; ++k) if (!(apart(i, k) > 15)) throw new Error(`${at}: ${i} and ${k}`);
  for (const e of edges) if (apart(e.a, e.b) > 160) throw new Error(`${at}: an edge is ${apart(e.a, e.b)} long`);
}

const {ticks, tickTexts} = part("// Returns ticks of a scale", "// --- receiving ---", "ticks, tickTexts");
for (const [low, high] of [[0, 1], [-3, 7.3], [1e-9, 2.5e-9], [293.15, 293.1502], [-12.3676422, -12.3676421], [-1e7, 3e6], [0, 1e-13]]) {
  for (const most of [2, 4, 7]) for (const unit of ["J", "J/K", "s", "kg m/s"]) {
    const t = ticks(low, high, most), texts = tickTexts(t, unit), at = `${low} to ${high}, ${most}, ${unit}`;
    if (t.values.length < 1 || t.values.length > most + 1) throw new Error(`${at}: ${t.values.length} ticks`);
    if (t.values.some(v => v < low - 1e-6 * t.step || v > high + 1e-6 * t.step)) throw new Error(`${at}: ${t.values}`);
    if (new Set(texts).size !== texts.length) throw new Error(`${at}: ${texts}`);
  }
}
const found = tickTexts(ticks(0, 0.004, 4), "J").join();
if (found !== "0 mJ,1 mJ,2 mJ,3 mJ,4 mJ") throw new Error(found);

const {thin} = part("// Forgets every second one", "// --- placing the parts ---", "thin");
const frame = v => ({parts: [[v]], edges: [[]], states: [[]]});
let all = [0, 5, 1, -7, 2, 3, 4].map(frame);
all = thin(all, 4);
if (all.map(f => f.parts[0][0]).join() !== "0,1,2,3,4") throw new Error(all.map(f => f.parts[0][0]));
if (all[1].low[0][0] !== 1 || all[1].high[0][0] !== 5 || all[2].low[0][0] !== -7 || all[2].high[0][0] !== 2) throw new Error("bounds");
if (all[3].low !== undefined) throw new Error("bounds of a frame that nothing was forgotten before");
all = thin(all, 4);
if (all[1].high[0][0] !== 5 || all[1].low[0][0] !== -7) throw new Error("bounds of bounds");
