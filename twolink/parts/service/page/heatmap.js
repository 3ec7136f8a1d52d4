// Values over two quantities as colours on a canvas. A cell is pointed at, clicked, or reached by the arrow keys.

import { range, ticks, tickText } from "./axes.js";
import { announce, el, short } from "./dom.js";

const COLOURS = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
]; // viridis: even to the eye, and in grey
const HEIGHT = 380,
  LEFT = 62,
  RIGHT = 84,
  TOP = 10,
  BOTTOM = 42,
  BAR = 14; // px
/** What runs without a number to trust are marked by, by their status, and what it means. */
export const MARKS = {
  inaccurate: ["○", "error bar above the accuracy"],
  failed: ["×", "failed"],
  abandoned: ["✱", "given up: three workers died of it"],
  pending: ["·", "to come"],
};

export class HeatMap {
  /** onPick(column, row): a cell was clicked. */
  constructor(host, onPick) {
    this.onPick = onPick;
    this.at = [0, 0];
    this.canvas = el("canvas", { tabIndex: 0, role: "img", className: "heatmap" });
    this.said = el("p", { className: "facts", "aria-live": "polite" });
    host.replaceChildren(this.canvas, this.said);
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.canvas.addEventListener("pointermove", event => this.#point(this.#cellAt(event)));
    this.canvas.addEventListener("click", event => {
      const cell = this.#cellAt(event);
      if (cell) this.onPick(...cell);
    });
    this.canvas.addEventListener("keydown", event => this.#key(event));
  }

  /** x, y: {name, units, values}. cell(column, row): {value, status, reason}; value: NaN where there is none. title,
   * units: of the values. */
  setData({ x, y, cell, title, units }) {
    Object.assign(this, { x, y, cell, title, units });
    const cells = x.values.flatMap((_, i) => y.values.map((_, j) => cell(i, j).value));
    [this.low, this.high] = range(cells);
    const missing = cells.filter(value => !Number.isFinite(value)).length;
    this.at = [Math.min(this.at[0], x.values.length - 1), Math.min(this.at[1], y.values.length - 1)];
    this.canvas.setAttribute(
      "aria-label",
      `${title} over ${x.name} and ${y.name}: ` +
        (this.low <= this.high ? `from ${short(this.low)} to ${short(this.high)} ${units}` : "no value yet") +
        (missing ? `; ${missing} cells have no value` : "") +
        ". Arrow keys move, Enter runs a cell.",
    );
    this.#say();
    this.draw();
  }

  #size() {
    return [this.canvas.clientWidth - LEFT - RIGHT, HEIGHT - TOP - BOTTOM];
  }

  #cellAt(event) {
    if (!this.x) return null;
    const box = this.canvas.getBoundingClientRect();
    const [width, height] = this.#size();
    const column = Math.floor(((event.clientX - box.left - LEFT) / width) * this.x.values.length);
    const row = this.y.values.length - 1 - Math.floor(((event.clientY - box.top - TOP) / height) * this.y.values.length);
    const inside = column >= 0 && row >= 0 && column < this.x.values.length && row < this.y.values.length;
    return inside ? [column, row] : null;
  }

