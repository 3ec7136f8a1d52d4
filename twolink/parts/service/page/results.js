// The results of a run: a summary, plots with one time axis, events, downloads; and runs kept to compare with.

import { downloadButton } from "./api.js";
import { locate } from "./axes.js";
import { CurveChoice } from "./curves.js";
import { announce, byId, count, el, seconds, short } from "./dom.js";
import { Plot } from "./plots.js";
import { byMotion, samplesOf, unitOf } from "./samples.js";

const FILES = [
  ["csv", "CSV"],
  ["parquet", "Parquet"],
  ["npz", "NumPy"],
];

export class Results {
  /** onPoint(t, kind) is called when the user points at a time in a plot. onKeep(): the run shown is to be kept. */
  constructor(onPoint, onKeep) {
    Object.assign(this, { onPoint, onKeep });
    this.plots = [];
    this.kept = [];
    this.choice = new CurveChoice(byId("curves"), () => this.#showChosen());
  }

  clear() {
    byId("empty").hidden = false;
    byId("result").hidden = true;
    this.job = this.samples = null;
    this.outdated([]);
  }

  /** Show the curves of a finished simulation, or of a look at one, which has no id. */
  show(job, joints, columns) {
    const samples = samplesOf(columns, joints);
    Object.assign(this, { job, joints, samples });
    byId("empty").hidden = true;
    byId("result").hidden = false;
    this.outdated([]);
    this.events = job.result.events.map(event => ({ t: event.t, text: wordsOf(event) }));
    this.#summary(job.result);
    this.choice.set(byMotion(samples));
    this.#draw();
    this.#events(this.events);
    this.#downloads(job);
    if (job.id === null) return; // one look follows another
    const { error, bound } = job.result;
    const kind = bound === "estimated" ? "about" : "at most";
    announce(`The run is done${error === null ? "" : `: error ${kind} ${short(error, 2)}`}. The robot plays.`);
  }

  /** Say that the curves are not those of the settings. words: what differs; none: they are. */
  outdated(words) {
    byId("stale").hidden = !words.length;
    byId("stale-what").textContent = words.join(", ");
    byId("result").classList.toggle("stale", words.length > 0);
  }

  /** Draw the curves of other runs too: [{name, samples}]. */
  compare(kept) {
    this.kept = kept;
    if (this.samples) this.#draw();
  }

  /** The largest difference of an entry of q between the run shown and another, at each time; NaN after its end. */
  distance(samples) {
    const far = this.samples.t.map(t => (t > samples.t.at(-1) ? NaN : 0));
    for (const line of [...this.samples.q, ...this.samples.turn]) {
      const other = [...samples.q, ...samples.turn].find(each => each.name === line.name);
      if (!other) continue;
      this.samples.t.forEach((t, k) => {
        const [i, part] = locate(samples.t, t);
        const [a, b] = [other.values[i], other.values[Math.min(i + 1, other.values.length - 1)]];
        far[k] = Math.max(far[k], Math.abs(line.values[k] - (a + part * (b - a))));
      });
    }
    return far;
  }

  #summary(result) {
    const { cost, error } = result;
    const unit = unitOf(this.joints).replace(", ", " or ");
    const missed = result.trusted_until !== null && result.trusted_until < result.duration * (1 - 1e-9);
    const facts = [
      [
        "Error of q",
        error === null ? "not verified" : `${result.bound === "estimated" ? "about" : "≤"} ${short(error, 2)} ${unit}`,
        error === null ? "" : result.accuracy === null ? "" : error > result.accuracy ? "bad" : "good",
      ],
      result.trusted_until !== null && [
        "Trusted",
        missed ? `until ${short(result.trusted_until)} s` : "to the end",
        missed ? "bad" : "",
      ],
      ["Motion", `${short(result.duration, 4)} s, ${count(result.samples, "sample")}`],
      ["Method", cost ? `${cost.method}, ${count(cost.steps, "step")}` : result.setting],
      cost && [
        "Computing",
        seconds(cost.seconds) +
          (error === null ? "" : ` + ${seconds(cost.verify_seconds)} for the error bar`) +
          (cost.compile_seconds > 0.001 ? `, prepared in ${seconds(cost.compile_seconds)}` : ""),
      ],
      ["Energy changes by", `${short(result.energy_drift, 2)} J`],
    ];
    byId("summary").replaceChildren(
      ...facts.filter(Boolean).map(([name, value, kind = ""]) =>
        el("div", { className: kind }, el("dt", {}, name), el("dd", {}, value)),
      ),
    );
    byId("results-title").textContent = result.title || "Motion";
  }

