// The runs of a sweep as a figure that fills while they are computed: a curve over one quantity, a heat map over two.

import { el, short } from "./dom.js";
import { HeatMap, MARKS } from "./heatmap.js";
import { Plot } from "./plots.js";

export class SweepView {
  /** first: the quantity that goes across. onPick(number): a run was clicked. */
  constructor(host, first, onPick) {
    Object.assign(this, { first, onPick });
    this.verdict = el("p", { id: "sweep-verdict" });
    this.signs = el("ul", { className: "signs", "aria-label": "Marks" });
    this.choice = el("select", { id: "sweep-column" });
    this.choice.addEventListener("change", () => this.#figure());
    this.place = el("div", { className: "sweep-figure" });
    host.replaceChildren(this.verdict, el("label", { className: "row" }, "Show ", this.choice), this.place, this.signs);
  }

  /** Show the runs there are. found: the columns of the sweep, as the service sends them. */
  show(found) {
    this.found = found;
    this.statuses = found.columns.status.values.map(status => found.statuses[status]);
    const number = status => this.statuses.filter(each => each === status).length;
    this.verdict.replaceChildren(
      el("b", {}, `${number("done")} of ${this.statuses.length} runs`),
      " are as accurate as asked for.",
    );
    const marked = Object.entries(MARKS).filter(([status]) => number(status));
    this.signs.replaceChildren(
      ...marked.map(([status, [sign, text]]) => el("li", {}, el("b", {}, sign), ` ${text}: ${number(status)}`)),
    );
    if (!this.choice.length) {
      const names = Object.keys(found.columns).filter(name => /^end\.|^error$/.test(name));
      this.choice.append(...names.map(name => el("option", {}, name)));
    }
    this.#figure();
  }

  #figure() {
    const { dims, varied, columns } = this.found;
    const name = this.choice.value;
    const axes = dims.map(dim => ({ name: dim, ...varied[dim] }));
    const runs = this.statuses.map((status, i) => ({
      status,
      value: columns[name].values[i] ?? NaN,
      reason: columns.reason.values[i],
    }));
    const title = { title: name, units: columns[name].units ?? "" };
    if (axes.length === 2) this.#map(axes, runs, title);
    else this.#curve(axes[0], runs, title);
  }

  #map(axes, runs, title) {
    const across = axes[1].name === this.first ? 1 : 0;
    const last = axes[1].values.length; // the quantity that varies fastest
    const number = (i, j) => (across === 0 ? i * last + j : j * last + i);
    this.map ??= new HeatMap(this.place, (i, j) => this.onPick(number(i, j)));
    this.map.setData({ x: axes[across], y: axes[1 - across], cell: (i, j) => runs[number(i, j)], ...title });
  }

  #curve(x, runs, { title, units }) {
    const order = x.values.map((_, i) => i).sort((a, b) => x.values[a] - x.values[b]);
    const at = order.map(i => x.values[i]);
    const bars = title === "error" ? [] : this.found.columns.error.values;
    const edge = sign => order.map(i => runs[i].value + sign * (bars[i] ?? 0));
    const marked = order.filter(i => runs[i].status in MARKS && runs[i].status !== "pending");
    const marks = marked.map(i => ({ t: x.values[i], text: runs[i].reason, sign: MARKS[runs[i].status][0] }));
    this.place.replaceChildren();
    const plot = new Plot(this.place, {
      title,
      unit: units,
      across: [x.name, x.units].filter(Boolean).join(", "),
      onZoom: (from, to) => plot.setWindow(from, to),
      onPoint: (place, how) => {
        plot.setCursor(place);
        const near = order.reduce((best, i) => (Math.abs(x.values[i] - place) < Math.abs(x.values[best] - place) ? i : best));
        if (how === "click") this.onPick(near);
      },
    });
    plot.setData(at, [{ name: title, values: order.map(i => runs[i].value), band: [edge(-1), edge(1)] }], marks);
    this.place.append(el("p", { className: "hint" }, `Click to see the run at that ${x.name}; ${short(at.length)} values.`));
  }
}
