// Boxes and pictures come by topics of their own, each at its own rate: which boxes belong to the picture that is shown.

/** Most sets of boxes that are kept for a picture that comes after them. */
const MOST = 16;

/** Less is rounding of stamps [s]. */
const SAME = 0.0005;

export class InTime {
  constructor() {
    this.kept = []; // {t, episode, boxes}
    this.picture = null; // {t, episode} of what is shown
  }

  take({ t, episode, boxes }) {
    this.kept = [...this.kept, { t, episode, boxes }].slice(-MOST);
  }

  shows({ t, episode }) {
    this.picture = { t, episode };
  }

  /** The boxes that are nearest in time to the picture, of its episode, and how much later they are than it [s]. */
  nearest() {
    const { picture, kept } = this;
    if (!picture) return { boxes: kept.at(-1)?.boxes ?? [], later: 0 };
    const apart = (set) => Math.abs(set.t - picture.t);
    const own = kept.filter((set) => set.episode === picture.episode);
    if (!own.length) return { boxes: [], later: 0 };
    const found = own.reduce((best, set) => (apart(set) <= apart(best) ? set : best));
    return { boxes: found.boxes, later: apart(found) < SAME ? 0 : found.t - picture.t };
  }

  clear() {
    this.kept = [];
  }
}
