// Where a recording is that is being played, and what time a part of it is called.

import { seconds } from "./dom.js";

export class Playback {
  /** recording: {node, file, again, start, end} [s], as the graph's description has it, or null for a live graph. */
  constructor(recording) {
    this.recording = recording;
    this.start = recording?.start ?? null;
    this.end = recording?.end ?? null;
    this.at = null;
    this.episode = null;
  }

  /** A camera's description comes first, with the time at which its recording begins, or 0 where that is earlier; of
   * a part of a bag, whose limits are known, it may be from long before. */
  begins(t) {
    if ((this.recording?.start ?? null) !== null) return;
    if (this.start === null || t < this.start) this.start = t;
  }

  /** A part has been drawn. A round that is over tells where the recording ends. */
  saw({ t, episode }) {
    if (!this.recording || this.start === null) return;
    if (this.recording.again && this.recording.end === null && this.episode !== null && episode > this.episode) this.end = this.at;
    this.start = Math.min(this.start, t); // a description is of no time before 0, which a recording may have
    this.at = episode === this.episode ? Math.max(this.at, t) : t;
    this.episode = episode;
  }

  /** "recording 1.2 of 8.0 s". */
  text() {
    if (this.at === null) return "recording";
    const at = (this.at - this.start).toFixed(1);
    return this.end === null ? `recording ${at} s` : `recording ${at} of ${(this.end - this.start).toFixed(1)} s`;
  }

  /** The time of a part, with its episode where that is not a round of a recording. */
  when({ t, episode }) {
    return seconds(t) + (episode && !this.recording?.again ? `  episode ${episode}` : "");
  }
}
