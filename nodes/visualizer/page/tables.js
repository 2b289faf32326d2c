// Panels of numbers: tables as the node sends them, and inertial samples as curves.

import { make, seconds, table } from "./dom.js";
import { Panel, waitingText } from "./panel.js";

export class TablePanel extends Panel {
  constructor(app, spec, topic) {
    super(app, spec, topic.name);
    if (topic.type === "WorldState" || topic.type === "Labels") this.root.classList.add("double");
    this.addTopicChoices(topic);
    this.finishBar();
    this.waiting = make("p", { className: "lines", textContent: waitingText(topic) });
    this.body.className = "scroll";
    this.body.append(this.waiting);
  }

  draw(part) {
    this.body.replaceChildren(...part.tables.map(table));
    if (!part.tables.length) this.body.append(make("p", { className: "lines", textContent: "nothing of this kind in the messages" }));
    this.foot.textContent = this.app.when(part);
  }
}

const WIDTH = 760, HEIGHT = 570, RIGHT = 14, GAP = 8;
const AXES = [["x", "#ef6b6b"], ["y", "#5fc98f"], ["z", "#55a8ff"]];

export class SeriesPanel extends Panel {
  constructor(app, spec, topic) {
    super(app, spec, topic.name);
    this.addTopicChoices(topic);
    this.finishBar();
    this.canvas = make("canvas", { className: "smooth", width: WIDTH, height: HEIGHT });
    this.waiting = make("div", { className: "waiting", textContent: waitingText(topic) });
    this.body.className = "stage idle";
    this.body.append(this.canvas, this.waiting);
  }

  draw({ samples, groups, t }) {
    this.waiting.hidden = samples.length > 0;
    this.body.classList.toggle("idle", !samples.length);
    const context = this.canvas.getContext("2d");
    context.clearRect(0, 0, WIDTH, HEIGHT);
    context.font = "20px system-ui, sans-serif";
    context.lineWidth = 2;
    const tall = HEIGHT / groups.length;
    const axes = groups.map(([, columns]) => extent(samples, columns));
    // What stands beside the widest of the numbers has room for it.
    const left = GAP + Math.ceil(Math.max(...axes.flatMap((axis) => axis.texts.map((text) => context.measureText(text).width)))) + GAP;
    groups.forEach(([title, columns], g) => this.curves(context, samples, columns, title, axes[g], left, g * tall + 40, tall - 60));
    this.foot.textContent = `${seconds(t)}, ${samples.length} samples`;
  }

  curves(context, samples, columns, title, { low, high, texts }, left, top, tall) {
    const span = high - low || 1, wide = WIDTH - left - RIGHT;
    const t0 = samples.length ? samples[0][0] : 0, t1 = samples.length ? samples.at(-1)[0] : 1;
    const x = (t) => left + ((t - t0) / (t1 - t0 || 1)) * wide;
    const y = (v) => top + tall - ((v - low) / span) * tall;
    context.fillStyle = "#8d95a8";
    context.fillText(title, left, top - 12);
    context.textAlign = "right";
    context.fillText(texts[0], left - GAP, top + 14);
    context.fillText(texts[1], left - GAP, top + tall);
    context.textAlign = "left";
    context.strokeStyle = "#2a2f3d";
    context.strokeRect(left, top, wide, tall);
    columns.forEach((column, i) => {
      context.strokeStyle = context.fillStyle = AXES[i][1];
      context.fillText(AXES[i][0], WIDTH - 84 + 26 * i, top - 12);
      context.beginPath();
      for (const s of samples) if (typeof s[column] === "number") context.lineTo(x(s[0]), y(s[column]));
      context.stroke();
    });
  }
}

/** The range of some columns, with 0, and how its ends are written, the upper one first. */
function extent(samples, columns) {
  const values = samples.flatMap((s) => columns.map((c) => s[c])).filter((v) => typeof v === "number");
  const low = Math.min(...values, 0), high = Math.max(...values, 0);
  return { low, high, texts: [limit(high, low), limit(low, high)] };
}

// One end of an axis in few digits; what is nothing beside the other end is 0.
function limit(value, other) {
  if (Math.abs(value) < 1e-6 * Math.abs(other) || Math.abs(value) < 1e-12) return "0";
  const size = Math.abs(value);
  return size >= 1e-3 && size < 1e5 ? value.toPrecision(3) : value.toExponential(1);
}
