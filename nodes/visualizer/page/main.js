// The page: what is open, the list of topics, the status line.

import { choice, make, seconds, si } from "./dom.js";
import { GraphPanel } from "./graph.js";
import { Objects } from "./objects.js";
import { opening, specOf } from "./opening.js";
import { wireId } from "./panel.js";
import { EventsPanel, ImagePanel } from "./pictures.js";
import { Playback } from "./playback.js";
import { RatesPanel, RunPanel } from "./system.js";
import { SeriesPanel, TablePanel } from "./tables.js";
import { Wire } from "./wire.js";

const KINDS = { image: ImagePanel, events: EventsPanel, table: TablePanel, triggers: TablePanel, series: SeriesPanel };
const SYSTEM = { rates: ["Rates", RatesPanel], graph: ["Graph", GraphPanel], run: ["Run", RunPanel] };
/** A graph that has sent nothing for longer is not called live [s]. */
const QUIET_S = 3;
const narrow = matchMedia("(max-width: 640px)");
const byId = (id) => document.getElementById(id);

class App {
  constructor() {
    this.panels = [];
    this.pending = [];
    this.objects = {};
    this.moving = null; // names of the bodies that have moved; null: nobody says
    this.playback = new Playback(null);
    this.env = 0;
    byId("menu").onclick = () => document.body.classList.toggle("toggled");
    byId("panels").onclick = () => { // a telephone's topics lie over the panels
      if (narrow.matches) document.body.classList.remove("toggled");
    };
    document.addEventListener("visibilitychange", () => this.changed());
    this.wire = new Wire({
      hello: (graph) => this.begin(graph),
      prepare: (part) => (this.panelOf(part) || this.arrive(part))?.prepare(part),
      draw: (parts) => parts.forEach((part) => this.draw(part)),
      state: (state) => this.setState(state),
      end: (failure) => this.end(failure),
      error: (text) => console.error(text),
    });
  }

  begin(graph) {
    const same = this.graph && this.graph.run_id === graph.run_id;
    this.graph = graph;
    this.setState("waiting");
    byId("failure").hidden = true;
    if (same) return;
    this.playback = new Playback(graph.recording);
    this.objects = {};
    this.moving = null;
    const title = graph.recording ? graph.recording.file : graph.name;
    document.title = `${title} \u00b7 EVIS`;
    byId("run").textContent = byId("run").title = title;
    const before = this.recall();
    this.env = Math.min(before?.env ?? 0, graph.envs - 1);
    this.list();
    this.openAll(before?.specs || opening(graph.topics));
    this.changed();
  }

  /** What an earlier visit in this tab left: {env, specs} with the panels whose topics this graph has; null for none. */
  recall() {
    try {
      const { env, specs } = JSON.parse(sessionStorage.getItem(this.memory()));
      return { env, specs: specs.filter((s) => SYSTEM[s.id] || this.graph.topics.some((t) => t.name === s.topic && s.view in t.views)) };
    } catch {
      return null;
    }
  }

  remember() {
    const specs = [...this.panels.map((p) => p.spec), ...this.pending];
    sessionStorage.setItem(this.memory(), JSON.stringify({ env: this.env, specs }));
  }

  memory() {
    return `evis:${this.graph.name}:${this.graph.recording?.file ?? ""}:${this.graph.topics.flatMap((t) => t.asked)}`;
  }

  openAll(specs) {
    for (const panel of this.panels) panel.root.remove();
    this.panels = [];
    this.pending = specs.filter((spec) => spec.pending);
    this.pending.forEach((spec) => (spec.before ||= specs.slice(specs.indexOf(spec) + 1).map((s) => s.id)));
    for (const spec of specs) if (!spec.pending) this.open(spec);
  }

  /** The first part with something to show, of a panel that was to open only then. Returns the panel. */
  arrive(part) {
    const spec = this.pending.find((s) => wireId(s) === part.panel);
    if (!spec || !(part.bytes || part.tables?.length)) return undefined; // the message has nothing of the kind
    const beside = this.panels.filter((p) => p.spec.topic === spec.topic).length;
    if (!part.bytes && !beside && !spec.late) {
      spec.late = true; // pictures of the same message may come with the next bundle, and a table is for where none do
      return undefined;
    }
    this.pending = this.pending.filter((s) => s !== spec);
    if (beside < (spec.most ?? Infinity)) {
      delete spec.pending;
      this.open(spec, spec.before.map((id) => this.panels.find((p) => p.spec.id === id)).find(Boolean));
    }
    this.changed();
    return this.panelOf(part);
  }

  /** A further panel of a topic, under a name of its own. */
  another(topic) {
    const spec = { ...specOf(topic), env: this.env, pending: false };
    for (let n = 2; this.panels.some((p) => p.spec.id === spec.id); n++) spec.id = `${topic.name} ${n}`;
    return spec;
  }

  /** next: the panel that it stands before; at the end without one. */
  open(spec, next = null) {
    const topic = this.topic(spec.topic);
    const Kind = topic ? KINDS[topic.views[spec.view]] : SYSTEM[spec.id]?.[1];
    if (!Kind) return;
    const panel = new Kind(this, spec, topic);
    panel.kind = Kind;
    this.panels.splice(next ? this.panels.indexOf(next) : this.panels.length, 0, panel);
    byId("panels").insertBefore(panel.root, next ? next.root : null);
  }

  close(panel) {
    const { id, topic } = panel.spec;
    if (panel.root.contains(document.activeElement)) this.buttons[topic ?? id].focus(); // the button that opens it again
    panel.root.remove();
    this.panels = this.panels.filter((p) => p !== panel);
    this.changed();
  }

