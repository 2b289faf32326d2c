// Bounding boxes over a picture: a canvas with the outlines, a tag with the name of the one under the pointer.

import { make } from "./dom.js";
import { boxAt } from "./objects.js";

export class Boxes {
  /** objects: what the instances are. stage: the element that the picture's canvas fills. */
  constructor(objects, stage, canvas) {
    this.objects = objects;
    this.stage = stage;
    this.picture = canvas;
    this.overlay = make("canvas", { className: "boxes", width: 4, height: 3 });
    this.tag = make("span", { className: "tag", hidden: true });
    this.drawn = [];
    this.pointer = null;
    stage.append(this.overlay, this.tag);
    stage.addEventListener("pointermove", (event) => this.point(event));
    stage.addEventListener("pointerdown", (event) => this.point(event));
    stage.addEventListener("pointerleave", () => this.point(null));
  }

  /** options: {still, moving}, as Objects.choose takes them. Returns how many are left out. */
  draw(boxes, options) {
    const { chosen, left } = this.objects.choose(boxes, options);
    this.drawn = chosen;
    this.paint();
    return left;
  }

  /** Twice the sensor's resolution keeps the lines thin. */
  paint() {
    const { overlay, picture } = this;
    overlay.width = picture.width * 2;
    overlay.height = picture.height * 2;
    const context = overlay.getContext("2d");
    const found = this.pointer && boxAt(this.drawn, ...this.place(this.pointer));
    for (const box of this.drawn) {
      context.strokeStyle = box.colour;
      context.lineWidth = box === found ? 5 : 2;
      context.strokeRect(2 * box.x0, 2 * box.y0, 2 * (box.x1 - box.x0 + 1), 2 * (box.y1 - box.y0 + 1));
    }
    this.say(found);
  }

  point(event) {
    this.pointer = event;
    if (this.drawn.length || !this.tag.hidden) this.paint();
  }

  /** The scale of the picture in the stage, which it fills as far as its aspect allows, and its top left corner. */
  fit() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    const scale = Math.min(width / this.picture.width, height / this.picture.height);
    return { scale, left: (width - scale * this.picture.width) / 2, top: (height - scale * this.picture.height) / 2 };
  }

  /** Where a pointer is, in pixels of the picture. */
  place(event) {
    const { left: x, top: y } = this.stage.getBoundingClientRect();
    const { scale, left, top } = this.fit();
    return [(event.clientX - x - left) / scale, (event.clientY - y - top) / scale];
  }

  say(box) {
    this.tag.hidden = !box;
    if (!box) return;
    const name = this.objects.name(box.id);
    this.tag.textContent = name === box.kind ? name : `${name} (${box.kind})`;
    this.tag.style.borderColor = box.colour;
    const { scale, left, top } = this.fit();
    const limit = (value, most) => `${Math.max(0, Math.min(value, most))}px`;
    this.tag.style.left = limit(left + scale * box.x0, this.stage.clientWidth - this.tag.offsetWidth);
    this.tag.style.top = limit(top + scale * box.y0 - this.tag.offsetHeight - 2, this.stage.clientHeight - this.tag.offsetHeight);
  }
}
