// Panels of numbers: tables as the node sends them, and inertial samples as curves.

import { make, seconds, table } from "./dom.js";
import { Panel } from "./panel.js";

export class TablePanel extends Panel {
  constructor(app, spec, topic) {
    super(app, spec, topic.name);
    if (topic.type === "WorldState" || topic.type === "Labels") this.root.classList.add("double");
    this.addTopicChoices(topic);
    this.finishBar();
    this.waiting = make("p", { className: "lines", textContent: "waiting for the first message" });
    this.body.className = "scroll";
    this.body.append(this.waiting);
  }

  draw(part) {
    this.body.replaceChildren(...part.tables.map(table));
    if (!part.tables.length) this.body.append(make("p", { className: "lines", textContent: "nothing of this kind in the messages" }));
    this.foot.textContent = seconds(part.t) + (part.episode ? `  episode ${part.episode}` : "");
  }
}

const WIDTH = 760, HEIGHT = 570, LEFT = 78;
const AXES = [["x", "#ef6b6b"], ["y", "#5fc98f"], ["z", "#55a8ff"]];

export class SeriesPanel extends Panel {
  constructor(app, spec, topic) {
    super(app, spec, topic.name);
    this.addTopicChoices(topic);
    this.finishBar();
    this.canvas = make("canvas", { className: "smooth", width: WIDTH, height: HEIGHT });
    this.waiting = make("div", { className: "waiting", textContent: "waiting for the first message" });
    this.body.className = "stage";
    this.body.append(this.canvas, this.waiting);
  }

  draw({ samples, groups, t }) {
    this.waiting.hidden = samples.length > 0;
    const context = this.canvas.getContext("2d");
    context.clearRect(0, 0, WIDTH, HEIGHT);
    context.font = "20px system-ui, sans-serif";
    context.lineWidth = 2;
    const tall = HEIGHT / groups.length;
    groups.forEach(([title, columns], g) => this.curves(context, samples, columns, title, g * tall + 40, tall - 60));
    this.foot.textContent = `${seconds(t)}, ${samples.length} samples`;
  }

  curves(context, samples, columns, title, top, tall) {
    const values = samples.flatMap((s) => columns.map((c) => s[c])).filter((v) => typeof v === "number");
    const low = Math.min(...values, 0), high = Math.max(...values, 0), span = high - low || 1;
    const t0 = samples.length ? samples[0][0] : 0, t1 = samples.length ? samples.at(-1)[0] : 1;
    const x = (t) => LEFT + ((t - t0) / (t1 - t0 || 1)) * (WIDTH - LEFT - 14);
    const y = (v) => top + tall - ((v - low) / span) * tall;
    context.fillStyle = "#8d95a8";
    context.fillText(title, LEFT, top - 12);
    context.textAlign = "right";
    context.fillText(limit(high, low), LEFT - 8, top + 14);
    context.fillText(limit(low, high), LEFT - 8, top + tall);
    context.textAlign = "left";
    context.strokeStyle = "#2a2f3d";
    context.strokeRect(LEFT, top, WIDTH - LEFT - 14, tall);
    columns.forEach((column, i) => {
      context.strokeStyle = context.fillStyle = AXES[i][1];
      context.fillText(AXES[i][0], WIDTH - 84 + 26 * i, top - 12);
      context.beginPath();
      for (const s of samples) if (typeof s[column] === "number") context.lineTo(x(s[0]), y(s[column]));
      context.stroke();
    });
  }
}

// One end of an axis in few digits; what is nothing beside the other end is 0.
function limit(value, other) {
  if (Math.abs(value) < 1e-6 * Math.abs(other) || Math.abs(value) < 1e-12) return "0";
  const size = Math.abs(value);
  return size >= 1e-3 && size < 1e5 ? value.toPrecision(3) : value.toExponential(1);
}
