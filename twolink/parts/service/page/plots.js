// Curves over time on a canvas: zoom, cursor, legend, events. A plot does not know where its numbers come from.

import { LEFT, locate, range, RIGHT, tickText, ticks } from "./axes.js";
import { el, short } from "./dom.js";
import { wirePointing } from "./pointing.js";

const LIGHT = ["#1f6fb2", "#d9730d", "#2a8a57", "#b8427a", "#6b56c0", "#8a6d1c", "#2b93a1", "#7a7f87"];
const DARK = ["#62b0f0", "#f59e4c", "#5fc98f", "#ec7fb2", "#a798f5", "#d6b656", "#5ecbd9", "#a3aab3"];
const DASHES = [[], [6, 3], [2, 3]];
const OTHERS = [[7, 4], [2, 3], [9, 3, 2, 3]]; // dashes of the curves of other runs
const TOP = 8,
  BOTTOM = 22,
  HEIGHT = 190; // px

const dark = matchMedia("(prefers-color-scheme: dark)");

export class Plot {
  /** options: title, unit, log; across: the unit of the horizontal axis. onZoom(from, to) or onZoom(null), onPoint(t, kind): "hover", "click" or "key". */
  constructor(host, { title, unit, log = false, across = "s", onZoom, onPoint }) {
    Object.assign(this, { title, unit, log, across, onZoom, onPoint });
    this.hidden = new Set();
    this.cursor = null;
    this.canvas = el("canvas", { tabIndex: 0, role: "img", "aria-describedby": "plots-help" });
    this.legend = el("ul", { className: "legend", "aria-label": `Curves of ${title}` });
    this.offset = el("span", { className: "hint" });
    this.caption = el("span", { className: "hint" });
    const caption = el(
      "figcaption",
      {},
      el("b", {}, title),
      el("span", { className: "hint" }, ` ${unit}`),
      this.offset,
      this.caption,
    );
    host.append(el("figure", { className: "plot" }, caption, this.canvas, this.legend));
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    dark.addEventListener("change", () => {
      this.#names();
      this.draw();
    });
    wirePointing(this);
  }

  /** t: increasing numbers; series: [{name, values, colour, band}], band: [low, high] values, which are filled.
   *
   * marks: [{t, text, sign}]; sign: written above the mark, if there is one. others: curves of other runs, [{t, series}]. */
  setData(t, series, marks = [], others = []) {
    Object.assign(this, { t, series, marks, others });
    this.from = t[0];
    this.to = t[t.length - 1];
    this.hidden = new Set();
    const spans = series.slice(0, 6).map(line => {
      const [low, high] = range(line.values);
      return `${line.name} from ${short(low)} to ${short(high)}`;
    });
    this.canvas.setAttribute("aria-label", `${this.title} over time: ${spans.join("; ")}`);
    this.#names();
    this.draw();
  }

  /** Show the curves that fit, and offer no others. */
  show(fits) {
    this.hidden = new Set(this.series.filter(line => !fits(line)).map(line => line.name));
    this.offered = this.series.filter(fits);
    this.#names();
    this.draw();
  }

  setWindow(from, to) {
    this.from = from ?? this.t[0];
    this.to = to ?? this.t[this.t.length - 1];
    this.draw();
  }

  setCursor(t) {
    this.cursor = t;
    this.draw();
  }

  value(line, t) {
    const [i, part] = locate(this.t, t);
    const a = line.values[i],
      b = line.values[Math.min(i + 1, line.values.length - 1)];
    return a + part * (b - a);
  }