  #draw() {
    const { accuracy, trusted_until: trusted, duration } = this.job.result;
    const others = this.kept.filter(({ job }) => job.id !== this.job.id);
    this.samples.distance = others.map(({ job, samples }) => ({
      name: job.result.setting ?? (job.result.accuracy === null ? job.result.cost.method : `at ${short(job.result.accuracy, 1)}`),
      joint: null,
      values: this.distance(samples),
    }));
    const kinds = [
      { key: "q", title: "q", unit: unitOf(this.joints) },
      { key: "turn", title: "Orientation", unit: "cos, sin, quaternion" },
      { key: "v", title: "v", unit: unitOf(this.joints, "/s") },
      { key: "tau", title: "Torque", unit: unitOf(this.joints, "", ["N m", "N"]) },
      { key: "energy", title: "Energy", unit: "J" },
      { key: "distance", title: "Distance of q", unit: `to the other run, ${unitOf(this.joints).replace(", ", " or ")}`, log: true },
      { key: "error", title: "Error bar", unit: `of q, ${unitOf(this.joints).replace(", ", " or ")}`, log: true },
    ].filter(({ key }) => this.samples[key].length);
    const drawn = kinds.map(({ key, unit }) => key + unit).join();
    if (drawn !== this.drawn) {
      byId("plots").replaceChildren();
      this.plots = kinds.map(kind => this.#plot(kind));
      this.drawn = drawn;
    }
    const runs = this.kept.map(({ samples }) => samples);
    const trust = trusted !== null && trusted < duration * (1 - 1e-9) ? [{ t: trusted, text: "trusted until here", sign: "trusted until here" }] : [];
    for (const plot of this.plots) {
      const series = ["error", "distance"].includes(plot.key) ? [] : runs.map(run => ({ t: run.t, series: run[plot.key] }));
      plot.level = plot.key === "error" && accuracy !== null ? { value: accuracy, text: `asked for: ${short(accuracy, 1)}` } : null;
      plot.setData(this.samples.t, this.samples[plot.key], [...this.events, ...(plot.key === "error" ? trust : [])], series);
    }
    this.#showChosen();
  }

  #plot(kind) {
    const plot = new Plot(byId("plots"), {
      ...kind,
      onZoom: (from, to) => this.zoom(from, to),
      onPoint: (t, how) => {
        this.onPoint(t, how);
        if (how !== "key") return;
        const shown = plot.series.filter(line => !plot.hidden.has(line.name)).slice(0, 4);
        const values = shown.map(line => `${line.name} ${short(plot.value(line, t), 3)}`);
        announce(`${values.join(", ")} at ${short(t)} s`);
      },
    });
    plot.key = kind.key;
    if (kind.key === "error") plot.canvas.parentElement.classList.add("grows"); // it follows the curves
    return plot;
  }

  #showChosen() {
    for (const plot of this.plots) plot.show(line => line.joint === null || this.choice.shown.has(line.joint));
  }

  zoom(from, to) {
    for (const plot of this.plots) plot.setWindow(from, to);
  }

  cursor(t) {
    for (const plot of this.plots) plot.setCursor(t);
  }

  #events(events) {
    const rows = events.map(event =>
      el(
        "li",
        {},
        el(
          "button",
          {
            type: "button",
            className: "event",
            title: "Show this moment",
            onclick: () => this.onPoint(event.t, "click"),
          },
          el("span", { className: "event-time" }, `${short(event.t, 6)} s`),
          el("span", {}, event.text),
        ),
      ),
    );
    byId("events").replaceChildren(
      ...(rows.length
        ? [
            el("h3", {}, count(rows.length, "event"), el("span", { className: "hint" }, " dashed in the plots")),
            el("ol", { className: "events" }, ...rows),
          ]
        : []),
    );
  }

  #downloads(job) {
    byId("downloads").hidden = job.id === null;
    const path = `/v1/simulations/${job.id}`;
    const button = (text, address, name) => downloadButton(text, address, name, byId("run-problem"));
    const name = `${job.result.robot}-${job.id?.slice(-6)}`;
    byId("downloads").replaceChildren(
      el("button", { type: "button", id: "keep", onclick: () => this.onKeep() }, "Keep to compare"),
      el("span", { className: "hint" }, "Download "),
      ...FILES.map(([format, text]) => button(text, `${path}/result?format=${format}`, `${name}.${format}`)),
      button("Figure", `${path}/figure?format=svg`, `${name}.svg`),
      button("Page that plays it", `${path}/playback`, `${name}.html`),
    );
  }
}

/** An event in a line: {kind, what, detail, energy} -> "impact: ball, at 2 m/s, 0.3 J lost" */
function wordsOf({ kind, what, detail, energy }) {
  return `${kind}: ${what}${detail && `, ${detail}`}${energy ? `, ${short(Math.abs(energy), 6)} J ${energy > 0 ? "lost" : "gained"}` : ""}`;
}
