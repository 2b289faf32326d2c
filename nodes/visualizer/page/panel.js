// What all panels have: a title bar with their choices, a body, a foot; and the pictures' stage with its boxes.

import { Boxes } from "./boxes.js";
import { choice, duration, make } from "./dom.js";
import { InTime } from "./in_time.js";
import { LEAST_PX } from "./objects.js";

/** Names what a panel shows, so that a part that was on its way when the choice changed is not taken for the new one. */
export const wireId = ({ id, view, env }) => `${id} ${view} ${env}`;

/** Kinds of views that are for other panels. */
const HELPERS = ["boxes", "moving"];

/** What a panel says that has got nothing yet. */
export function waitingText(topic) {
  if (topic.dormant) return "starting the node";
  return topic.sure ? "waiting for the first message" : "no message yet: not every camera or file has these";
}

/** A note of a few words under the picture. */
const counted = (n, what) => (n ? [`${n} ${what}`] : []);

/** A panel's title, of which the camera is cut where there is no room, not what tells its panels apart. */
function named(title) {
  const cut = Math.max(title.lastIndexOf("/"), 0);
  return make("b", { title }, make("span", { textContent: title.slice(0, cut) }), make("span", { textContent: title.slice(cut) }));
}

export class Panel {
  /** app: {graph, changed(), close(panel), when(part), objectsOf(camera), moving}. spec: {id, topic, view, env, ...}. */
  constructor(app, spec, title) {
    this.app = app;
    this.spec = spec;
    this.bar = make("div", { className: "bar" }, named(title), make("span", { className: "space" }));
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
    const views = Object.entries(topic.views).filter(([, kind]) => !HELPERS.includes(kind));
    this.addChoice(views.map(([v]) => [v, v]), "view", "View");
    const envs = topic.env === null ? this.app.graph.envs : 1; // of which there is one, there is no other to choose
    this.addChoice(Array.from({ length: envs }, (_, i) => [String(i), `env ${i}`]), "env", "Environment");
  }

  /** What the node is asked for: the panel's own topic, and what lies over it. */
  subscriptions() {
    const { topic, view, env } = this.spec;
    return topic ? [{ id: wireId(this.spec), topic, view, env }] : [];
  }

  async prepare() {}
  draw() {}
  status() {}
  /** What the camera's instances and classes are called has come, or is other than before. */
  renamed() {}
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
    this.waiting = make("div", { className: "waiting", textContent: waitingText(topic) });
    this.body.className = topic.sure ? "stage" : "stage idle";
    this.body.append(this.canvas);
    this.boxes = new Boxes(app.objectsOf(topic.camera), this.body, this.canvas);
    this.inTime = new InTime();
    this.body.append(this.waiting);
    this.time = make("span");
    this.facts = make("span");
    this.note = make("span", { className: "note" });
    this.legend = make("span", { className: "legend" });
    this.boxNote = make("span", { className: "box-note", hidden: true });
    this.foot.append(this.time, this.facts, this.note, this.legend, this.boxNote);
    this.context = this.canvas.getContext("2d", { alpha: false });
    this.context.fillStyle = "#0a0c10";
    this.context.fillRect(0, 0, 4, 3);
    this.addTopicChoices(topic);
    this.labels = app.graph.topics.find((t) => t.camera === topic.camera && t.type === "Labels" && "boxes" in t.views);
    if (this.labels) this.addBoxChoices();
  }

  addBoxChoices() {
    const add = (key, text, title, onchange) => {
      const box = make("input", { type: "checkbox", checked: Boolean(this.spec[key]), onchange: () => {
        this.spec[key] = box.checked;
        onchange();
      } });
      const label = make("label", { title }, box, text);
      this.bar.append(label);
      return label;
    };
    add("boxes", "boxes", "Bounding boxes of the labels, coloured by class", () => {
      this.still.hidden = !this.spec.boxes;
      this.inTime.clear();
      this.drawBoxes();
      this.app.changed();
    });
    this.still = add("still", "static", "Boxes of what has not moved too", () => {
      this.drawBoxes();
      this.app.remember();
    });
    this.still.hidden = !this.spec.boxes;
  }

  subscriptions() {
    const own = super.subscriptions();
    const { id, env, boxes } = this.spec;
    const over = { id: wireId({ id, view: "boxes", env }), topic: this.labels?.name, view: "boxes", env };
    return boxes && this.labels ? [...own, over] : own;
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
    this.body.classList.remove("idle");
    this.time.textContent = this.app.when(part);
    this.facts.textContent = facts;
    this.note.textContent = part.note || "";
    this.inTime.shows(part);
    if (this.labels && this.spec.boxes) this.drawBoxes();
  }

  /** part: {t, episode, boxes: [[id, colour, x0, y0, x1, y1]]}, the boxes in pixels, inclusive. */
  takeBoxes(part) {
    this.inTime.take(part);
    this.drawBoxes();
  }

  renamed() {
    if (this.spec.boxes) this.drawBoxes();
  }

  /** Those of the picture's time, or what is nearest to it, which is said. */
  drawBoxes() {
    const { boxes, later } = this.inTime.nearest();
    const left = this.boxes.draw(boxes, { still: Boolean(this.spec.still), moving: this.app.moving });
    const drawn = this.boxes.drawn;
    this.boxNote.hidden = !boxes.length;
    const kinds = [...new Map(drawn.map((b) => [b.kind, b.colour]))].sort(([a], [b]) => (a < b ? -1 : 1));
    const words = [`${drawn.length} ${drawn.length === 1 ? "box" : "boxes"}`, ...counted(left.still, "static not shown"), ...counted(left.small, `under ${LEAST_PX} px`)];
    if (later) words.push(`${duration(Math.abs(later))} ${later > 0 ? "after" : "before"} the picture`);
    this.boxNote.replaceChildren(words.join(", "), ...kinds.slice(0, MOST_KINDS).map(([kind, colour]) => chip(kind, colour)),
      ...counted(Math.max(0, kinds.length - MOST_KINDS), "more classes"));
  }
}

const MOST_KINDS = 12;

/** A spot of colour and what it stands for. */
export function chip(text, colour) {
  const spot = make("i");
  spot.style.background = colour;
  return make("span", { className: "chip" }, spot, text);
}
