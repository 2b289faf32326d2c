// What all panels have: a title bar with their choices, a body, a foot; and the pictures' stage with its overlay.

import { choice, make, seconds } from "./dom.js";

/** Names what a panel shows, so that a part that was on its way when the choice changed is not taken for the new one. */
const wireId = (id, view, env) => `${id} ${view} ${env}`;

export class Panel {
  /** app: {graph, changed(), close(panel), boxesOf(camera, env)}. spec: {id, topic, view, env, ...}. */
  constructor(app, spec, title) {
    this.app = app;
    this.spec = spec;
    this.bar = make("div", { className: "bar" }, make("b", { textContent: title, title }), make("span", { className: "space" }));
    this.body = make("div");
    this.foot = make("div", { className: "foot" });
    this.root = make("section", { className: "panel" }, this.bar, this.body, this.foot);
    this.root.dataset.panel = spec.id;
  }

  finishBar() {
    this.bar.append(make("button", { className: "plain", textContent: "\u00d7", title: "Close", ariaLabel: "Close", onclick: () => this.app.close(this) }));
  }

  addChoice(options, key, title) {
    if (options.length < 2) return;
    this.bar.append(choice(options, String(this.spec[key]), (value) => {
      this.spec[key] = typeof this.spec[key] === "number" ? Number(value) : value;
      this.app.changed();
    }, title));
  }

  addTopicChoices(topic) {
    const views = Object.entries(topic.views).filter(([, kind]) => kind !== "boxes");
    this.addChoice(views.map(([v]) => [v, v]), "view", "View");
    this.addChoice(Array.from({ length: this.app.graph.envs }, (_, i) => [String(i), `env ${i}`]), "env", "Environment");
  }

  /** What the node is asked for: the panel's own topic, and what lies over it. */
  subscriptions() {
    const { id, topic, view, env } = this.spec;
    return topic ? [{ id: wireId(id, view, env), topic, view, env }] : [];
  }

  async prepare() {}
  draw() {}
  status() {}
  refused(text) {
    if (text && this.waiting) this.waiting.textContent = text;
  }
}

/** A panel whose body is a picture: subclasses paint `canvas`, this draws the boxes over it. */
export class StagePanel extends Panel {
  constructor(app, spec, topic) {
    super(app, spec, topic.name);
    this.topic = topic;
    this.canvas = make("canvas", { width: 4, height: 3 });
    this.overlay = make("canvas", { width: 4, height: 3 });
    this.waiting = make("div", { className: "waiting", textContent: topic.dormant ? "starting the node" : "waiting for the first message" });
    this.body.className = "stage";
    this.body.append(this.canvas, this.overlay, this.waiting);
    this.time = make("span");
    this.facts = make("span");
    this.note = make("span", { className: "note" });
    this.legend = make("span", { className: "legend" });
    this.foot.append(this.time, this.facts, this.note, this.legend);
    this.context = this.canvas.getContext("2d", { alpha: false });
    this.context.fillStyle = "#0a0c10";
    this.context.fillRect(0, 0, 4, 3);
    this.addTopicChoices(topic);
    this.labels = app.graph.topics.find((t) => t.camera === topic.camera && t.type === "Labels");
    if (this.labels && topic.type !== "Labels") {
      const box = make("input", { type: "checkbox", checked: Boolean(spec.boxes), onchange: () => {
        spec.boxes = box.checked;
        if (!box.checked) this.drawBoxes([]);
        this.app.changed();
      } });
      this.bar.append(make("label", { title: "Bounding boxes of the labels" }, box, "boxes"));
    }
  }

  subscriptions() {
    const own = super.subscriptions();
    const { id, env, boxes } = this.spec;
    return boxes && this.labels ? [...own, { id: wireId(id, "boxes", env), topic: this.labels.name, view: "boxes", env }] : own;
  }

  resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height) return false;
    this.canvas.width = width;
    this.canvas.height = height;
    this.body.style.aspectRatio = `${width} / ${height}`;
    return true;
  }

  describe(part, facts) {
    this.waiting.hidden = true;
    this.time.textContent = seconds(part.t) + (part.episode ? `  episode ${part.episode}` : "");
    this.facts.textContent = facts;
    this.note.textContent = part.note || "";
  }

  /** boxes: [[id, colour, x0, y0, x1, y1]] in pixels, inclusive; drawn at twice the sensor's resolution to stay thin. */
  drawBoxes(boxes) {
    this.overlay.width = this.canvas.width * 2;
    this.overlay.height = this.canvas.height * 2;
    const context = this.overlay.getContext("2d");
    context.lineWidth = 2;
    context.font = "600 18px system-ui, sans-serif";
    for (const [id, colour, x0, y0, x1, y1] of boxes) {
      context.strokeStyle = context.fillStyle = colour;
      context.strokeRect(2 * x0, 2 * y0, 2 * (x1 - x0 + 1), 2 * (y1 - y0 + 1));
      const label = this.app.instanceName(this.topic.camera, id);
      context.fillText(label, 2 * x0 + 4, 2 * y0 > 22 ? 2 * y0 - 6 : 2 * y0 + 20);
    }
  }
}
