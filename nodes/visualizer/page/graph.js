// The graph as a picture: nodes in columns along the data's way, one curve per pair of nodes, topics written on it.

import { Panel } from "./panel.js";

const LEAST_WIDE = 138, TALL = 46, GAP_X = 128, GAP_Y = 34, PAD = 22;

const svg = (tag, attributes = {}, ...children) => {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
};

/** Width of a node that holds the longest of the names beside its dot, at the letters' greatest width. */
const widthFor = (nodes) => Math.max(LEAST_WIDE, ...nodes.map((n) => 8.2 * n.name.length + 36));

/** Node name -> {column, row, x, y}. Columns: longest way from a source; loops are closed by `delayed` edges. */
export function layout(nodes, edges) {
  const wide = widthFor(nodes);
  const column = Object.fromEntries(nodes.map((n) => [n.name, 0]));
  const forward = edges.filter((e) => e.kind !== "delayed" && e.from in column && e.to in column && e.from !== e.to);
  for (let pass = 0; pass < nodes.length; pass++) {
    for (const e of forward) column[e.to] = Math.min(Math.max(column[e.to], column[e.from] + 1), nodes.length);
  }
  const connected = new Set(edges.flatMap((e) => [e.from, e.to]));
  const last = Math.max(0, ...Object.values(column));
  for (const n of nodes) if (!connected.has(n.name)) column[n.name] = last;
  const columns = [];
  for (const n of nodes) (columns[column[n.name]] ||= []).push(n.name);
  const filled = columns.filter(Boolean);
  const tallest = Math.max(...filled.map((c) => c.length));
  const places = {};
  filled.forEach((names, c) => {
    // Nodes stand near the mean height of what feeds them, so that curves cross little.
    const mean = (name) => {
      const rows = forward.filter((e) => e.to === name && places[e.from]).map((e) => places[e.from].y);
      return rows.length ? rows.reduce((a, b) => a + b) / rows.length : 0;
    };
    names.sort((a, b) => mean(a) - mean(b));
    names.forEach((name, r) => {
      const row = r + (tallest - names.length) / 2;
      places[name] = { x: PAD + c * (wide + GAP_X), y: PAD + row * (TALL + GAP_Y) };
    });
  });
  return { places, wide, width: 2 * PAD + filled.length * (wide + GAP_X) - GAP_X, height: 2 * PAD + tallest * (TALL + GAP_Y) - GAP_Y };
}

const tail = (topic) => topic.slice(topic.lastIndexOf("/") + 1);

export class GraphPanel extends Panel {
  constructor(app, spec) {
    super(app, spec, "Graph");
    this.root.classList.add("wide");
    this.finishBar();
    this.foot.remove();
    this.body.className = "graph";
    this.status({ nodes: {} });
  }

  /** What the page itself reads now: taps to the visualizer, as open panels need them. */
  taps() {
    const viewer = this.app.graph.nodes.find((n) => n.type === "Visualizer");
    const open = new Set(this.app.panels.flatMap((p) => p.subscriptions()).map((s) => s.topic));
    const read = this.app.graph.topics.filter((t) => viewer && open.has(t.name));
    return read.map((t) => ({ from: t.node, to: viewer.name, topic: t.name, kind: "tap" }));
  }

  picture({ nodes, edges }) {
    const { places, wide, width, height } = layout(nodes, edges);
    this.wide = wide;
    const marker = svg("marker", { id: "tip", viewBox: "0 0 8 8", refX: 7, refY: 4, markerWidth: 7, markerHeight: 7, orient: "auto" },
      svg("path", { d: "M0 0L8 4L0 8z" }));
    const pairs = new Map();
    for (const e of edges) {
      const key = `${e.from}\n${e.to}\n${e.kind}`;
      if (!pairs.has(key)) pairs.set(key, { ...e, topics: [] });
      pairs.get(key).topics.push(tail(e.topic));
    }
    this.top = 0;
    this.bottom = height;
    const curves = [...pairs.values()].filter((e) => places[e.from] && places[e.to]).map((e) => this.edge(e, places));
    return svg("svg", { viewBox: `0 ${this.top} ${width} ${this.bottom - this.top}`, role: "img", style: `max-width: ${width}px` },
      svg("defs", {}, marker), ...curves, ...nodes.map((n) => this.node(n, places[n.name])));
  }

  edge({ from, to, kind, topics }, places) {
    const a = places[from], b = places[to];
    const back = b.x <= a.x;
    const x0 = a.x + this.wide, y0 = a.y + TALL / 2, x1 = b.x - 2, y1 = b.y + TALL / 2;
    const far = b.x - a.x > this.wide + GAP_X + 1;
    const bend = GAP_X / 2;
    // A curve that passes other columns swings above or below them.
    const swing = far ? (y1 >= y0 ? 1 : -1) * (TALL + GAP_Y) * 1.1 : 0;
    const d = back
      ? `M${a.x + this.wide / 2} ${a.y}C${a.x + this.wide / 2} ${a.y - 40} ${b.x + this.wide / 2} ${b.y - 40} ${b.x + this.wide / 2} ${b.y - 2}`
      : `M${x0} ${y0}C${x0 + bend} ${y0 + swing} ${x1 - bend} ${y1 + swing} ${x1} ${y1}`;
    const text = svg("text", { x: (x0 + x1) / 2, "text-anchor": "middle" });
    const middle = (back ? Math.min(a.y, b.y) - 26 : (y0 + y1) / 2 + 0.75 * swing) - 6 * (topics.length - 1) + 3;
    this.top = Math.min(this.top, middle - 16);
    this.bottom = Math.max(this.bottom, middle + 12 * topics.length);
    topics.forEach((topic, i) => text.append(svg("tspan", { x: (x0 + x1) / 2, y: middle + 12 * i }, topic)));
    return svg("g", { class: `edge ${kind}` }, svg("path", { d, "marker-end": "url(#tip)" }), text);
  }

  node(node, { x, y }) {
    const dot = svg("circle", { cx: x + this.wide - 12, cy: y + 13, r: 3.5 });
    const sub = svg("text", { class: "sub", x: x + 11, y: y + 35 }, node.dormant ? "starts on request" : node.process);
    this.dots[node.name] = dot;
    this.subs[node.name] = { sub, node };
    return svg("g", { class: node.dormant ? "node dormant" : "node" },
      svg("title", {}, `${node.type} in process ${node.process}`),
      svg("rect", { x, y, width: this.wide, height: TALL, rx: 6 }), dot,
      svg("text", { class: "title", x: x + 11, y: y + 19 }, node.name), sub);
  }

  status(status) {
    const { nodes, edges } = this.app.graph;
    const taps = this.taps();
    const drawn = taps.map((t) => t.topic).join();
    if (drawn !== this.drawn) {
      this.drawn = drawn;
      this.dots = {};
      this.subs = {};
      this.body.replaceChildren(this.picture({ nodes, edges: [...edges, ...taps] }));
    }
    for (const [name, state] of Object.entries(status.nodes)) {
      if (!this.dots[name]) continue;
      this.dots[name].setAttribute("class", state.level);
      const ms = typeof state.ms === "number" && state.ms > 0 ? `${state.ms.toFixed(state.ms < 10 ? 2 : 0)} ms` : this.subs[name].node.process;
      this.subs[name].sub.textContent = state.hz > 0 ? `${state.hz.toFixed(1)} Hz   ${ms}` : this.subs[name].node.process;
    }
  }
}
