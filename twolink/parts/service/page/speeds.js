// Start velocities: a number for each degree of freedom.

import { el } from "./dom.js";
import { numberSlider } from "./inputs.js";
import { V_PARTS } from "./joint_parts.js";

/** The velocities of all degrees of freedom, as one list. */
export function speedsOf(robot, v) {
  return robot.joints.flatMap(joint => [v[joint.name] ?? Array(joint.v[1] - joint.v[0]).fill(0)].flat());
}

/** Fill the list. v: values by joint, as scenes have them. onChange(joint, value): in the same form. */
export function listSpeeds(host, robot, v, onChange) {
  const rows = robot.joints
    .filter(joint => joint.layout !== "mimic")
    .flatMap(joint => {
      const size = joint.v[1] - joint.v[0];
      const values = [v[joint.name] ?? Array(size).fill(0)].flat();
      return values.map((value, k) => {
        const name = V_PARTS[joint.layout]?.[k];
        const unit = (name ? name.startsWith("v") : joint.kind === "prismatic") ? "m/s" : "rad/s";
        const part = name ? `${name}, ${unit}` : unit;
        const label = `${joint.name}: velocity, ${part}`;
        const change = to => {
          values[k] = to;
          onChange(joint.name, size === 1 ? to : [...values]);
        };
        return el(
          "label",
          { className: "speed-row" },
          el("span", { className: "name", title: joint.name }, joint.name),
          numberSlider(value, change, label),
          el("span", { className: "unit" }, part),
        );
      });
    });
  host.replaceChildren(...(rows.length ? rows : [el("p", { className: "hint" }, "No joint of it moves.")]));
}
