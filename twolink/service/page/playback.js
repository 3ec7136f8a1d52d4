// A clock that plays, pauses and can be set; a listener gets each time shown.

import { byId, el } from "./dom.js";

const SPEEDS = [0.001, 0.01, 0.1, 0.25, 0.5, 1, 2, 5, 10];
const SHORTEST = 2,
  LONGEST = 20; // seconds that playing should take

export class Playback {
  /** onTime(t) is called for each time shown. */
  constructor(onTime) {
    this.onTime = onTime;
    this.playing = false;
    this.t = 0;
    byId("speed").append(...SPEEDS.map(speed => el("option", { value: speed }, `${speed}×`)));
    byId("speed").value = 1;
    byId("play").addEventListener("click", () => this.toggle());
    byId("scrub").addEventListener("input", event => {
      this.pause();
      this.seek(Number(event.target.value));
    });
    byId("scrub").addEventListener("keydown", event => {
      const direction = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (!direction) return;
      event.preventDefault();
      this.pause();
      this.seek(this.t + (direction * (this.end - this.begin)) / 100);
    });
    this.frame = now => this.#tick(now);
  }

  /** A motion from `begin` to `end` s; it plays at once unless the user prefers reduced motion. */
  load(begin, end) {
    Object.assign(this, { begin, end });
    byId("playback").hidden = false;
    Object.assign(byId("scrub"), { min: begin, max: end });
    const length = end - begin;
    const speed =
      length > 1 && length <= LONGEST ? 1 : (SPEEDS.filter(s => length / s >= SHORTEST).at(-1) ?? SPEEDS[0]);
    byId("speed").value =
      length > LONGEST ? (SPEEDS.find(s => length / s <= LONGEST) ?? SPEEDS.at(-1)) : Math.min(speed, 1);
    this.pause();
    this.seek(begin);
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) this.play();
  }

  /** Stop and hide the controls, because another robot is shown. */
  unload() {
    this.pause();
    byId("playback").hidden = true;
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.t >= this.end) this.t = this.begin;
    this.playing = true;
    this.last = performance.now();
    byId("play").setAttribute("aria-label", "Pause");
    byId("play").classList.add("playing");
    requestAnimationFrame(this.frame);
  }

  pause() {
    this.playing = false;
    byId("play").setAttribute("aria-label", "Play");
    byId("play").classList.remove("playing");
  }

  seek(t) {
    this.t = Math.min(Math.max(t, this.begin), this.end);
    byId("scrub").value = this.t;
    const digits = this.end - this.begin < 0.5 ? 5 : 2;
    byId("clock").textContent = `${this.t.toFixed(digits)} s`;
    byId("scrub").setAttribute("aria-valuetext", byId("clock").textContent);
    this.onTime(this.t);
  }

  #tick(now) {
    if (!this.playing) return;
    const step = Math.min((now - this.last) / 1000, 0.1) * Number(byId("speed").value);
    this.last = now;
    if (this.t + step >= this.end) {
      this.pause();
      this.seek(this.end);
      return;
    }
    this.seek(this.t + step);
    requestAnimationFrame(this.frame);
  }
}
