// Many runs of the scene over one or two quantities: a curve or a heat map, whose runs can be seen.

import { download, get } from "./api.js";
import { byId, el, short, showProblem } from "./dom.js";
import { numberInput } from "./form.js";
import { HeatMap } from "./heatmap.js";
import { Job, jobControls } from "./jobs.js";
import { Plot } from "./plots.js";
import { searchable } from "./search.js";

const VALUES = 21; // of a quantity
const AROUND = 0.5; // of a quantity that is 0, and 20 % of others
const FILES = [
  ["csv", "CSV"],
  ["parquet", "Parquet"],
  ["zip", "Zarr"],
];

export class Sweep {
  /** getRequest(): the settings of a run. onRun(request): show the run of this request. */
  constructor(getRequest, onRun) {
    this.onRun = onRun;
    this.axes = [1, 2].map(number => this.#axis(number));
    const { node, parts } = jobControls("sweep", "Sweep");
    this.parts = parts;
    this.result = el("div", { id: "sweep-result" });
    byId("panel-sweep").append(
      el(
        "p",
        { className: "hint" },
        "The scene above, run for each value of one or two quantities. Every cell has an error bar; click one to see that run move.",
      ),
      el("div", { className: "halves" }, ...this.axes.map(axis => axis.node)),
      node,
      this.result,
    );
    this.job = new Job("sweeps", parts, job => this.#show(job));
    parts.start.addEventListener("click", () => {
      const { scene, accuracy } = getRequest();
      const chosen = this.axes.filter(axis => axis.select.value);
      this.first = chosen[0].select.value;
      const vary = Object.fromEntries(chosen.map(axis => [axis.select.value, { range: axis.numbers }]));
      this.job.run({ scene, accuracy, vary, outputs: ["final"] });
    });
  }

  #axis(number) {
    const select = el("select", { id: `sweep-name-${number}` });
    const search = el("input", { type: "search", className: "search", "aria-label": "Search quantities" });
    const range = el("span", { className: "tuple" });
    const axis = { select, range, numbers: [0, 1, 11], search };
    select.addEventListener("change", () => this.#range(axis));
    axis.node = el(
      "fieldset",
      { className: "axis" },
      el("legend", {}, number === 1 ? "First quantity" : "Second quantity, or none"),
      search,
      select,
      range,
    );
    axis.refresh = searchable(select, search);
    select.setAttribute("aria-label", number === 1 ? "First quantity" : "Second quantity");
    return axis;
  }

  /** Offer the quantities of a scene. */
  set(rows) {
    this.rows = rows.filter(row => ["q", "v"].includes(row.kind) || (row.kind === "parameter" && row.value !== null));
    const groups = [
      ["Start", row => row.kind !== "parameter"],
      ["Effects", row => row.name.startsWith("effects.")],
      ["Masses", row => row.name.endsWith(".mass")],
      ["Other constants", row => !row.name.startsWith("effects.") && !row.name.endsWith(".mass")],
    ];
    const left = new Set(this.rows);
    const options = groups.map(([label, fits]) => {
      const own = [...left].filter(fits);
      for (const row of own) left.delete(row);
      return [label, own];
    });
    this.axes.forEach((axis, i) => {
      const before = axis.select.value;
      axis.select.replaceChildren(
        ...(i ? [el("optgroup", { label: "Only one" }, el("option", { value: "" }, "none"))] : []),
        ...options.map(([label, own]) =>
          el("optgroup", { label }, ...own.map(row => el("option", { value: row.name, title: row.about }, row.name))),
        ),
      );
      axis.refresh();
      const first = this.rows.filter(row => row.kind === "q")[i]?.name ?? (i ? "" : this.rows[0]?.name);
      axis.select.value = this.rows.some(row => row.name === before) ? before : first;
      if (axis.select.value !== before || !axis.range.children.length) this.#range(axis);
    });
  }

  /** The range of a quantity: about its own value. */
  #range(axis) {
    const row = this.rows.find(each => each.name === axis.select.value);
    axis.range.replaceChildren();
    if (!row) return;
    const wide = row.value ? 0.2 * Math.abs(row.value) : AROUND;
    axis.numbers = [row.value - wide, row.value + wide, VALUES].map(x => Number(x.toPrecision(6)));
    const unit = row.unit === "SI units" ? "" : `, ${row.unit}`;
    const words = [`From${unit}`, `To${unit}`, "Values"];
    const number = (k, word) => {
      const change = value => {
        axis.numbers[k] = k === 2 ? Math.round(value) : value;
      };
      return numberInput(axis.numbers[k], change, `${row.name}: ${word}`, k === 2 ? 1 : undefined);
    };
    axis.range.replaceChildren(
      ...words.map((word, k) =>
        el("label", { className: "field" }, el("span", { className: "hint" }, word), number(k, word)),
      ),
    );
  }

  async #show(job) {
    const path = `/v1/sweeps/${job.id}`;
    const found = await get(`${path}/result?format=json`);
    const [first] = Object.keys(job.request.vary).filter(name => name === this.first).concat(found.dims);
    const names = Object.keys(found.columns).filter(name => /^end\.|^error$/.test(name));
    const choice = el("select", { id: "sweep-column" }, ...names.map(name => el("option", {}, name)));
    const place = el("div", { className: "sweep-figure" });
    const pick = async number => {
      try {
        const { simulation } = await get(`${path}/runs/${number}`);
        await this.onRun(simulation);
      } catch (failure) {
        showProblem(this.parts.problem, failure);
      }
    };
    choice.addEventListener("change", () => draw(place, found, choice.value, first, pick));
    const { done, runs } = job.result;
    const save = ([format, text]) => {
      const name = `sweep-${job.id.slice(-6)}.${format === "zip" ? "zarr.zip" : format}`;
      const take = () => download(`${path}/result?format=${format}`, name).catch(failure => showProblem(this.parts.problem, failure));
      return el("button", { type: "button", className: "quiet", onclick: take }, text);
    };
    this.result.replaceChildren(
      el("p", { id: "sweep-verdict" }, el("b", {}, `${done} of ${runs} runs`), done < runs ? `; ${runs - done} failed or are not accurate enough, and are crossed out` : ""),
      el("label", { className: "row" }, "Show ", choice),
      place,
      el("p", { className: "downloads" }, el("span", { className: "hint" }, "Download "), ...FILES.map(save)),
    );
    draw(place, found, names[0], first, pick);
  }
}

