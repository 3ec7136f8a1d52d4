// Many runs of the scene over one or two quantities: a curve or a heat map, whose runs can be seen.

import { downloadButton, get } from "./api.js";
import { byId, el, showProblem } from "./dom.js";
import { numberInput } from "./inputs.js";
import { Job, jobControls } from "./jobs.js";
import { searchable } from "./search.js";
import { SweepView } from "./sweep_view.js";

const VALUES = 21; // of a quantity
const AROUND = 0.5; // of a quantity that is 0, and 20 % of others
const LOOK = 500; // ms between looks at a sweep that runs
const FILES = [
  ["csv", "CSV", "csv"],
  ["parquet", "Parquet", "parquet"],
  ["zip", "Zarr", "zarr.zip"],
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
    this.job.onProgress = job => this.#peek(job);
    parts.start.addEventListener("click", () => {
      const { scene, accuracy } = getRequest();
      const chosen = this.axes.filter(axis => axis.select.value);
      this.first = chosen[0].select.value;
      this.next = 0; // when to look at the runs that are done, ms
      this.shown = null;
      this.result.replaceChildren();
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
    this.rows = rows.filter(row => ["q", "v", "constant", "effect"].includes(row.kind) && row.value !== null);
    const groups = [
      ["Start", row => ["q", "v"].includes(row.kind)],
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
        axis.numbers[k] = value;
      };
      return numberInput(axis.numbers[k], change, `${row.name}: ${word}`, k === 2 ? { type: "integer", minimum: 1 } : {});
    };
    axis.range.replaceChildren(
      ...words.map((word, k) =>
        el("label", { className: "field" }, el("span", { className: "hint" }, word), number(k, word)),
      ),
    );
  }

  /** The figure of a job, empty. */
  #view(job) {
    this.shown = job.id;
    this.view = new SweepView(this.result, this.first, async number => {
      try {
        const { simulation } = await get(`/v1/sweeps/${job.id}/runs/${number}`);
        await this.onRun(simulation);
      } catch (failure) {
        showProblem(this.parts.problem, failure);
      }
    });
  }

  /** Draw the runs that are done, less often where that takes long. */
  async #peek(job) {
    const begin = performance.now();
    if (!job.progress?.done || begin < this.next) return;
    this.next = Infinity;
    const found = await get(`/v1/sweeps/${job.id}/result`).catch(() => null); // no block is there yet
    if (!this.job.path?.endsWith(job.id)) return; // all is drawn
    if (found) this.#draw(job, found);
    this.next = performance.now() + Math.max(LOOK, 5 * (performance.now() - begin));
  }

  #draw(job, found) {
    if (this.shown !== job.id) this.#view(job);
    this.view.show(found);
  }

  async #show(job) {
    const path = `/v1/sweeps/${job.id}/result`;
    this.#draw(job, await get(path));
    const name = `sweep-${job.id.slice(-6)}`;
    const buttons = FILES.map(([format, text, ending]) =>
      downloadButton(text, `${path}?format=${format}`, `${name}.${ending}`, this.parts.problem),
    );
    this.result.append(el("p", { className: "downloads" }, el("span", { className: "hint" }, "Download "), ...buttons));
  }
}
