// The newest event of each pixel: when, of which colour. Drawn with a brightness that falls by e per time constant.

import { GROUND_WORD, LAST, STEPS, eventColours } from "./palette.js";

const AGES = (1 << 16) - 1;
/** Only pixels with an event within this time count for the exposure [s]; it is the longest time constant too. */
const RECENT = 0.1;
const SHORTEST = 1e-4;
/** This share of the pixels that have had an event lately is to be at least half as bright as a new event. */
const BRIGHT = 0.4;
const SAMPLES = 8000, FEWEST = 20;
/** How far the time constant goes to a new one with each picture, so that the picture does not flicker. */
const RATE = 0.5;

export class Surface {
  constructor(width, height) {
    this.width = width;
    this.time = new Float64Array(width * height);
    this.colour = new Uint8Array(width * height); // polarity + 2 * (channel + 1), 0 = none
    this.clear();
  }

  clear() {
    this.time.fill(-Infinity);
    this.tau = 0;
  }

  /** words: x, y, colour and polarity, in the order of time; ages: in AGES-ths of `oldest` [s] before `end` [s]. */
  add(words, ages, oldest, end) {
    const { width, time, colour } = this;
    const scale = oldest / AGES;
    for (let i = 0; i < words.length; i++) {
      const w = words[i];
      const at = (w & 0x3fff) + ((w >>> 14) & 0x3fff) * width;
      time[at] = end - ages[i] * scale;
      colour[at] = (w >>> 31) | (((w >>> 28) & 3) << 1);
    }
  }

  /** The time constant at which the share BRIGHT of the active pixels is bright: short where pixels fire often. */
  expose(now) {
    const { time } = this;
    const step = Math.max(1, Math.floor(time.length / SAMPLES)) | 1; // odd: not the same columns of every row
    const ages = [];
    for (let i = 0; i < time.length; i += step) if (now - time[i] <= RECENT) ages.push(now - time[i]);
    if (ages.length >= FEWEST) {
      const middle = Float64Array.from(ages).sort()[Math.floor(BRIGHT * ages.length)];
      const wanted = Math.min(Math.max(middle / Math.LN2, SHORTEST), RECENT);
      this.tau = this.tau ? this.tau * (wanted / this.tau) ** RATE : wanted;
    }
    return this.tau || RECENT / 3;
  }

  /** Canvas words of all pixels; tau = Infinity: all events as new. */
  paint(out, now, tau) {
    const { time, colour } = this;
    const scale = STEPS / tau;
    const oldest = now - (LAST - 1) / scale;
    for (let i = 0; i < time.length; i++) {
      if (time[i] <= oldest) out[i] = GROUND_WORD;
      else out[i] = eventColours[colour[i] * LAST + (Math.max(now - time[i], 0) * scale | 0)];
    }
  }
}
