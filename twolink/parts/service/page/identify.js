// Parameters from measurements: a CSV file, the fit with its intervals, and what is left of the torques.

import { byId, el, short, showProblem, table } from "./dom.js";
import { Job, jobControls } from "./jobs.js";
import { settingsForm } from "./operations.js";
import { Plot } from "./plots.js";

const SETTINGS = ["method", "half_window", "cutoff", "confidence"];
const SHOWN = 8; // joints in the figures

export class Identify {
  /** getRobot(): the robot above. */
  constructor(getRobot) {
    this.file = el("input", { type: "file", id: "identify-file", accept: ".csv,text/csv", className: "visually-hidden" });
    this.name = el("span", { className: "hint", id: "identify-name" }, "columns t, q0, q1, … or q.JOINT, and so on for tau, v and a");
    this.file.addEventListener("change", () => {
      if (this.file.files.length) this.name.textContent = this.file.files[0].name;
    });
    this.parameters = el("input", { type: "text", id: "identify-parameters", spellcheck: false, autocomplete: "off" });
    this.parameters.placeholder = "all; or names such as forearm.mass";
    this.settings = {};
    const settings = el("details", {}, el("summary", {}, "Settings"));
    settingsForm(settings, "IdentificationRequest", SETTINGS, {}, to => (this.settings = to), "Identification");
    const { node, parts } = jobControls("identify", "Identify");
    this.result = el("div", { id: "identify-result" });
    byId("panel-identify").append(
      el(
        "p",
        { className: "hint" },
        "Masses, inertias and friction of the robot above from measured motions and torques, with intervals; what the motion cannot show is named, not fitted.",
      ),
      el("p", { className: "upload" }, this.file, el("label", { className: "button", for: "identify-file" }, "Choose a CSV file"), this.name),
      el("label", { className: "row" }, "Parameters ", this.parameters),
      settings,
      node,
      this.result,
    );
    this.job = new Job("identifications", parts, job => this.#show(job));
    parts.start.addEventListener("click", async () => {
      if (!this.file.files.length) {
        const remedy = "Choose a CSV file of measurements first.";
        showProblem(parts.problem, Object.assign(new Error("there is no file"), { remedy }));
        return;
      }
      const names = this.parameters.value.split(/[\s,;]+/).filter(Boolean);
      const data = await this.file.files[0].text();
      this.robot = getRobot();
      const asked = { robot: this.robot.id, data, ...this.settings };
      this.job.run(names.length ? { ...asked, parameters: names } : asked);
    });
  }

  #show(job) {
    const { found, confidence, condition, correlated, samples, curves } = job.result;
    const percent = `${100 * confidence} %`;
    const cannot = [...job.result.not_identifiable, ...job.result.not_excited.map(text => `${text} (not excited by these data)`)];
    const heads = Object.keys(found[0] ?? {});
    const place = el("div", { className: "plots" });
    this.result.replaceChildren(
      el(
        "p",
        { id: "identify-verdict" },
        el("b", {}, `${found.length} found from ${samples} samples.`),
        ` Condition ${short(condition)}${condition > 100 ? ": the motion excites poorly" : ""}.` +
          (correlated ? " The residuals follow each other in time: forces may be missing, such as friction; the intervals allow for it." : ""),
      ),
      table(
        `What was found, with intervals of ${percent}`,
        heads.map(head => head.replaceAll("_", " ")),
        found.map(row => heads.map(head => (typeof row[head] === "number" ? short(row[head], 5) : String(row[head] ?? "")))),
      ),
      place,
      cannot.length
        ? el("details", {}, el("summary", {}, `What cannot be told: ${cannot.length}`), el("ul", { className: "plain" }, ...cannot.map(text => el("li", {}, text))))
        : "",
    );
    this.#draw(place, curves);
  }

  #draw(place, { t, residuals, tau }) {
    const dofs = this.robot.joints.flatMap(joint =>
      Array.from({ length: joint.v[1] - joint.v[0] }, (_, k) => ({ name: joint.name + (k ? `.${k}` : ""), at: joint.v[0] + k })),
    );
    const onZoom = (from, to) => plots.forEach(plot => plot.setWindow(from, to));
    const onPoint = time => plots.forEach(plot => plot.setCursor(time));
    const lines = values => dofs.slice(0, SHOWN).map(({ name, at }) => ({ name, colour: at, values: values.map(row => row[at]) }));
    const fitted = tau.map((row, i) => row.map((x, k) => x - residuals[i][k]));
    const plots = [
      new Plot(place, { title: "Torque", unit: "N m or N: fitted, and dashed measured", onZoom, onPoint }),
      new Plot(place, { title: "Residual", unit: "N m or N: measured minus fitted", onZoom, onPoint }),
    ];
    plots[0].setData(t, lines(fitted), [], [{ t, series: lines(tau) }]);
    plots[1].setData(t, lines(residuals));
  }
}
