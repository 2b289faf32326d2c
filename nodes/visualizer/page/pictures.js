// Panels that show pictures: images (JPEG or PNG from the node) and events (words that are drawn here, fading with time).

import { choice, duration, make, si } from "./dom.js";
import { CHANNELS, drawRamp, drawWheel } from "./palette.js";
import { StagePanel, chip } from "./panel.js";
import { Surface } from "./surface.js";

const PHOTOGRAPHS = ["Keyframe", "Frames", "Image"];

export class ImagePanel extends StagePanel {
  constructor(app, spec, topic) {
    super(app, spec, topic);
    this.canvas.classList.toggle("smooth", PHOTOGRAPHS.includes(topic.type));
    this.finishBar();
  }

  async prepare(part) {
    if (part.kind === "image" && part.bytes) part.bitmap = await createImageBitmap(new Blob([part.payload], { type: `image/${part.format}` }));
  }

  draw(part) {
    if (part.kind === "table") return this.takeBoxes(part);
    if (!part.bitmap) {
      this.waiting.hidden = false;
      this.waiting.textContent = part.note || "empty";
      return;
    }
    // Setting a canvas's size clears it: do so only together with drawing, so that nothing flickers.
    if (this.resize(part.width, part.height)) this.context.imageSmoothingEnabled = false;
    this.context.drawImage(part.bitmap, 0, 0, part.width, part.height);
    part.bitmap.close();
    const named = part.instances || part.classes;
    const count = named ? `   ${named.shown.length + named.more} ${part.instances ? "instances" : "classes"}` : "";
    this.describe(part, `${part.width} \u00d7 ${part.height}${count}`);
    this.explain(part);
  }

  explain({ legend, instances, classes }) {
    const key = legend ? legend.kind : instances || classes ? "named" : "";
    if (key !== this.legendKey) {
      this.legendKey = key;
      this.listed = null; // what stood here is gone
      this.scale = make("canvas");
      this.from = make("span");
      this.to = make("span");
      this.legend.className = key === "named" ? "instances" : "legend";
      this.legend.replaceChildren(...(legend ? [this.from, this.scale, this.to] : []));
      if (key === "depth") drawRamp(this.scale);
      if (key === "flow") drawWheel(this.scale);
    }
    if (key === "depth") this.from.textContent = metres(legend.from);
    if (legend) this.to.textContent = key === "depth" ? metres(legend.to) : `${si(legend.to)} ${legend.unit}`;
    this.named = key === "named" ? [instances || classes, Boolean(instances)] : null;
    if (this.named) this.listNames(...this.named);
  }

  /** The names of what is in the picture, and how many more there are. Only news is written: a list is scrolled. */
  listNames({ shown, more }, ofInstances) {
    const objects = this.app.objectsOf(this.topic.camera);
    const names = shown.map(([id, colour]) => [ofInstances ? objects.name(id) : objects.kind(id)[0], colour]);
    const listed = JSON.stringify([names, more]);
    if (listed === this.listed) return;
    this.listed = listed;
    const rest = more ? [make("span", { className: "more", textContent: `... and ${more} more` })] : [];
    this.legend.replaceChildren(...names.map(([name, colour]) => chip(name, colour)), ...rest);
  }

  renamed() {
    super.renamed();
    if (this.named) this.listNames(...this.named);
  }
}

const metres = (z) => (typeof z === "number" ? `${z.toPrecision(3)} m` : "far");

const FADES = [["auto", "auto"], ["0.001", "1 ms"], ["0.005", "5 ms"], ["0.01", "10 ms"], ["0.033", "33 ms"], ["0.1", "100 ms"],
  ["0.5", "0.5 s"], ["0", "packet"]];

export class EventsPanel extends StagePanel {
  constructor(app, spec, topic) {
    super(app, spec, topic);
    spec.fade ||= "auto";
    this.bar.append(choice(FADES, spec.fade, (value) => {
      spec.fade = value;
      app.remember();
    }, "Time constant by which events fade, in the graph's time; auto: by how dense they are"));
    this.finishBar();
    this.last = { t: 0, episode: -1 };
    this.explain({});
  }

  /** What the colours stand for: polarities, or the channels of a colour sensor. */
  explain({ colour, events, on }) {
    const share = events ? `${Math.round((100 * on) / events)} % ON` : "ON";
    const channels = () => CHANNELS.map(([name, rgb]) => chip(name, `rgb(${rgb})`));
    this.legend.replaceChildren(
      ...(colour ? [...channels(), `${share}, OFF darker`] : [chip(share, "var(--on)"), chip("OFF", "var(--off)")]));
  }

  draw(part) {
    if (part.kind === "table") return this.takeBoxes(part);
    const width = Math.max(part.width, 1), height = Math.max(part.height, 1);
    if (this.resize(width, height) || !this.surface) {
      this.surface = new Surface(width, height);
      this.image = this.context.createImageData(width, height);
      this.words = new Uint32Array(this.image.data.buffer);
    }
    const tau = this.take(part);
    this.surface.paint(this.words, part.t, tau);
    this.context.putImageData(this.image, 0, 0);
    const rate = part.span > 0 ? `${si(part.events / part.span, "ev/s")}` : "";
    const drawn = [`${si(part.events)} events`, rate, tau === Infinity ? "newest packet" : `window ${duration(tau)}`];
    this.explain(part);
    if (part.lost) part.note = [part.note, `${part.lost} lost at the source`].filter(Boolean).join(", ");
    if (part.undrawn) part.note = [part.note, `${si(part.undrawn)} not drawn`].filter(Boolean).join(", ");
    this.describe(part, drawn.filter(Boolean).join("   "));
  }

  /** Events onto the surface; another episode, or a jump back, starts from black. Returns the fading's time constant. */
  take(part) {
    const { fade } = this.spec;
    if (part.episode !== this.last.episode || part.t < this.last.t || fade === "0") this.surface.clear();
    this.last = part;
    const at = part.payload.byteOffset, n = part.bytes / 6;
    const words = new Uint32Array(part.payload.buffer, at, n);
    this.surface.add(words, new Uint16Array(part.payload.buffer, at + 4 * n, n), part.oldest, part.t);
    if (fade === "auto") return this.surface.expose(part.t);
    return fade === "0" ? Infinity : Number(fade);
  }
}
