// How much a motion depends on a mass, a gain or its start: its derivatives, as a tube of one per cent around it.

import { byId, el, short, table } from "./dom.js";
import { Job, jobControls } from "./jobs.js";
import { Picker } from "./picker.js";
import { Plot } from "./plots.js";

const MOST = 6;
const SHARE = 0.01; // of the quantity
const START = 0.01; // rad or m, or of velocities: per second

export class Sensitivity {
  /** getRequest(): the settings of a run. */
  constructor(getRequest) {
    this.picker = new Picker({ label: "Quantities to vary", most: MOST });
    const { node, parts } = jobControls("sense", "Differentiate");
    this.result = el("div", { id: "sense-result" });
    byId("panel-sense").append(
      el(
        "p",
        { className: "hint" },
        "Derivatives of the motion, with an error bar of their own: how far the motion of the scene above moves when one quantity does.",
      ),
      this.picker.node,
      node,
      this.result,
    );
    this.job = new Job("sensitivities", parts, job => this.#show(job));
    parts.start.addEventListener("click", () => {
      const { scene, accuracy } = getRequest();
      const samples_per_second = Math.max(50, Math.min(400, Math.ceil(400 / scene.duration)));
      this.asked = { rows: this.picker.rows };
      this.job.run({ scene, accuracy, samples_per_second, wrt: this.picker.names });
    });
  }

  /** Offer the quantities of a robot's scene. */
  set(rows, robot) {
    this.robot = robot;
    const single = new Set(robot.joints.filter(joint => joint.v[1] - joint.v[0] === 1).map(joint => joint.name));
    const usable = rows.filter(({ name, kind, value }) => {
      if (["constant", "effect"].includes(kind)) return value !== null;
      return ["q", "v"].includes(kind) && single.has(name.slice(2));
    });
    const masses = usable.filter(row => row.name.endsWith(".mass") && row.value > 0).map(row => row.name);
    const start = usable.filter(row => row.kind === "q").map(row => row.name);
    const before = this.picker.names;
    this.picker.set(usable, before.length ? before : [...masses.slice(-1), ...start.slice(0, 1)]);
  }

  #show(job) {
    const { t, samples_q: q, sensitivities } = job.result;
    const names = Object.keys(sensitivities);
    const place = el("div", { className: "plots" });
    const dofs = this.robot.joints.flatMap(joint =>
      joint.v[1] - joint.v[0] === 1 && joint.q[1] - joint.q[0] === 1 ? [{ joint, q: joint.q[0], v: joint.v[0] }] : [],
    );
    const draw = name => {
      const step = this.#step(name);
      const series = dofs.slice(0, 8).map(({ joint, q: i, v: k }) => {
        const values = q.map(row => row[i]);
        const wide = sensitivities[name].q.map(row => Math.abs(row[k][0]) * step);
        const edge = sign => values.map((value, n) => value + sign * wide[n]);
        return { name: joint.name, values, colour: k, band: [edge(-1), edge(1)] };
      });
      const derivatives = dofs.slice(0, 8).map(({ joint, v: k }) => ({
        name: joint.name,
        colour: k,
        values: sensitivities[name].q.map(row => row[k][0]),
      }));
      place.replaceChildren();
      const onZoom = (from, to) => plots.forEach(plot => plot.setWindow(from, to));
      const onPoint = time => plots.forEach(plot => plot.setCursor(time));
      const plots = [
        new Plot(place, { title: "q", unit: `with what ${this.#change(name)} does`, onZoom, onPoint }),
        new Plot(place, { title: `dq / d ${name}`, unit: "SI units", onZoom, onPoint }),
      ];
      plots[0].setData(t, series);
      plots[1].setData(t, derivatives);
    };
    const choice = el("select", { id: "sense-name" }, ...names.map(name => el("option", {}, name)));
    choice.addEventListener("change", () => draw(choice.value));
    this.result.replaceChildren(
      el("label", { className: "row" }, "Tube of ", choice),
      place,
      table(
        "The largest effect on any joint until the end",
        ["Quantity", "Change", "q moves by up to", "dq / d quantity", "Error bar"],
        names.map(name => this.#row(name, sensitivities[name])),
      ),
    );
    draw(names[0]);
  }

  #row(name, { q, error }) {
    const largest = Math.max(...q.map(row => Math.max(...row.map(dof => Math.abs(dof[0])))));
    return [name, this.#change(name), short(largest * this.#step(name), 3), short(largest, 4), `± ${short(error.at(-1), 2)}`];
  }

  /** How far a quantity is moved: one per cent, or 0.01 at the start and where it is 0. */
  #step(name) {
    const { value } = this.#rowOf(name);
    return this.#byShare(name) ? Math.abs(SHARE * value) : START;
  }

  #change(name) {
    return this.#byShare(name) ? `± 1 % of ${name}` : `± ${START} ${this.#rowOf(name).unit} of ${name}`;
  }

  #byShare(name) {
    const { kind, value } = this.#rowOf(name);
    return !["q", "v"].includes(kind) && value;
  }

  #rowOf(name) {
    return this.asked.rows.find(row => row.name === name);
  }
}
