// What the boxes over a picture stand for: name, class and colour of an instance, and which boxes are worth drawing.

/** A box whose longer side is shorter is not drawn [px of the sensor]. */
export const LEAST_PX = 10;

export class Objects {
  constructor() {
    this.names = [];
    this.bodies = [];
    this.semantic = [];
    this.classes = [];
  }

  /** part: a camera's description, as the node sends it. */
  describe({ names, bodies, semantic, classes }) {
    Object.assign(this, { names, bodies, semantic, classes });
  }

  name(id) {
    return this.names[id] || `id ${id}`;
  }

  /** [name, colour] of a class id. */
  kind(number) {
    return this.classes[number] || [`class ${number}`, "#8d95a8"];
  }

  /** [name, colour] of an instance's class; of the instance itself where the camera tells no classes. */
  kindOf(id, colour) {
    const number = this.semantic[id];
    return number in this.classes ? this.classes[number] : [this.name(id), colour];
  }

  /** Whether an instance is a part of the world, or of a body that has not moved. moving: Set of names, or null. */
  isStatic(id, moving) {
    const body = this.bodies[id];
    return body === "" || (body !== undefined && moving !== null && !moving.has(body));
  }

  /** The boxes to draw, large ones first: [{id, kind, colour, x0, y0, x1, y1}]; and how many are left out, and why. */
  choose(boxes, { still, moving }) {
    const chosen = [], left = { still: 0, small: 0 };
    for (const [id, own, x0, y0, x1, y1] of boxes) {
      const [kind, colour] = this.kindOf(id, own);
      if (!still && this.isStatic(id, moving)) left.still++;
      else if (Math.max(x1 - x0, y1 - y0) + 1 < LEAST_PX) left.small++;
      else chosen.push({ id, kind, colour, x0, y0, x1, y1 });
    }
    const area = (b) => (b.x1 - b.x0 + 1) * (b.y1 - b.y0 + 1);
    chosen.sort((a, b) => area(b) - area(a));
    return { chosen, left };
  }
}

/** The smallest box around a place; boxes as `choose` gives them. */
export function boxAt(boxes, x, y) {
  return boxes.findLast((b) => x >= b.x0 - 1 && x <= b.x1 + 2 && y >= b.y0 - 1 && y <= b.y1 + 2);
}
