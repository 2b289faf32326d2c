// Panels that show pictures: images (JPEG from the node) and events (words that are drawn here, fading with time).

import { choice, make, si } from "./dom.js";
import { channelColours, drawRamp, drawWheel, eventColours } from "./palette.js";
import { StagePanel } from "./panel.js";

const PHOTOGRAPHS = ["Keyframe", "Frames", "Image"];

export class ImagePanel extends StagePanel {
  constructor(app, spec, topic) {
    super(app, spec, topic);
    this.canvas.classList.toggle("smooth", PHOTOGRAPHS.includes(topic.type));
    this.finishBar();
  }

  async prepare(part) {
    if (part.kind === "image" && part.bytes) part.bitmap = await createImageBitmap(new Blob([part.payload], { type: "image/jpeg" }));
  }

  draw(part) {
    if (part.kind === "table") return this.drawBoxes(part.boxes);
    if (!part.bitmap) {
      this.waiting.hidden = false;
      this.waiting.textContent = part.note || "empty";
      return;
    }
    // Setting a canvas's size clears it: do so only together with drawing, so that nothing flickers.
    if (this.resize(part.width, part.height)) this.context.imageSmoothingEnabled = false;
    this.context.drawImage(part.bitmap, 0, 0, part.width, part.height);
    part.bitmap.close();
    this.describe(part, `${part.width} \u00d7 ${part.height}`);
    if (part.boxes) this.drawBoxes(part.boxes);
    this.explain(part);
  }

  explain({ legend, instances }) {
    const key = legend ? legend.kind : instances ? "instances" : "";
    if (key !== this.legendKey) {
      this.legendKey = key;
      this.scale = make("canvas");
      this.from = make("span");
      this.to = make("span");
      this.legend.className = key === "instances" ? "instances" : "legend";
      this.legend.replaceChildren(...(legend ? [this.from, this.scale, this.to] : []));
      if (key === "depth") drawRamp(this.scale);
      if (key === "flow") drawWheel(this.scale);
    }
    if (key === "depth") this.from.textContent = metres(legend.from);
    if (legend) this.to.textContent = key === "depth" ? metres(legend.to) : `${si(legend.to)} ${legend.unit}`;
    if (instances) {
      this.legend.replaceChildren(...instances.filter(([id]) => id !== 0).map(([id, colour]) => {
        const dot = make("i");
        dot.style.background = colour;
        return make("span", {}, dot, this.app.instanceName(this.topic.camera, id));
      }));
    }
  }
}

const metres = (z) => (typeof z === "number" ? `${z.toPrecision(3)} m` : "far");

const FADES = [["0.005", "5 ms"], ["0.01", "10 ms"], ["0.033", "33 ms"], ["0.1", "100 ms"], ["0.5", "0.5 s"], ["0", "none"]];

export class EventsPanel extends StagePanel {
  constructor(app, spec, topic) {
    super(app, spec, topic);
    spec.fade ||= "0.033";
    this.bar.append(choice(FADES, spec.fade, (value) => {
      spec.fade = value;
      app.remember();
    }, "Time constant by which events fade, in the graph's time"));
    this.finishBar();
    this.last = { t: 0, episode: -1 };
    this.undrawn = 0;
    this.legend.append(...[["ON", "--on"], ["OFF", "--off"]].map(([text, colour]) => {
      const dot = make("i");
      dot.style.background = `var(${colour})`;
      return make("span", {}, dot, text);
    }));
  }

  draw(part) {
    if (part.kind === "table") return this.drawBoxes(part.boxes);
    const width = Math.max(part.width, 1), height = Math.max(part.height, 1);
    if (this.resize(width, height) || !this.value) {
      this.value = new Float32Array(width * height);
      this.channel = null;
      this.image = this.context.createImageData(width, height);
      this.words = new Uint32Array(this.image.data.buffer);
    }
    this.fade(part);
    this.add(new Uint32Array(part.payload.buffer, part.payload.byteOffset, part.bytes / 4), width);
    this.paint();
    this.undrawn += part.undrawn;
    const rate = part.span > 0 ? `${si(part.events / part.span, "ev/s")}` : "";
    const drawn = [`${si(part.events)} events`, rate, part.events ? `${Math.round((100 * part.on) / part.events)} % ON` : ""];
    if (part.lost) part.note = [part.note, `${part.lost} lost at the source`].filter(Boolean).join(", ");
    if (part.undrawn) part.note = [part.note, `${si(part.undrawn)} not drawn`].filter(Boolean).join(", ");
    this.describe(part, drawn.filter(Boolean).join("   "));
  }

  /** Exponential decay in the data's own time; another episode, or a jump back, starts from black. */
  fade(part) {
    const tau = Number(this.spec.fade);
    const dt = part.t - this.last.t;
    if (part.episode !== this.last.episode || dt < 0 || tau === 0) this.value.fill(0);
    else {
      const factor = Math.exp(-dt / tau);
      for (let i = 0; i < this.value.length; i++) this.value[i] *= factor;
    }
    this.last = part;
  }

  add(words, width) {
    for (const w of words) {
      const at = (w & 0x3fff) + ((w >>> 14) & 0x3fff) * width;
      this.value[at] = w >>> 31 ? 1 : -1;
      const channel = (w >>> 28) & 3;
      if (channel) {
        this.channel ||= new Uint8Array(this.value.length);
        this.channel[at] = channel;
      }
    }
  }

  paint() {
    const { value, words, channel } = this;
    for (let i = 0; i < value.length; i++) {
      const index = (value[i] * 127 + 127.5) | 0;
      words[i] = channel && channel[i] ? channelColours[channel[i] - 1][index] : eventColours[index];
    }
    this.context.putImageData(this.image, 0, 0);
  }
}
