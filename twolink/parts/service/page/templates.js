// Effects that can be added to a robot, with values to start from.

const G = -9.81;

/** Effects by their names in the list. robot: its description. q: its configuration. place: its tip's, [x, y, z, qx, qy,
 * qz, qw], m. constants: its physical constants by name. */
export function templates({ robot, q, place, constants }) {
  const single = robot.joints.filter(joint => joint.v[1] - joint.v[0] === 1 && joint.layout !== "mimic");
  const lines = single.filter(joint => joint.q[1] - joint.q[0] === 1);
  const fixed = new Set(robot.fixed_links);
  const tip = robot.links.filter(link => !fixed.has(link)).at(-1);
  const all = {};
  const add = (group, name, effect) => {
    (all[group] ??= {})[name] = effect;
  };
  const each = (joints, value) => Object.fromEntries(joints.map(joint => [joint.name, value(joint)]));
  const at = joint => q[joint.q[0]];

  add("Forces", "Gravity", { type: "gravity", field: [0, 0, G] });
  if (single.length) {
    add("In the joints", "Damping", { type: "joint-damping", damping: each(single, () => 0.5) });
    if (lines.length) add("In the joints", "Springs", { type: "joint-spring", stiffness: each(lines, () => 10) });
    add("In the joints", "Dry friction, which sticks", { type: "dry-friction", kinetic: each(single, () => 0.5) });
    add("In the joints", "Smooth friction", { type: "smooth-friction", friction: each(single, () => 0.5) });
    if (lines.length) add("In the joints", "Stops", { type: "joint-stops", limits: each(lines, stops(at)), restitution: 0.3 });
    add("In the joints", "Inertia of motors", { type: "rotor", inertia: each(single, () => 1e-4), ratio: each(single, () => 50) });
    if (lines.length) add("In the joints", "A detent", { type: "detent", joint: lines[0].name, torque: 1, positions: [at(lines[0])] });
    if (lines.length > 1) {
      const [a, b] = lines;
      const offset = at(a) - at(b);
      add("In the joints", "Two joints geared together", { type: "coupling", joint: a.name, other: b.name, ratio: 1, offset });
    }
    add("Motors and controllers", "A sine torque", {
      type: "torque",
      inputs: { [single[0].name]: { kind: "sine", amplitude: 2, frequency: 3 } },
    });
    if (lines.length) {
      const [target, kp, kd] = [each(lines, at), each(lines, () => 100), each(lines, () => 10)];
      add("Motors and controllers", "PD control, to where it starts", { type: "joint-pd", target, kp, kd });
    }
    if (lines.length === robot.joints.length) {
      const path = each(lines, at);
      add("Motors and controllers", "Computed torque, to where it starts", { type: "computed-torque", path, kp: 100, kd: 20 });
    }
    add("Motors and controllers", "Motors that carry the weight", { type: "gravity-compensation" });
    if (lines.length) {
      const [kp, kd] = [100, 10];
      const row = ({ v: [k] }) => Array.from({ length: 2 * robot.nv }, (_, i) => (i === k ? kp : i === robot.nv + k ? kd : 0));
      const feedback = { type: "state-feedback", gain: each(lines, row), target: [...q] };
      add("Motors and controllers", "State feedback, to where it starts", feedback);
      add("Motors and controllers", "State feedback from 1 s on", { type: "engage", at: 1, of: feedback });
    }
  }
  if (tip) {
    const payload = { type: "payload", frame: tip, mass: 1 };
    add("Forces", `A push on ${tip}`, { type: "frame-wrench", frame: tip, force: [10, 0, 0] });
    add("Forces", `Air drag on ${tip}`, { type: "air-drag", frame: tip, area: 0.01 });
    add("Bodies", `A load of 1 kg on ${tip}`, payload);
    add("Bodies", `A load on ${tip}, let go after 0.5 s`, { type: "release", at: 0.5, of: payload });
    const [x, y, z] = place;
    const turn = place.slice(3);
    const point = [x, y, z];
    const ends = { first: tip, second: "universe", second_point: [x, y, z + 1] };
    add("Forces", `A spring from ${tip} upwards`, { type: "spring-between", ...ends, stiffness: 20, rest_length: 1, damping: 1 });
    add("Bodies", `A floor below ${tip}`, { type: "plane-contact", frame: tip, height: z - 0.3, restitution: 0.5, friction: 0.4 });
    const ground = { kind: "plane", normal: [0, 0, 1], height: z - 0.3 };
    const ball = { [tip]: [{ kind: "sphere", radius: 0.05 }] };
    add("Bodies", `${tip} as a ball that touches a floor`, { type: "contact", pairs: [[tip, ground]], shapes: ball, friction: 0.4, restitution: 0.5 });
    const joined = { a: tip, b: "universe", point_b: point };
    add("Closed loops", `${tip} pinned where it is, free to turn`, { type: "point-loop", ...joined });
    add("Closed loops", `${tip} on a hinge along y`, { type: "hinge-loop", ...joined, axis_a: along(turn), axis_b: [0, 1, 0] });
    add("Closed loops", `${tip} welded where it is`, { type: "weld-loop", ...joined, rpy: anglesOf(turn) });
  }
  const masses = Object.entries(constants).filter(([name]) => name.endsWith(".mass"));
  if (tip) add("Bodies", "Other masses", { type: "constants", values: Object.fromEntries(masses) });
  if (lines.length) {
    const [first] = lines;
    const when = { kind: "joint-reaches", joint: first.name, value: at(first) - 0.5 };
    add("Other", `Note when ${first.name} passes an angle`, { type: "watch", name: "passes", when });
  }
  return all;
}

/** A joint's limits, or 3 rad or m to each side where it has none or starts outside. */
function stops(at) {
  return joint => {
    const [low, high] = [joint.lower[0], joint.upper[0]];
    return low !== null && high !== null && low < at(joint) && at(joint) < high ? [low, high] : [at(joint) - 3, at(joint) + 3];
  };
}

/** The world's y axis in the axes of a link that is turned by a quaternion. */
function along([x, y, z, w]) {
  return [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)];
}

/** Roll, pitch, yaw of a quaternion, as in URDF, rad. */
function anglesOf([x, y, z, w]) {
  return [
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
    Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - z * x)))),
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
  ];
}
