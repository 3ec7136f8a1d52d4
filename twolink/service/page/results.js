// The results of a run: a summary, four plots with one time axis, events, downloads.

import { download, get } from "./api.js";
import { announce, byId, count, el, seconds, short, showProblem } from "./dom.js";
import { Plot } from "./plots.js";

const KINDS = [
  { title: "q", unit: "rad, m", prefix: "q." },
  { title: "v", unit: "rad/s, m/s", prefix: "v." },
  { title: "Energy", unit: "J", prefix: "energy" },
  { title: "Error bar", unit: "of q, rad or m", prefix: "error", log: true },
];
const POINTS = 2000;
const FILES = [
  ["csv", "CSV"],
  ["parquet", "Parquet"],
  ["npz", "NumPy"],
];

export class Results {
  /** onPoint(t, kind) is called when the user points at a time in a plot. */
  constructor(onPoint) {
    this.onPoint = onPoint;
    this.plots = [];
  }

  clear() {
    byId("empty").hidden = false;
    byId("result").hidden = true;
    this.job = null;
  }

  /** Fetch and show the curves of a finished simulation. */
  async show(job, joints) {
    const { columns } = await get(`/v1/simulations/${job.id}/result?format=json&points=${POINTS}`);
    this.job = job;
    byId("empty").hidden = true;
    byId("result").hidden = false;
    const events = job.result.events.map(event => ({ t: event.t, text: wordsOf(event) }));
    this.#summary(job.result);
    this.moments = events;
    this.#draw(renamed(columns, joints), events);
    this.#events(events);
    this.#downloads(job);
    const { error } = job.result;
    announce(`The run is done${error === null ? "" : `: error ${job.result.bound === "estimated" ? "about" : "at most"} ${short(error, 2)}`}. The robot plays.`);
  }

  #summary(result) {
    const { cost, error } = result;
    const missed = result.trusted_until < result.duration * (1 - 1e-9);
    const facts = [
      [
        "Error",
        error === null ? "not estimated" : result.bound === "estimated" ? `about ${short(error, 2)}` : `≤ ${short(error, 2)}`,
        error !== null && error > result.accuracy ? "bad" : "good",
      ],
      ["Trusted", missed ? `until ${short(result.trusted_until)} s` : "to the end", missed ? "bad" : ""],
      ["Motion", `${short(result.duration, 4)} s, ${count(result.samples, "sample")}`],
      ["Method", `${cost.method}, ${count(cost.steps, "step")}`],
      [
        "Computing",
        `${seconds(cost.seconds)} + ${seconds(cost.verify_seconds)} for the error bar` +
          (cost.compile_seconds > 0.001 ? `, compiled in ${seconds(cost.compile_seconds)}` : ""),
      ],
      ["Energy changes by", `${short(result.energy_drift, 2)} J`],
    ];
    byId("summary").replaceChildren(
      ...facts.map(([name, value, kind = ""]) =>
        el("div", { className: kind }, el("dt", {}, name), el("dd", {}, value)),
      ),
    );
    byId("results-title").textContent = result.title || "Motion";
  }

  #draw(columns, events) {
    byId("plots").replaceChildren();
    this.plots = [];
    for (const kind of KINDS) {
      const names = Object.keys(columns).filter(
        name => name === kind.prefix || (kind.prefix.endsWith(".") && name.startsWith(kind.prefix)),
      );
      if (!names.length) continue;
      const plot = new Plot(byId("plots"), {
        ...kind,
        onZoom: (from, to) => this.zoom(from, to),
        onPoint: (t, how) => {
          this.onPoint(t, how);
          if (how === "key")
            announce(
              plot.series
                .slice(0, 4)
                .map(line => `${line.name} ${short(plot.value(line, t), 3)}`)
                .join(", ") + ` at ${short(t)} s`,
            );
        },
      });
      const series = names.map(name => ({
        name: name === kind.prefix ? kind.title.toLowerCase() : name.slice(2),
        values: columns[name],
      }));
      plot.setData(columns.t, series, events);
      this.plots.push(plot);
    }
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
    const path = `/v1/simulations/${job.id}`;
    const button = (text, address, name) =>
      el(
        "button",
        {
          type: "button",
          className: "quiet",
          onclick: () => {
            download(address, name).catch(failure => showProblem(byId("run-problem"), failure));
          },
        },
        text,
      );
    const name = `${job.result.robot}-${job.id.slice(-6)}`;
    byId("downloads").replaceChildren(
      el("span", { className: "hint" }, "Download "),
      ...FILES.map(([format, text]) => button(text, `${path}/result?format=${format}`, `${name}.${format}`)),
      button("Figure", `${path}/figure?format=svg`, `${name}.svg`),
      button("Page that plays it", `${path}/playback`, `${name}.html`),
    );
  }
}

const PARTS = {
  "q free-flyer": ["x", "y", "z", "qx", "qy", "qz", "qw"],
  "v free-flyer": ["vx", "vy", "vz", "ωx", "ωy", "ωz"],
  "q quaternion": ["qx", "qy", "qz", "qw"],
  "v quaternion": ["ωx", "ωy", "ωz"],
  "q planar": ["x", "y", "cos", "sin"],
  "v planar": ["vx", "vy", "ω"],
  "q cos-sin": ["cos", "sin"],
};

/** The columns under names that say what the parts of q and v are: q.base.0 -> q.base x. */
function renamed(columns, joints) {
  const layouts = new Map(joints.map(joint => [joint.name, joint.layout]));
  return Object.fromEntries(
    Object.entries(columns).map(([name, values]) => {
      const match = /^([qv])\.(.*)\.(\d+)$/.exec(name);
      const part = match && PARTS[`${match[1]} ${layouts.get(match[2])}`]?.[Number(match[3])];
      return [part ? `${match[1]}.${match[2]} ${part}` : name, values];
    }),
  );
}

/** An event in a line: {kind, what, detail, energy} -> "impact ball: with the floor, 0.3 J lost" */
function wordsOf({ kind, what, detail, energy }) {
  return `${kind} ${what}${detail && `: ${detail}`}${energy ? `, ${short(energy, 6)} J lost` : ""}`;
}
