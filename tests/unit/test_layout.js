// node test_layout.js VIEW.JS: no two nodes of the view's graph are drawn in the same place, and the nodes of an edge
// are about one apart.
const fs = require("fs");
const source = fs.readFileSync(process.argv[2], "utf8");
const from = source.indexOf("function distances"), to = source.indexOf("// --- the graph ---");
const layOut = new Function(source.slice(from, to) + "; return layOut;")();
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
