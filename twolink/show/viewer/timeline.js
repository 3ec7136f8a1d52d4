// A clock that plays, pauses and can be set, with its controls; a listener gets each time shown.

import { make } from "./elements.js";

const SPEEDS = [0.001, 0.01, 0.1, 0.25, 0.5, 1, 2, 5, 10];
const SHORTEST = 2,
  LONGEST = 20; // seconds that playing should take
const MARKS = 400; // events that are marked, at most

export class Timeline {
  /** root: the element for the controls. onTime(t) is called for each time shown. */
  constructor(root, onTime) {
    Object.assign(this, { root, onTime, playing: false, t: 0, begin: 0, end: 0, loop: false });
    this.button = make("button", { type: "button", id: "play", className: "round" });
    this.button.addEventListener("click", () => this.toggle());
    this.scrub = make("input", { type: "range", id: "scrub", min: 0, max: 1, step: "any", value: 0, ariaLabel: "Time" });
    this.marks = make("div", { className: "marks" });
    this.clock = make("output", { id: "clock" });
    this.select = make("select", { id: "speed", ariaLabel: "Speed" });
    this.scrub.addEventListener("input", () => {
      this.pause();
      this.seek(Number(this.scrub.value));
    });
    this.scrub.addEventListener("keydown", event => {
      const direction = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (!direction) return;
      event.preventDefault();
      this.pause();
      this.seek(this.t + (direction * (this.end - this.begin)) / 100);
    });
    root.replaceChildren(this.button, make("div", { className: "line" }, this.marks, this.scrub), this.clock, this.select);
    this.pause();
    this.frame = now => this.#tick(now);
    document.addEventListener("visibilitychange", () => (this.last = performance.now()));
  }

  /** A motion from `begin` to `end` s with marked events [{t, text}]; it plays at once unless the user prefers reduced
   * motion. speed: simulated seconds a second; by default such that playing takes some seconds. */
  load(begin, end, events = [], speed = null) {
    Object.assign(this, { begin, end });
    this.root.hidden = false;
    const length = end - begin;
    this.digits = Math.max(2, length > 0 ? Math.ceil(2 - Math.log10(length)) : 2);
    Object.assign(this.scrub, { min: begin, max: end });
    this.#offer(speed ?? usual(length));
    this.#mark(events);
    this.pause();
    this.seek(begin);
    if (length > 0 && !matchMedia("(prefers-reduced-motion: reduce)").matches) this.play();
  }

  #offer(speed) {
    const speeds = [...new Set([...SPEEDS, speed])].sort((a, b) => a - b);
    this.select.replaceChildren(...speeds.map(value => make("option", { value }, `${value}×`)));
    this.select.value = speed;
  }

  /** A button at each event; of events closer than a mark is wide, the first. */
  #mark(events) {
    const places = new Map();
    for (const event of events) {
      const share = (event.t - this.begin) / (this.end - this.begin || 1);
      const place = Math.round(share * MARKS);
      if (!places.has(place)) places.set(place, { share, events: [] });
      places.get(place).events.push(event);
    }
    const buttons = [...places.values()].map(({ share, events: [first, ...more] }) => {
      const text = `${Number(first.t.toPrecision(6))} s: ${first.text}${more.length ? `, and ${more.length} more` : ""}`;
      const mark = make("button", { type: "button", className: "mark", title: text, ariaLabel: text, tabIndex: -1 });
      mark.style.left = `${100 * share}%`;
      mark.addEventListener("click", () => {
        this.pause();
        this.seek(first.t);
      });
      return mark;
    });
    this.marks.replaceChildren(...buttons);
  }

  /** Stop and hide the controls. */
  unload() {
    this.pause();
    this.root.hidden = true;
  }

  get speed() {
    return Number(this.select.value);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    if (this.t >= this.end) this.t = this.begin;
    this.playing = true;
    this.last = performance.now();
    this.button.ariaLabel = this.button.title = "Pause";
    this.button.classList.add("playing");
    requestAnimationFrame(this.frame);
  }

  pause() {
    this.playing = false;
    this.button.ariaLabel = this.button.title = "Play";
    this.button.classList.remove("playing");
  }

  seek(t) {
    this.t = Math.min(Math.max(t, this.begin), this.end);
    this.scrub.value = this.t;
    this.clock.textContent = `${this.t.toFixed(this.digits)} s`;
    this.scrub.setAttribute("aria-valuetext", this.clock.textContent);
    this.onTime(this.t);
  }

  /** A slow machine shows fewer pictures, and the same motion; a tab that was hidden goes on where it was. */
  #tick(now) {
    if (!this.playing) return;
    const step = (Math.max(now - this.last, 0) / 1000) * this.speed;
    this.last = now;
    if (this.t + step < this.end) this.seek(this.t + step);
    else if (this.loop && this.t >= this.end) this.seek(this.begin);
    else this.seek(this.end);
    if (this.t >= this.end && !this.loop) this.pause();
    else requestAnimationFrame(this.frame);
  }
}

/** The speed at which a motion of so many seconds takes 2 to 20 s. */
function usual(length) {
  if (length > LONGEST) return SPEEDS.find(s => length / s <= LONGEST) ?? SPEEDS.at(-1);
  return length > 1 ? 1 : (SPEEDS.filter(s => length / s >= SHORTEST).at(-1) ?? SPEEDS[0]);
}
