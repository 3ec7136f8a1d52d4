// The samples of a run as curves: each with its joint, under names that say what the parts of q and v are.

import { get } from "./api.js";
import { range } from "./axes.js";
import { Q_PARTS, TAU_PARTS, V_PARTS } from "./joint_parts.js";

const POINTS = 2000;
const NO_TORQUE = 1e-9; // N m or N: less is rounding
const PARTS = { q: Q_PARTS, v: V_PARTS, tau: TAU_PARTS };
const TURN = /^(q[xyzw]|cos|sin)$/; // parts of an orientation, which have no unit

/** The samples of a job that is done, as columns. */
export async function columnsOf(job) {
  return (await get(`/v1/simulations/${job.id}/result?format=json&points=${POINTS}`)).columns;
}

/** {t, q, turn, v, tau, energy, error}: lists of {name, joint, colour, values}. turn: parts of orientations. tau: of what
 * acts at the joints, nothing where that is 0. */
export function samplesOf(columns, joints) {
  const out = { t: columns.t, q: [], turn: [], v: [], tau: [], energy: [], error: [] };
  const layouts = new Map(joints.map(joint => [joint.name, joint.layout]));
  const places = new Map(joints.map(joint => [joint.name, joint.v[0]]));
  for (const [column, values] of Object.entries(columns)) {
    if (column in out && column !== "t") out[column].push({ name: column, joint: null, colour: 0, values });
    const [, letter, name] = /^(q|v|tau)\.(.*)$/.exec(column) ?? [];
    if (!letter) continue;
    const numbered = /^(.*)\.(\d+)$/.exec(name);
    const part = numbered && PARTS[letter][layouts.get(numbered[1])]?.[Number(numbered[2])];
    const joint = part ? numbered[1] : layouts.has(name) ? name : (numbered?.[1] ?? name);
    const colour = (places.get(joint) ?? 0) + Number(numbered?.[2] ?? 0);
    const kind = part && TURN.test(part) ? "turn" : letter;
    out[kind].push({ name: part ? `${joint} ${part}` : name, joint, colour, values });
  }
  out.tau = out.tau.filter(line => line.values.some(value => Math.abs(value) > NO_TORQUE));
  return out;
}

/** The joints, those that move most first. */
export function byMotion(samples) {
  const moved = new Map();
  for (const { joint, values } of [...samples.q, ...samples.turn]) {
    const [low, high] = range(values);
    moved.set(joint, Math.max(moved.get(joint) ?? 0, high - low));
  }
  return [...moved.keys()].sort((a, b) => moved.get(b) - moved.get(a));
}

/** The unit of q: rad, m, or both. v's: the same with "/s". turning, sliding: the units of other values. */
export function unitOf(joints, suffix = "", [turning, sliding] = ["rad", "m"]) {
  const both = joints.some(joint => ["free-flyer", "planar"].includes(joint.layout));
  const slides = joints.map(joint => joint.kind === "prismatic");
  if (both || (slides.includes(true) && slides.includes(false))) return `${turning}${suffix}, ${sliding}${suffix}`;
  return (slides.includes(true) ? sliding : turning) + suffix;
}