  #colour(line) {
    return (dark.matches ? DARK : LIGHT)[(line.colour ?? this.series.indexOf(line)) % LIGHT.length];
  }

  #dash(line) {
    return DASHES[Math.floor((line.colour ?? this.series.indexOf(line)) / LIGHT.length) % DASHES.length];
  }

  #names() {
    if (!this.series) return;
    this.values = new Map();
    const entries = (this.offered ?? this.series).map(line => {
      const swatch = el("span", { className: "swatch" });
      swatch.style.background = this.#colour(line);
      const value = el("span", { className: "value" });
      this.values.set(line, value);
      const toggle = el(
        "button",
        {
          type: "button",
          "aria-pressed": String(!this.hidden.has(line.name)),
          title: "Show or hide",
          onclick: () => {
            if (!this.hidden.delete(line.name)) this.hidden.add(line.name);
            toggle.setAttribute("aria-pressed", String(!this.hidden.has(line.name)));
            this.draw();
          },
        },
        swatch,
        el("span", { className: "name" }, line.name),
        value,
      );
      return el("li", {}, toggle);
    });
    this.legend.replaceChildren(...entries);
  }

  /** Lowest and highest value to show, with a margin; decades on a logarithmic axis. */
  #heights() {
    const begin = locate(this.t, this.from)[0],
      end = Math.min(locate(this.t, this.to)[0] + 2, this.t.length);
    let low = Infinity,
      high = -Infinity;
    for (const line of this.series) {
      if (this.hidden.has(line.name)) continue;
      const [lowest, highest] = range(line.values, begin, end, this.log);
      low = Math.min(low, lowest);
      high = Math.max(high, highest);
      for (const edge of line.band ?? []) {
        const [below, above] = range(edge, begin, end, this.log);
        low = Math.min(low, below);
        high = Math.max(high, above);
      }
    }
    for (const { t, series } of this.others) {
      const [first, last] = [locate(t, this.from)[0], Math.min(locate(t, this.to)[0] + 2, t.length)];
      for (const line of series) {
        if (this.hidden.has(line.name) || !this.series.some(each => each.name === line.name)) continue;
        const [below, above] = range(line.values, first, last, this.log);
        low = Math.min(low, below);
        high = Math.max(high, above);
      }
    }
    if (this.level) [low, high] = [Math.min(low, this.level.value), Math.max(high, this.level.value)];
    if (!(low <= high)) return this.log ? [-16, 0] : [-1, 1];
    if (this.log)
      return [Math.floor(Math.log10(low)), Math.max(Math.ceil(Math.log10(high)), Math.floor(Math.log10(low)) + 1)];
    const air = Math.max((high - low) * 0.06, Math.abs(high) * 1e-12, 1e-300);
    return high - low > 0
      ? [low - air, high + air]
      : [low - (Math.abs(low) * 0.1 || 1), high + (Math.abs(high) * 0.1 || 1)];
  }

  draw() {
    const width = this.canvas.clientWidth;
    if (!this.t || !width) return;
    const scale = devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * scale) || this.canvas.height !== Math.round(HEIGHT * scale)) {
      this.canvas.width = Math.round(width * scale);
      this.canvas.height = Math.round(HEIGHT * scale);
    }
    const c = this.canvas.getContext("2d");
    const style = getComputedStyle(document.documentElement);
    const colour = name => style.getPropertyValue(name).trim();
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, width, HEIGHT);
    c.font = "11px system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
    const [low, high] = this.#heights();
    const right = width - RIGHT,
      bottom = HEIGHT - BOTTOM;
    this.x = t => LEFT + ((t - this.from) / (this.to - this.from || 1)) * (right - LEFT);
    const y = value => bottom - ((value - low) / (high - low)) * (bottom - TOP);

    c.lineWidth = 1;
    c.strokeStyle = colour("--grid");
    c.fillStyle = colour("--soft");
    c.textAlign = "right";
    c.textBaseline = "middle";
    const rows = this.log ? ticks(low, high, 6).filter(Number.isInteger) : ticks(low, high, 5);
    const step = rows.length > 1 ? rows[1] - rows[0] : 1;
    const base = !this.log && Math.max(Math.abs(low), Math.abs(high)) > 1e4 * step ? rows[0] : 0; // shown once, not at each line
    for (const row of rows) {
      const at = Math.round(y(row)) + 0.5;
      stroke(c, LEFT, at, right, at);
      c.fillText(
        this.log ? `1e${row}`.replace("-", "−") : (base && row !== base ? "+" : "") + tickText(row - base, step),
        LEFT - 6,
        at,
      );
    }
    this.offset.textContent = base ? ` from ${short(base, 8)}` : "";
    c.textAlign = "center";
    c.textBaseline = "top";
    const columns = ticks(this.from, this.to, Math.max(2, Math.floor((right - LEFT) / 70)));
    const gap = columns.length > 1 ? columns[1] - columns[0] : 1;
    this.caption.textContent = this.across === "s" ? "" : ` over ${this.across}`;
    for (const column of columns) {
      c.fillText(
        `${tickText(column, gap)}${this.across === "s" && column === columns.at(-1) ? " s" : ""}`,
        Math.min(this.x(column), right - 8),
        bottom + 6,
      );
    }

    c.save();
    c.beginPath();
    c.rect(LEFT, TOP - 2, right - LEFT, bottom - TOP + 4);
    c.clip();
    c.setLineDash([3, 3]);
    c.strokeStyle = colour("--mark");
    for (const mark of this.marks) {
      const at = Math.round(this.x(mark.t)) + 0.5;
      if (at < LEFT || at > right) continue;
      stroke(c, at, TOP, at, bottom);
      if (mark.sign) c.fillText(mark.sign, at, TOP);
    }
    if (this.level && this.log) {
      const at = Math.round(y(Math.log10(this.level.value))) + 0.5;
      stroke(c, LEFT, at, right, at);
      c.textAlign = "right";
      c.fillText(this.level.text, right - 4, at + 3);
    }
    c.lineWidth = 1.6;
    c.lineJoin = "round";
    const begin = Math.max(0, locate(this.t, this.from)[0]),
      end = Math.min(locate(this.t, this.to)[0] + 2, this.t.length);
    const path = (times, values, from = 0, to = values.length) => {
      let down = false;
      for (let k = from; k < to; k++) {
        const value = this.log ? Math.log10(values[k]) : values[k];
        if (Number.isFinite(value)) c[down ? "lineTo" : "moveTo"](this.x(times[k]), y(value));
        down = Number.isFinite(value);
      }
    };
    const shown = this.series.filter(line => !this.hidden.has(line.name));
    for (const line of shown.filter(line => line.band)) {
      const [below, above] = line.band;
      c.globalAlpha = 0.25;
      c.fillStyle = this.#colour(line);
      c.beginPath();
      for (let k = begin; k < end; k++) c.lineTo(this.x(this.t[k]), y(above[k]));
      for (let k = end - 1; k >= begin; k--) c.lineTo(this.x(this.t[k]), y(below[k]));
      c.fill();
    }
    c.globalAlpha = 0.7;
    this.others.forEach(({ t, series }, i) => {
      for (const line of shown) {
        const other = series.find(each => each.name === line.name);
        if (!other) continue;
        c.strokeStyle = this.#colour(line);
        c.setLineDash(OTHERS[i % OTHERS.length]);
        c.beginPath();
        path(t, other.values);
        c.stroke();
      }
    });
    c.globalAlpha = 1;
    for (const line of shown) {
      c.strokeStyle = this.#colour(line);
      c.setLineDash(this.#dash(line));
      c.beginPath();
      path(this.t, line.values, begin, end);
      c.stroke();
    }
    c.setLineDash([]);
    if (this.drag) {
      c.fillStyle = colour("--select");
      c.fillRect(Math.min(...this.drag), TOP, Math.abs(this.drag[1] - this.drag[0]), bottom - TOP);
    }
    if (this.cursor !== null && this.cursor >= this.from && this.cursor <= this.to) {
      c.strokeStyle = c.fillStyle = colour("--text");
      c.lineWidth = 1;
      stroke(c, Math.round(this.x(this.cursor)) + 0.5, TOP, Math.round(this.x(this.cursor)) + 0.5, bottom);
      for (const line of shown) {
        const value = this.value(line, this.cursor);
        if (!Number.isFinite(value)) continue;
        c.fillStyle = this.#colour(line);
        c.beginPath();
        c.arc(this.x(this.cursor), y(this.log ? Math.log10(value) : value), 3, 0, 7);
        c.fill();
      }
    }
    c.restore();
    for (const [line, value] of this.values) {
      value.textContent = this.cursor === null ? "" : short(this.value(line, this.cursor), 4);
    }
  }
}

function stroke(c, x1, y1, x2, y2) {
  c.beginPath();
  c.moveTo(x1, y1);
  c.lineTo(x2, y2);
  c.stroke();
}
