// Settings of a run: the scene with its accuracy, method and precision. Two of them are compared by what they mean.

const SCENE = { title: "", objects: [], duration: 10, q: {}, v: {}, effects: [] }; // what a scene leaves out
const RUN = { accuracy: 1e-6, method: "auto", precision: "auto", simulator: "twolink" };
const WORDS = {
  robot: "robot",
  objects: "objects",
  duration: "duration",
  q: "start",
  v: "start velocities",
  effects: "effects",
  accuracy: "accuracy",
  method: "method",
  precision: "precision",
  simulator: "simulator",
};

/** A value as text, the same for equal values whatever the order of their keys. */
export function canonical(value) {
  if (Array.isArray(value)) return `[${value.map(canonical).join()}]`;
  if (value === null || typeof value !== "object") return JSON.stringify(value ?? null);
  const entries = Object.keys(value)
    .sort()
    .filter(key => value[key] !== undefined);
  return `{${entries.map(key => `${key}:${canonical(value[key])}`).join()}}`;
}

/** The parts of a request for a run that decide its result, by name. */
function parts(request) {
  const scene = { ...SCENE, ...request.scene };
  if (request.duration) scene.duration = request.duration;
  if (typeof scene.robot === "string") scene.robot = { source: scene.robot };
  const run = Object.fromEntries(Object.keys(RUN).map(name => [name, request[name] ?? RUN[name]]));
  return { ...scene, ...run };
}

/** In which parts two requests differ, in words. */
export function differences(one, other) {
  const [a, b] = [parts(one), parts(other)];
  return Object.keys(WORDS)
    .filter(name => canonical(a[name]) !== canonical(b[name]))
    .map(name => WORDS[name]);
}