  /** After any change of what is open: rebuild panels whose view is of another kind, tell the node, mark the list. */
  changed() {
    if (!this.graph) return;
    this.panels.forEach((panel, i) => {
      const topic = this.topic(panel.spec.topic);
      const Kind = topic && KINDS[topic.views[panel.spec.view]];
      if (!Kind || Kind === panel.kind) return;
      const fresh = new Kind(this, panel.spec, topic);
      fresh.kind = Kind;
      const focus = panel.root.contains(document.activeElement) ? document.activeElement.title : "";
      panel.root.replaceWith(fresh.root);
      this.panels[i] = fresh;
      fresh.bar.querySelector(`[title="${focus}"]`)?.focus(); // who steps through the views by keys goes on from here
    });
    this.remember();
    this.wire.show(document.hidden ? [] : [...this.panels.flatMap((p) => p.subscriptions()), ...this.helpers()]);
    for (const [key, button] of Object.entries(this.buttons)) {
      button.ariaPressed = String(this.panels.some((p) => p.spec.id === key || p.spec.topic === key));
    }
    byId("hint").hidden = this.panels.length + this.pending.length > 0;
  }

  /** What no panel shows: what panels that are to open with their first message wait for; descriptions of the cameras;
   * and which bodies move, while there are boxes. */
  helpers() {
    const waited = this.pending.map((s) => ({ id: wireId(s), topic: s.topic, view: s.view, env: s.env }));
    const cameras = new Set([...this.panels.map((p) => p.spec), ...this.pending].map((s) => this.topic(s.topic)?.camera));
    const infos = this.graph.topics.filter((t) => t.type === "CameraInfo" && cameras.has(t.camera))
      .map((t) => ({ id: `info:${t.camera}`, topic: t.name, view: "camera", env: 0 }));
    const state = this.graph.topics.find((t) => t.type === "WorldState" && !t.dormant);
    const moving = state && this.panels.some((p) => p.spec.boxes) ? [{ id: "moving:", topic: state.name, view: "moving", env: 0 }] : [];
    return [...waited, ...infos, ...moving];
  }

  topic(name) {
    return this.graph.topics.find((t) => t.name === name);
  }

  objectsOf(camera) {
    return (this.objects[camera] ||= new Objects());
  }

  when(part) {
    return this.playback.when(part);
  }

  list() {
    const nav = byId("topics");
    this.buttons = {};
    nav.replaceChildren();
    if (this.graph.envs > 1) {
      const options = Array.from({ length: this.graph.envs }, (_, i) => [String(i), String(i)]);
      nav.append(make("label", {}, "environment", choice(options, String(this.env), (value) => {
        this.env = Number(value);
        const specs = [...this.panels.map((p) => p.spec), ...this.pending];
        for (const spec of specs) if (spec.topic) spec.env = this.env;
        this.openAll(specs);
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
        nav.append(make("h2", { textContent: camera || "world", title: camera }));
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
      this.pending = this.pending.filter((spec) => spec.topic !== key);
      this.open(topic ? this.another(topic) : { id: key });
      this.changed();
      document.body.classList.remove("toggled");
      this.panels.at(-1).root.scrollIntoView({ block: "nearest" });
    }
  }

  panelOf(part) {
    return this.panels.find((p) => p.subscriptions().some((s) => s.id === part.panel));
  }

  draw(part) {
    if (part.kind === "status") return this.status(part);
    if (part.panel.startsWith("info:")) {
      const camera = part.panel.slice(5);
      this.objectsOf(camera).describe(part);
      this.panels.filter((p) => this.topic(p.spec.topic)?.camera === camera).forEach((p) => p.renamed());
      if (this.isPlayed(this.graph.topics.find((t) => t.type === "CameraInfo" && t.camera === camera))) this.playback.begins(part.t);
      return;
    }
    if (part.panel === "moving:") {
      this.moving = new Set(part.moving);
      return;
    }
    const panel = this.panelOf(part);
    if (!panel) return;
    panel.draw(part);
    if (this.isPlayed(this.topic(panel.spec.topic))) this.playback.saw(part);
    if (this.state !== "quiet") this.setState(this.running()); // a description that is kept is no news
  }

  /** Whether a topic is of the recording whose place is shown: another one may have other times. */
  isPlayed(topic) {
    return topic.node === this.graph.recording?.node;
  }

  running() {
    return this.graph.recording ? "recording" : "live";
  }

  status(status) {
    this.quiet = status.quiet_s;
    if (status.state === "finished") this.end(status.failure);
    else if (status.quiet_s !== null) this.setState(status.quiet_s > QUIET_S ? "quiet" : this.running());
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

  /** failure: what ended the run before its time; empty where it came to its end. */
  end(failure) {
    this.setState(failure ? "failed" : "finished");
    byId("failure").textContent = failure;
    byId("failure").hidden = !failure;
  }

  setState(state) {
    // What was sent before the end may be drawn after it; only a graph that says hello begins anew.
    if (["finished", "failed"].includes(this.state) && state !== "waiting") return;
    this.state = state;
    const texts = { recording: this.playback.text(), live: "live", quiet: `no data for ${Math.floor(this.quiet)} s`, waiting: "waiting for data", finished: "run has ended", failed: "run has failed", closed: "not connected", connecting: "connecting" };
    const element = byId("state");
    element.dataset.state = state;
    if (element.textContent !== texts[state]) element.textContent = texts[state];
  }
}

globalThis.evis = new App();
