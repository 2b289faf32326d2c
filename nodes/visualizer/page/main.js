// The page: what is open, the list of topics, the status line.

import { choice, make, seconds, si } from "./dom.js";
import { GraphPanel } from "./graph.js";
import { EventsPanel, ImagePanel } from "./pictures.js";
import { RatesPanel, RunPanel } from "./system.js";
import { SeriesPanel, TablePanel } from "./tables.js";
import { Wire } from "./wire.js";

const KINDS = { image: ImagePanel, events: EventsPanel, table: TablePanel, triggers: TablePanel, series: SeriesPanel };
const SYSTEM = { rates: ["Rates", RatesPanel], graph: ["Graph", GraphPanel], run: ["Run", RunPanel] };
const byId = (id) => document.getElementById(id);

class App {
  constructor() {
    this.panels = [];
    this.instances = {};
    this.env = 0;
    byId("menu").onclick = () => document.body.classList.toggle("narrow");
    document.addEventListener("visibilitychange", () => this.changed());
    this.wire = new Wire({
      hello: (graph) => this.begin(graph),
      prepare: (part) => this.panelOf(part)?.prepare(part),
      draw: (parts) => parts.forEach((part) => this.draw(part)),
      state: (state) => this.setState(state),
      error: (text) => console.error(text),
    });
  }

  begin(graph) {
    const same = this.graph && this.graph.run_id === graph.run_id;
    this.graph = graph;
    this.setState("waiting");
    if (same) return;
    document.title = `${graph.name} \u00b7 EVIS`;
    byId("run").textContent = graph.name;
    this.list();
    for (const panel of [...this.panels]) panel.root.remove();
    this.panels = [];
    for (const spec of this.recall() || this.defaults()) this.open(spec);
    this.changed();
  }

  /** Open panels of an earlier visit in this tab, as far as this graph has their topics. */
  recall() {
    try {
      const specs = JSON.parse(sessionStorage.getItem(`evis:${this.graph.name}`)) || null;
      return specs && specs.filter((s) => SYSTEM[s.id] || this.graph.topics.some((t) => t.name === s.topic && s.view in t.views));
    } catch {
      return null;
    }
  }

  remember() {
    sessionStorage.setItem(`evis:${this.graph.name}`, JSON.stringify(this.panels.map((p) => p.spec)));
  }

  /** For every camera its picture and its events, then the rates and the graph. */
  defaults() {
    const specs = [];
    for (const camera of [...new Set(this.graph.topics.map((t) => t.camera).filter(Boolean))].slice(0, 2)) {
      const mine = this.graph.topics.filter((t) => t.camera === camera && !t.dormant);
      const picture = ["Keyframe", "Image", "Frames"].map((type) => mine.find((t) => t.type === type)).find(Boolean);
      const events = mine.find((t) => t.type === "EventPacket");
      for (const topic of [picture, events]) if (topic) specs.push(this.specOf(topic));
    }
    return [...specs, { id: "rates" }, { id: "graph" }];
  }

  specOf(topic) {
    const view = Object.keys(topic.views)[0];
    let id = topic.name;
    for (let n = 2; this.panels.some((p) => p.spec.id === id); n++) id = `${topic.name} ${n}`;
    return { id, topic: topic.name, view, env: this.env };
  }

  open(spec) {
    const topic = this.graph.topics.find((t) => t.name === spec.topic);
    const Kind = topic ? KINDS[topic.views[spec.view]] : SYSTEM[spec.id]?.[1];
    if (!Kind) return;
    const panel = new Kind(this, spec, topic);
    panel.kind = Kind;
    this.panels.push(panel);
    byId("panels").append(panel.root);
  }

  close(panel) {
    panel.root.remove();
    this.panels = this.panels.filter((p) => p !== panel);
    this.changed();
  }

  /** After any change of what is open: rebuild panels whose view is of another kind, tell the node, mark the list. */
  changed() {
    if (!this.graph) return;
    this.panels.forEach((panel, i) => {
      const topic = this.graph.topics.find((t) => t.name === panel.spec.topic);
      const Kind = topic && KINDS[topic.views[panel.spec.view]];
      if (!Kind || Kind === panel.kind) return;
      const fresh = new Kind(this, panel.spec, topic);
      fresh.kind = Kind;
      panel.root.replaceWith(fresh.root);
      this.panels[i] = fresh;
    });
    this.remember();
    this.wire.show(document.hidden ? [] : [...this.panels.flatMap((p) => p.subscriptions()), ...this.infos()]);
    for (const [key, button] of Object.entries(this.buttons)) {
      button.ariaPressed = String(this.panels.some((p) => p.spec.id === key || p.spec.topic === key));
    }
    byId("hint").hidden = this.panels.length > 0;
  }