  #point(cell) {
    if (!cell || (cell[0] === this.at[0] && cell[1] === this.at[1])) return;
    this.at = cell;
    this.#say();
    this.draw();
  }

  #words() {
    const [i, j] = this.at;
    const { value, status, reason } = this.cell(i, j);
    const known = Number.isFinite(value) ? `${short(value, 5)} ${this.units}` : "no value";
    const what = [known, reason || MARKS[status]?.[1]].filter(Boolean).join(", ");
    const place = axis => `${axis.name} ${short(axis.values[axis === this.x ? i : j], 4)} ${axis.units}`;
    return `${this.title}: ${what} at ${place(this.x)}, ${place(this.y)}`;
  }

  #say() {
    const known = Number.isFinite(this.cell(...this.at).value);
    this.said.textContent = `${this.#words()}.${known ? " Click to see that run move." : ""}`;
  }

  #key(event) {
    if (!this.x) return;
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (event.key === "Enter") this.onPick(...this.at);
    else if (step) {
      const within = (value, size) => Math.min(Math.max(value, 0), size - 1);
      this.#point([
        within(this.at[0] + step[0], this.x.values.length),
        within(this.at[1] + step[1], this.y.values.length),
      ]);
      announce(this.#words());
    } else return;
    event.preventDefault();
  }

  #colour(value) {
    const part = this.high > this.low ? (value - this.low) / (this.high - this.low) : 0.5;
    const place = part * (COLOURS.length - 1);
    const k = Math.min(Math.floor(place), COLOURS.length - 2);
    const mixed = COLOURS[k].map((from, c) => Math.round(from + (place - k) * (COLOURS[k + 1][c] - from)));
    return `rgb(${mixed.join()})`;
  }

  draw() {
    const width = this.canvas.clientWidth;
    if (!this.x || !width) return;
    const scale = devicePixelRatio || 1;
    this.canvas.width = Math.round(width * scale);
    this.canvas.height = Math.round(HEIGHT * scale);
    const c = this.canvas.getContext("2d");
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, width, HEIGHT);
    const style = getComputedStyle(document.documentElement);
    const [soft, text, mark] = ["--soft", "--text", "--mark"].map(name => style.getPropertyValue(name).trim());
    const [wide, high] = this.#size();
    const [nx, ny] = [this.x.values.length, this.y.values.length];
    const left = i => Math.round(LEFT + (i * wide) / nx);
    const top = j => Math.round(TOP + ((ny - 1 - j) * high) / ny);
    c.font = `${Math.max(6, Math.min(14, wide / nx, high / ny))}px system-ui, sans-serif`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    for (let i = 0; i < nx; i++)
      for (let j = 0; j < ny; j++) {
        const { value, status } = this.cell(i, j);
        const [sign] = MARKS[status] ?? [""];
        const [middle, centre] = [(left(i) + left(i + 1)) / 2, (top(j) + top(j - 1)) / 2];
        if (Number.isFinite(value)) {
          c.fillStyle = this.#colour(value);
          c.fillRect(left(i), top(j), left(i + 1) - left(i), top(j - 1) - top(j));
          c.fillStyle = "#fff";
          c.strokeStyle = "#000"; // both, to be seen on all colours
          c.lineWidth = 2;
          c.strokeText(sign, middle, centre);
        } else c.fillStyle = mark;
        c.fillText(sign, middle, centre);
      }
    c.strokeStyle = text;
    c.lineWidth = 2;
    c.strokeRect(left(this.at[0]) + 1, top(this.at[1]) + 1, wide / nx - 2, high / ny - 2);
    this.#axes(c, soft, wide, high);
  }

  #axes(c, colour, wide, high) {
    c.fillStyle = colour;
    c.font = "11px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "alphabetic";
    const half = axis => (axis.values.length > 1 ? (axis.values[1] - axis.values[0]) / 2 : 0.5);
    const span = axis => [axis.values[0] - half(axis), axis.values.at(-1) + half(axis)];
    const lines = (axis, count, place) => {
      const [from, to] = span(axis);
      const all = ticks(Math.min(from, to), Math.max(from, to), count);
      const step = all.length > 1 ? all[1] - all[0] : 1;
      for (const value of all) place((value - from) / (to - from), tickText(value, step));
    };
    lines(this.x, Math.max(2, Math.floor(wide / 80)), (part, words) => c.fillText(words, LEFT + part * wide, TOP + high + 15));
    c.fillText(`${this.x.name}${this.x.units && `, ${this.x.units}`}`, LEFT + wide / 2, HEIGHT - 8);
    c.textAlign = "right";
    lines(this.y, 6, (part, words) => c.fillText(words, LEFT - 6, TOP + (1 - part) * high + 4));
    c.save();
    c.translate(12, TOP + high / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = "center";
    c.fillText(`${this.y.name}${this.y.units && `, ${this.y.units}`}`, 0, 0);
    c.restore();
    if (this.low > this.high) return; // no run has a number yet
    const right = LEFT + wide + 12;
    for (let k = 0; k < high; k++) {
      c.fillStyle = this.#colour(this.low + ((high - k) / high) * (this.high - this.low));
      c.fillRect(right, TOP + k, BAR, 1.5);
    }
    c.fillStyle = colour;
    c.textAlign = "left";
    c.fillText(short(this.high, 4), right + BAR + 4, TOP + 8);
    c.fillText(short(this.low, 4), right + BAR + 4, TOP + high);
    c.fillText(this.units, right + BAR + 4, TOP + high / 2);
  }
}
