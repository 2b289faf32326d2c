// Panels about the graph itself: rates of nodes and topics, and what this run is.

import { make, si, table } from "./dom.js";
import { Panel } from "./panel.js";

export class RatesPanel extends Panel {
  constructor(app, spec) {
    super(app, spec, "Rates");
    this.root.classList.add("double");
    this.finishBar();
    this.body.className = "scroll low";
    this.foot.remove();
    this.said = make("ul", { className: "lines said", hidden: true });
    this.rates = make("div");
    this.body.append(this.said, this.rates); // what nodes warn of comes first: below many nodes nobody would see it
  }

  status(status) {
    const known = this.app.graph.nodes.map((n) => n.name); // the data's way, as the graph's description lists them
    const place = ([name]) => (known.includes(name) ? known.indexOf(name) : known.length);
    const nodes = Object.entries(status.nodes).sort((a, b) => place(a) - place(b)).map(([name, n]) => make("tr", {},
      make("td", {}, make("span", { className: `level ${n.level}`, title: n.text || n.level }), name),
      cell(n.hz, (v) => v.toFixed(1)), cell(n.ms, (v) => v.toFixed(2)), cell(n.busy, (v) => `${Math.round(100 * v)} %`),
      cell(n.waits, (v) => `${Math.round(100 * v)} %`), cell(n.queue, String), cell(n.drops, String),
      make("td", { className: "text dim", textContent: Object.entries(n.counters).map(([k, v]) => `${k} ${counter(v)}`).join(", ") })));
    const topics = Object.entries(status.topics).sort().map(([name, t]) => make("tr", {},
      make("td", { textContent: name }), cell(t.hz, (v) => v.toFixed(1)), cell(t.shown_hz, (v) => v.toFixed(1)),
      cell(t.events_per_s, (v) => si(v)), cell(t.skipped, String)));
    this.say(status.warnings.slice(0, 20));
    this.rates.replaceChildren(
      grid(["node", "Hz", "ms", "busy", "waits", "queue", "drops", "counters"], nodes, "nothing heard yet"),
      grid(["topic", "Hz", "shown Hz", "events/s", "not shown"], topics, "nothing heard yet"));
  }

  /** The newest first. Only news is written: the lines are scrolled, and copied. */
  say(warnings) {
    const news = JSON.stringify(warnings);
    if (news === this.news) return;
    this.news = news;
    this.said.hidden = !warnings.length;
    this.said.replaceChildren(...warnings.map((w) => make("li", { className: w.level, textContent: `${w.node}: ${w.text}` })));
  }
}

const counter = (value) => (typeof value === "number" && !Number.isInteger(value) ? value.toPrecision(4) : value);

function cell(value, text) {
  const known = typeof value === "number";
  return make("td", { className: known && value !== 0 ? "" : "dim", textContent: known ? text(value) : "\u2013" });
}

function grid(columns, rows, empty) {
  const head = make("tr", {}, ...columns.map((c) => make("th", { className: c === "counters" ? "text" : "", textContent: c })));
  const body = rows.length ? rows : [make("tr", {}, make("td", { className: "dim", textContent: empty }))];
  return make("table", {}, make("thead", {}, head), make("tbody", {}, ...body));
}

export class RunPanel extends Panel {
  constructor(app, spec) {
    super(app, spec, "Run");
    this.finishBar();
    this.foot.remove();
    const g = app.graph;
    const facts = [["launch", g.name], ["run", g.run_id], ["mode", g.mode], ["seed", String(g.seed)],
      ["duration", g.duration_s === null ? "until the sources end" : `${g.duration_s} s`],
      ...Object.entries(g.args).map(([k, v]) => [k, v === null ? "" : String(v)])];
    const left = g.left_out.map((item) => [item.what, item.why]);
    this.body.className = "scroll";
    this.body.append(
      table({ title: left.length ? "Left out, because this graph does not need it" : "Nothing was left out", columns: left.length ? ["what", "why"] : [], rows: left }),
      table({ title: "Arguments", columns: ["name", "value"], rows: facts }));
  }
}
