// Sliders for a robot's configuration, whatever its joints: angles for continuous joints, roll, pitch and yaw for free ones.

import { el, short } from "./dom.js";

const TURN = Math.PI;
const LONG = 13; // letters of a name from which on it has a line of its own

/** What a joint's sliders show, and how they make its part of q: {name, unit, low, high, value} each. */
function knobs(joint, part) {
  const turns = joint.kind !== "prismatic";
  const limit = (k, fallback) => {
    const [low, high] = [joint.lower[k], joint.upper[k]];
    const bounded = low !== null && high !== null && low < high && high - low <= (turns ? 8 * TURN : 20);
    return bounded ? [low, high] : fallback;
  };
  const angle = (name, value) => ({ name, unit: "rad", range: [-TURN, TURN], value });
  const length = (name, value, k) => ({ name, unit: "m", range: limit(k, [-2, 2]), value });
  switch (joint.layout) {
    case "cos-sin":
      return [angle("", Math.atan2(part[1], part[0]))];
    case "planar":
      return [length("x", part[0], 0), length("y", part[1], 1), angle("angle", Math.atan2(part[3], part[2]))];
    case "quaternion":
      return euler(part).map((value, k) => angle(["roll", "pitch", "yaw"][k], value));
    case "free-flyer":
      return [
        ...["x", "y", "z"].map((name, k) => length(name, part[k], k)),
        ...euler(part.slice(3)).map((value, k) => angle(["roll", "pitch", "yaw"][k], value)),
      ];
    case "vector":
      return part.map((value, k) => ({
        name: part.length > 1 ? String(k) : "",
        unit: turns ? "rad" : "m",
        range: limit(k, turns ? [-TURN, TURN] : [-1, 1]),
        value,
      }));
    default:
      return []; // a mimic joint moves with another
  }
}

function assemble(joint, values) {
  switch (joint.layout) {
    case "cos-sin":
      return [Math.cos(values[0]), Math.sin(values[0])];
    case "planar":
      return [values[0], values[1], Math.cos(values[2]), Math.sin(values[2])];
    case "quaternion":
      return quaternion(values);
    case "free-flyer":
      return [...values.slice(0, 3), ...quaternion(values.slice(3))];
    default:
      return values;
  }
}

function quaternion([roll, pitch, yaw]) {
  const [cr, sr, cp, sp, cy, sy] = [roll, pitch, yaw].flatMap(x => [Math.cos(x / 2), Math.sin(x / 2)]);
  return [
    sr * cp * cy - cr * sp * sy,
    cr * sp * cy + sr * cp * sy,
    cr * cp * sy - sr * sp * cy,
    cr * cp * cy + sr * sp * sy,
  ];
}

function euler([x, y, z, w]) {
  const sine = Math.min(1, Math.max(-1, 2 * (w * y - z * x)));
  return [
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
    Math.asin(sine),
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
  ];
}

/** How many letters all names begin with, up to a separator, such as "panda_". They are left out. */
function commonPrefix(names) {
  if (names.length < 2) return 0;
  const [first, last] = [[...names].sort()[0], [...names].sort().at(-1)];
  let same = 0;
  while (same < first.length && first[same] === last[same]) same++;
  return /^(.*[_./-])/.exec(first.slice(0, same))?.[1].length ?? 0;
}

export class Sliders {
  /** onChange(q, joint) is called when the user moves one. */
  constructor(host, onChange) {
    this.host = host;
    this.onChange = onChange;
    this.q = [];
  }

  /** Show a robot's joints at q. */
  set(robot, q) {
    this.robot = robot;
    this.q = [...q];
    this.prefix = commonPrefix(robot.joints.map(joint => joint.name));
    const rows = robot.joints.flatMap(joint => this.#joint(joint));
    this.host.replaceChildren(...(rows.length ? rows : [el("p", { className: "hint" }, "No joint of it moves.")]));
  }

  /** The part of q of a joint, as scenes take it. */
  part(joint) {
    const part = this.q.slice(...joint.q);
    return part.length === 1 ? part[0] : part;
  }

  #joint(joint) {
    const shown = knobs(joint, this.q.slice(...joint.q));
    const values = shown.map(knob => knob.value);
    return shown.map((knob, k) => {
      const label = [joint.name, knob.name].filter(Boolean).join(" ");
      const low = Math.min(knob.range[0], knob.value),
        high = Math.max(knob.range[1], knob.value);
      const step = Number(((high - low) / 400).toPrecision(1));
      const range = el("input", { type: "range", min: low, max: high, step: "any", value: knob.value });
      range.setAttribute("aria-label", `${label}, ${knob.unit}`);
      const exact = el("input", { type: "number", step: "any", value: short(knob.value, 4).replace("−", "-") });
      exact.setAttribute("aria-label", `${label}, exactly, ${knob.unit}`);
      const moved = value => {
        values[k] = value;
        this.q.splice(joint.q[0], joint.q[1] - joint.q[0], ...assemble(joint, values));
        this.onChange(this.q, joint);
      };
      range.addEventListener("input", () => {
        const value = Number(Number(range.value).toFixed(Math.max(0, -Math.floor(Math.log10(step)))));
        exact.value = value;
        moved(value);
      });
      range.addEventListener("keydown", event => {
        // "any" has no step of its own for the arrow keys
        const direction = { ArrowLeft: -4, ArrowDown: -4, ArrowRight: 4, ArrowUp: 4 }[event.key];
        if (!direction) return;
        event.preventDefault();
        range.value = Number(range.value) + direction * step;
        range.dispatchEvent(new Event("input"));
      });
      exact.addEventListener("change", () => {
        const value = Number(exact.value);
        if (exact.value === "" || !Number.isFinite(value)) return;
        range.min = Math.min(range.min, value);
        range.max = Math.max(range.max, value);
        range.value = value;
        moved(value);
      });
      return el(
        "div",
        { className: label.length - this.prefix > LONG ? "slider long" : "slider" },
        el("span", { className: "name", title: label }, label.slice(this.prefix)),
        range,
        exact,
        el("span", { className: "unit" }, knob.unit),
      );
    });
  }
}