/** The figure of a column: over one quantity a curve with its error bars, over two a heat map. Runs that did not keep
 * their accuracy have no value. first: the quantity that goes across. */
function draw(place, found, name, first, pick) {
  const axes = found.dims.map(dim => ({ name: dim, ...found.varied[dim] }));
  const { units } = found.columns[name];
  const done = found.columns.status.values.map(status => found.statuses[status] === "done");
  const values = found.columns[name].values.map((value, i) => (done[i] ? value : null));
  if (axes.length === 2) {
    const last = axes[1].values.length; // the quantity that varies fastest
    const across = axes[0].name === first ? 0 : 1;
    const number = (i, j) => (across === 0 ? i * last + j : j * last + i);
    const map = new HeatMap(place, (i, j) => pick(number(i, j)));
    const value = (i, j) => values[number(i, j)] ?? NaN;
    map.setData({ x: axes[across], y: axes[1 - across], title: name, units: units ?? "", value });
    return;
  }
  place.replaceChildren();
  const [x] = axes;
  const order = x.values.map((_, i) => i).sort((a, b) => x.values[a] - x.values[b]);
  const bars = found.columns.error?.values ?? values.map(() => 0);
  const numbers = order.map(i => values[i] ?? NaN);
  const edge = sign => order.map(i => (values[i] ?? NaN) + sign * (name === "error" ? 0 : bars[i] ?? 0));
  const plot = new Plot(place, {
    title: name,
    unit: units ?? "",
    across: `${x.units} of ${x.name}`,
    onZoom: (from, to) => plot.setWindow(from, to),
    onPoint: (at, how) => {
      plot.setCursor(at);
      if (how !== "click") return;
      const near = order.reduce((best, i) => (Math.abs(x.values[i] - at) < Math.abs(x.values[best] - at) ? i : best));
      pick(near);
    },
  });
  plot.setData(order.map(i => x.values[i]), [{ name, values: numbers, band: [edge(-1), edge(1)] }]);
  place.append(el("p", { className: "hint" }, `Click to see the run at that ${x.name}; ${short(order.length)} values.`));
}