  /** Camera descriptions, for the names of instances; they come once. */
  infos() {
    const cameras = new Set(this.panels.flatMap((p) => p.topic ? [p.topic.camera] : []));
    return this.graph.topics.filter((t) => t.type === "CameraInfo" && cameras.has(t.camera))
      .map((t) => ({ id: `info:${t.camera}`, topic: t.name, view: "camera", env: 0 }));
  }

  instanceName(camera, id) {
    return this.instances[camera]?.[id] || `id ${id}`;
  }

  list() {
    const nav = byId("topics");
    this.buttons = {};
    nav.replaceChildren();
    if (this.graph.envs > 1) {
      const options = Array.from({ length: this.graph.envs }, (_, i) => [String(i), String(i)]);
      nav.append(make("label", {}, "environment", choice(options, String(this.env), (value) => {
        this.env = Number(value);
        for (const panel of this.panels) if (panel.spec.topic) panel.spec.env = this.env;
        const specs = this.panels.map((p) => p.spec);
        for (const panel of this.panels) panel.root.remove();
        this.panels = [];
        specs.forEach((spec) => this.open(spec));
        this.changed();
      }, "Environment of all panels")));
    }
    const add = (key, text, title, toggle) => {
      const rate = make("span", { className: "rate" });
      this.buttons[key] = make("button", { title, onclick: toggle }, text, rate);
      this.buttons[key].rate = rate;
      nav.append(this.buttons[key]);
    };
    let camera = null;
    for (const topic of this.graph.topics) {
      if (topic.camera !== camera) {
        camera = topic.camera;
        nav.append(make("h2", { textContent: camera || "world" }));
      }
      const short = topic.name.slice(topic.name.lastIndexOf("/") + 1);
      add(topic.name, short, `${topic.name}: ${topic.help}${topic.dormant ? " (starts when opened)" : ""}`, () => this.toggle(topic.name, topic));
    }
    nav.append(make("h2", { textContent: "graph" }));
    for (const [id, [title]] of Object.entries(SYSTEM)) add(id, title, title, () => this.toggle(id, null));
  }

  toggle(key, topic) {
    const open = this.panels.filter((p) => p.spec.id === key || p.spec.topic === key);
    if (open.length) open.forEach((panel) => this.close(panel));
    else {
      this.open(topic ? this.specOf(topic) : { id: key });
      this.changed();
      this.panels.at(-1).root.scrollIntoView({ block: "nearest" });
    }
  }

  panelOf(part) {
    return this.panels.find((p) => p.subscriptions().some((s) => s.id === part.panel));
  }

  draw(part) {
    if (part.kind === "status") return this.status(part);
    if (part.panel.startsWith("info:")) {
      this.instances[part.panel.slice(5)] = part.names;
      return;
    }
    const panel = this.panelOf(part);
    if (!panel) return;
    panel.draw(part);
    this.setState("live");
  }

  status(status) {
    if (status.state === "finished") this.setState("finished");
    const clock = status.clock;
    const gauges = [
      ["time", "t" in clock ? seconds(clock.t) : "\u2013"],
      ["real time", typeof clock.rtf === "number" ? `${si(clock.rtf)} \u00d7` : "\u2013"],
      ["events", si(status.events_per_s, "ev/s")],
      ["drops", si(status.drops), status.drops > 0],
    ];
    byId("gauges").replaceChildren(...gauges.map(([name, value, alert]) =>
      make("div", { className: alert ? "alert" : "" }, make("dt", { textContent: name }), make("dd", { textContent: value }))));
    for (const [name, topic] of Object.entries(status.topics)) {
      if (this.buttons[name]) this.buttons[name].rate.textContent = topic.hz > 0 ? `${topic.hz.toFixed(topic.hz < 10 ? 1 : 0)} Hz` : "";
    }
    for (const panel of this.panels) {
      panel.status(status);
      panel.refused(status.refused[panel.spec.topic]);
    }
  }

  setState(state) {
    if (this.state === "finished" && state === "closed") return;
    this.state = state;
    const texts = { live: "live", waiting: "waiting for data", finished: "run has ended", closed: "not connected", connecting: "connecting" };
    const element = byId("state");
    element.dataset.state = state;
    element.textContent = texts[state];
  }
}

globalThis.evis = new App();
