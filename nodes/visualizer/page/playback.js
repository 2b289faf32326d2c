// Where a recording is that is being played, and what time a part of it is called.

import { seconds } from "./dom.js";

export class Playback {
  /** recording: {file, again, start, end} [s], as the graph's description has it, or null for a live graph. */
  constructor(recording) {
    this.recording = recording;
    this.start = recording?.start ?? null;
    this.length = recording?.end == null ? null : recording.end - recording.start;
    this.at = null;
    this.episode = null;
  }

  /** A camera's description comes first, with the time at which its recording begins. */
  begins(t) {
    if (this.start === null || t < this.start) this.start = t;
  }

  /** A part has been drawn. A round that is over tells how long the recording is. */
  saw({ t, episode }) {
    if (!this.recording || this.start === null) return;
    if (this.recording.again && this.recording.end === null && this.episode !== null && episode > this.episode) this.length = this.at;
    if (episode !== this.episode) this.at = 0;
    this.episode = episode;
    this.at = Math.max(this.at, t - this.start);
  }

  /** "recording 1.2 of 8.0 s". */
  text() {
    if (this.at === null) return "recording";
    return this.length === null ? `recording ${this.at.toFixed(1)} s` : `recording ${this.at.toFixed(1)} of ${this.length.toFixed(1)} s`;
  }

  /** The time of a part, with its episode where that is not a round of a recording. */
  when({ t, episode }) {
    return seconds(t) + (episode && !this.recording?.again ? `  episode ${episode}` : "");
  }
}
