// Colours of events, and legends for the false-colour maps.

const ON = [255, 173, 77];
const OFF = [85, 168, 255];
/** Names and colours of a colour sensor's channels, in their order on the wire. */
export const CHANNELS = [["R", [255, 84, 84]], ["G", [96, 220, 120]], ["B", [96, 140, 255]]];
const GROUND = [10, 12, 16];

const blend = (colour, s) => colour.map((c, i) => Math.round(GROUND[i] + (c - GROUND[i]) * s));
const word = ([r, g, b]) => (255 << 24) | (b << 16) | (g << 8) | r;

/** Steps per time constant and number of steps of the tables below; an older event is as dark as none. */
export const STEPS = 32, LAST = 8 * STEPS;
export const GROUND_WORD = word(GROUND);

/** Canvas words of one colour for events that are 0 .. LAST - 1 steps old. */
const fading = (colour, share) => Array.from({ length: LAST }, (_, i) => word(blend(colour, share * Math.exp(-i / STEPS) ** 0.8)));

/** LAST words each for polarity + 2 * (colour + 1), where colour + 1 = 0 is none; OFF of a colour sensor is the darker half. */
export const eventColours = Uint32Array.from([
  fading(OFF, 1), fading(ON, 1), ...CHANNELS.flatMap(([, colour]) => [fading(colour, 0.45), fading(colour, 1)])].flat());

const gamma = (c) => (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055);

/** CSS colour of an OKLCh colour, as on the server. */
export function oklch(l, c, h) {
  const a = c * Math.cos(h), b = c * Math.sin(h);
  const long = (l + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const middle = (l - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const short = (l - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const linear = [
    4.0767416621 * long - 3.3077115913 * middle + 0.2309699292 * short,
    -1.2684380046 * long + 2.6097574011 * middle - 0.3413193965 * short,
    -0.0041960863 * long - 0.7034186147 * middle + 1.707614701 * short,
  ];
  return `rgb(${linear.map((v) => Math.round(255 * gamma(Math.min(Math.max(v, 0), 1)))).join(" ")})`;
}

/** Near (light) to far (dark), as in the depth map. */
export function drawRamp(canvas) {
  canvas.width = 80;
  canvas.height = 8;
  const context = canvas.getContext("2d");
  for (let i = 0; i < 80; i++) {
    const s = 1 - i / 79;
    context.fillStyle = oklch(0.24 + 0.71 * s, 0.1 + 0.1 * Math.sin(Math.PI * s), ((295 - 190 * s) * Math.PI) / 180);
    context.fillRect(i, 0, 1, 8);
  }
}

/** Direction by hue, y down as in the image. */
export function drawWheel(canvas) {
  const n = 22;
  canvas.width = canvas.height = n;
  const context = canvas.getContext("2d");
  for (let y = 0; y < n; y++) {
    for (let x = 0; x < n; x++) {
      const dx = (2 * x + 1) / n - 1, dy = (2 * y + 1) / n - 1, r = Math.hypot(dx, dy);
      if (r > 1) continue;
      context.fillStyle = oklch(0.19 + 0.61 * r, 0.19 * r, Math.atan2(dy, dx));
      context.fillRect(x, y, 1, 1);
    }
  }
}
