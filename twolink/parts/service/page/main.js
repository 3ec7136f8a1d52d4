// The page: connects the robot, the scene, the run and the view.

import { readAddress, writeAddress } from "./address.js";
import { get, post } from "./api.js";
import { Comparison } from "./comparison.js";
import { byId, clearProblem, debounce, el, showProblem, wireTabs } from "./dom.js";
import { Identify } from "./identify.js";
import { finished, Job, jobControls } from "./jobs.js";
import { Linear } from "./linear.js";
import { Live } from "./live.js";
import { Operations } from "./operations.js";
import { Preview } from "./preview.js";
import { QueryForm } from "./query.js";
import { Results } from "./results.js";
import { Robots } from "./robots.js";
import { OWN, SceneEditor } from "./scene.js";
import { watchService } from "./service.js";
import { columnsOf } from "./samples.js";
import { differences } from "./settings.js";
import { Sliders } from "./sliders.js";
import { Sensitivity } from "./sensitivity.js";
import { listSpeeds, speedsOf } from "./speeds.js";
import { listPast, Study } from "./study.js";
import { Sweep } from "./sweep.js";
import { Viewer } from "./viewer/viewer.js";
import { loadMeshcat } from "./viewer_script.js";

const FIRST = "arm-swing";
const FRAMES = 600;
const DRAWING = "Drawing…";

const viewer = new Viewer(byId("stage"), { onTime: t => results.cursor(t) });
const started = loadMeshcat().then(() => viewer.start()); // what is shown is asked for meanwhile
const robots = new Robots(useRobot);
const editor = new SceneEditor({ onPick: pickScene, onChange: noteChange, pose: () => ({ q: ownPart(sliders.q), ...placed }) });
const sliders = new Sliders(byId("sliders"), (q, joint) => {
  viewer.timeline.unload();
  editor.move(joint.name, sliders.part(joint));
  poseAt(q);
});
const results = new Results(
  (t, kind) => {
    if (kind === "hover" && viewer.timeline.playing) results.cursor(t);
    else {
      if (kind !== "hover") viewer.timeline.pause();
      viewer.seek(t);
    }
  },
  () => comparison.keep(results.job, whole.joints),
);
const comparison = new Comparison(results, () => {
  remember();
  showGhost();
});
const preview = new Preview({
  request: () => editor.request,
  say: text => {
    byId("run-status").textContent = text;
  },
  ready: () => Promise.all([drawing, posing]),
  problem: byId("run-problem"),
  onLook: showLook,
  onVerified: showVerified,
  onRefused: () => {
    byId("run-status").textContent = "It takes more than a quick look: press Run.";
    outdate();
  },
});
const query = new QueryForm(() => ownPart(sliders.q));
const run = new Job(
  "simulations",
  {
    start: byId("run-button"),
    cancel: byId("cancel-button"),
    progress: byId("run-progress"),
    status: byId("run-status"),
    problem: byId("run-problem"),
  },
  showRun,
  job => {
    running = job.id;
    remember(true);
  },
);
const live = new Live(
  viewer,
  () => {
    preview.drop();
    return editor.current();
  },
  () => poseAt(sliders.q),
);
new Study(() => editor.current());
const sweep = new Sweep(() => editor.request, runCell);
const sensitivity = new Sensitivity(() => editor.request);
new Linear(
  () => editor.request,
  () => ({ q: sliders.q, v: speedsOf(whole, editor.v) }),
);
new Identify(() => robots.robot);
const operations = new Operations(
  () => editor.current(),
  () => editor.names,
  () => robots.robot,
);

let running = null; // id of the run that the address names
let whole = null; // the robot with the objects of the scene, in whatever order their joints are
let drawn = null; // what of the scene is in the 3D view: robot and objects
let placed = {}; // where the links are at the start: {frames, poses}
let turn = 0; // counts picks: an answer to an earlier pick is dropped
let underWay = 0; // changes of what is shown that are under way: the address is written after them
let drawing = null; // the picture of the robot that is under way: a run is shown after it
let fitted = null; // id of the robot at whose motion the camera was aimed
let awaited = false; // a run is shown after the scene: no look at it before
let stepping = false; // the next address that is written is a new step of the browser's history

// Picking ---------------------------------------------------------------------------------------------------------

async function useRobot(robot, changes) {
  turn += 1;
  editor.offer(robots.source, OWN);
  await changing(() => arrange(editor.own(robot), robot, OWN, changes));
  remember(true);
}

async function pickScene(id, written = null) {
  await changing(() => useScene(id, written));
  remember(true);
}

/** Show a bundled scene by its id, or a scene that the user wrote; changes: see SceneEditor. */
async function useScene(id, written = null, changes = {}) {
  const thisTurn = ++turn;
  const problem = byId("scene-problem");
  clearProblem(problem);
  try {
    if (id === OWN) {
      await arrange(editor.own(robots.robot), robots.robot, OWN, changes);
      return;
    }
    const content = written ?? (await get(`/v1/scenes/${encodeURIComponent(id)}`));
    if (written !== null) await post("/v1/scenes/validate", { scene: content });
    const robot = await robots.ofScene(content.robot);
    if (robot === null || thisTurn !== turn) return;
    editor.offer(robots.source, id ?? OWN);
    const base = id === null ? editor.own(robot) : content;
    await arrange(base, robot, id ?? OWN, id === null ? { ...content, ...changes } : changes);
  } catch (failure) {
    if (thisTurn === turn) showProblem(problem, failure);
  }
}

/** Put away what is shown, and show a scene, which may be on its way. */
async function arrange(content, robot, id, changes = {}) {
  const thisTurn = turn;
  running = fitted = null;
  preview.drop();
  live.stop();
  viewer.stop();
  results.clear();
  comparison.clear();
  const scene = await content;
  if (thisTurn !== turn) return;
  whole = robot;
  placed = {};
  sliders.set(robot, robot.neutral);
  editor.set(scene, robot, id, changes);
  query.set(robot);
  robots.look(robot.id).catch(() => {}); // asked for while the start is found; draw says what is wrong with it
  drawing = showStart().then(() => {
    if (thisTurn !== turn) return null;
    noteChange(true); // after the start, so that it does not wait for the look
    editor.learnConstants(robot);
    return draw(robot);
  });
  offerRun();
  await drawing;
}

/** Run can be pressed once a scene is there, and while no run is under way. */
function offerRun() {
  byId("run-button").disabled = !editor.base || !byId("cancel-button").hidden;
}

/** Show the start of the scene: sliders, velocities and the robot. */
async function showStart() {
  const { robot } = robots;
  let q = robot.neutral;
  try {
    const start = await post("/v1/scenes/validate", { scene: editor.current() });
    if (robot !== robots.robot) return;
    [q, whole] = [start.q, start.robot];
    nextQ = null;
    await posing; // one that was asked for before
    place(start);
  } catch {
    whole = robot; // explain says what is wrong with the scene
    await poseAt(q);
  }
  sliders.set(whole, q);
  listSpeeds(byId("speeds"), whole, editor.v, (joint, value) => editor.push(joint, value));
}

async function draw(robot) {
  try {
    await started;
    const { about } = editor;
    const shown = JSON.stringify([robot.id, about.objects]);
    if (drawn !== shown && viewer.stage) {
      viewer.note.textContent = DRAWING;
      const visuals = await (about.objects.length
        ? post("/v1/scenes/visuals", { scene: about })
        : robots.look(robot.id));
      if (about !== editor.about || robot.id !== robots.robot.id) return;
      viewer.load(visuals);
      drawn = shown;
      if (placed.frames) place(placed);
    }
    if (viewer.note.textContent === DRAWING) viewer.note.textContent = ""; // of one that was picked meanwhile
    viewer.fit();
  } catch (failure) {
    viewer.note.textContent = `It cannot be drawn: ${failure.message}`;
  }
}

// The address -------------------------------------------------------------------------------------------------------

/** Write what is shown into the address; step: a new one in the browser's history. */
function remember(step = false) {
  stepping ||= step;
  if (underWay || !robots.robot) return;
  const scene = editor.id === OWN ? null : editor.id;
  const { changes } = editor;
  writeAddress({ robot: robots.robot.id, scene, changes, run: running, compared: comparison.ids }, stepping);
  stepping = false;
  document.title = `${editor.current().title || robots.robot.name} · twolink`;
}

function noteChange(numbers) {
  if (!numbers || awaited) outdate();
  else if (byId("cancel-button").hidden) preview.ask();
  relearn();
  rememberSoon();
}

const rememberSoon = debounce(() => remember(), 200); // browsers refuse to write an address as often as a slider moves

function outdate() {
  if (results.job) results.outdated(differences(editor.request, results.job.request));
}

/** Change what is shown. What happens on the way is no step of the history, and does not replace the one before.
 *
 * Nothing is run on the way: it would be the scene before. */
async function changing(change) {
  underWay += 1;
  byId("run-button").disabled = true;
  try {
    await change();
  } finally {
    underWay -= 1;
    offerRun();
  }
}

/** Show what the address says. */
async function restore() {
  const { robot, scene, changes, run: id, compared } = readAddress();
  await changing(async () => {
    const job = id ? await finished(id).catch(() => null) : null;
    awaited = Boolean(id); // where it is not kept, that is said, and stays
    if (scene) await useScene(scene, null, changes ?? {});
    else if (robot) {
      await robots.pick(robot, changes ?? {});
      stepping = false; // the address has it
    } else if (job) await useScene(null, job.request.scene, {});
    else await useScene(FIRST);
    const failed = byId("scene-problem").firstChild ?? byId("robot-problem").firstChild;
    if (!robots.robot) {
      await useScene(FIRST);
      if (failed) byId("robot-problem").replaceChildren(failed);
    }
    awaited = false;
    if (job) await showAgain(job);
    else if (id) byId("run-status").textContent = "The run of this address is not kept here. Press Run.";
    for (const other of await Promise.all(compared.map(each => finished(each).catch(() => null)))) {
      if (other?.state === "done") await comparison.keep(other, whole.joints);
    }
  });
  remember();
}

/** Show a run that was asked for earlier, or wait for it. */
async function showAgain(job) {
  runRobot = robots.robot.id;
  running = job.id;
  if (job.state === "done") await showRun(job);
  else if (["queued", "running"].includes(job.state)) run.follow(job);
  else byId("run-status").textContent = `The run of this address was ${job.state}. Press Run.`;
}

addEventListener("popstate", () => restore());

// The 3D robot ----------------------------------------------------------------------------------------------------

/** The part of q of the scene that is the robot's. */
function ownPart(q) {
  const places = new Map(whole.joints.map(joint => [joint.name, joint.q]));
  return whole.nq === robots.robot.nq ? q : robots.robot.joints.flatMap(({ name }) => q.slice(...places.get(name)));
}

let nextQ = null,
  posing = null;

/** Pose the robot at q of the scene. While a request is under way only the newest q waits. */
function poseAt(q) {
  nextQ = [...q];
  posing ??= posedAll().finally(() => {
    posing = null;
  });
  return posing;
}

async function posedAll() {
  try {
    while (nextQ) {
      const { about, q } = editor;
      const asked = about.objects.length
        ? post("/v1/scenes/validate", { scene: { ...about, q } })
        : post(`/v1/robots/${encodeURIComponent(robots.robot.id)}/kinematics`, { q: ownPart(nextQ) });
      nextQ = null;
      const { frames, poses } = await asked;
      if (about !== editor.about) continue;
      place({ frames, poses });
    }
  } catch (failure) {
    viewer.note.textContent = failure.message;
  }
}

/** Show the links at the start, unless a motion plays. */
function place({ frames, poses }) {
  placed = { frames, poses };
  if (!viewer.timeline.playing) viewer.pose(frames, poses);
}

byId("start-reset").addEventListener("click", async () => {
  editor.q = { ...editor.base.q };
  editor.v = { ...editor.base.v };
  editor.changed(false);
  viewer.timeline.unload();
  await showStart();
});

// Running ---------------------------------------------------------------------------------------------------------

byId("run-button").addEventListener("click", () => {
  preview.drop(false); // it may be the same run
  runRobot = robots.robot.id;
  run.run(editor.request);
});

/** When the accuracy cannot be kept, offer the run that can: a shorter one, or one in higher precision. */
run.onProblem = problem => {
  if (problem.code !== "accuracy-limit") return;
  const again = (text, id, value) =>
    el(
      "button",
      {
        type: "button",
        onclick: () => {
          editor.alter(id, value);
          setTimeout(() => byId("run-button").click());
        },
      },
      text,
    );
  const { trusted_until: trusted, precision } = problem.data;
  const length = Number(Number(trusted).toPrecision(6));
  const buttons = [];
  if (length > 0) buttons.push(again(`Run ${length} s`, "duration", length));
  if (precision === "quad") buttons.push(again("Run in 47 digits", "precision", "quad"));
  byId("run-problem").firstChild.append(el("p", { className: "buttons" }, ...buttons));
};

let runRobot = null; // id of the robot of the run

async function showRun(job) {
  live.stop();
  const [loaded, columns] = await Promise.all([motionOf(job), columnsOf(job)]);
  await drawing; // which would replace the motion
  if (runRobot !== robots.robot.id) {
    byId("run-status").textContent = "Done, but another robot was picked meanwhile: see Earlier runs.";
    return;
  }
  results.show(job, whole.joints, columns);
  outdate();
  comparison.refresh();
  viewer.play({ ...loaded, events: results.events });
  fitted = robots.robot.id;
  await showGhost();
  if (matchMedia("(max-width: 899px)").matches) byId("results-title").scrollIntoView({ block: "start" });
}

/** Where the links are in a run. */
function motionOf(job) {
  return get(`/v1/simulations/${job.id}/motion?frames=${FRAMES}`);
}

/** Show a run without an error bar; once nothing changes any more it plays, over and over. */
function showLook({ result, columns, motion }, request, rests) {
  live.stop();
  running = null;
  results.show({ id: null, request, result }, whole.joints, columns);
  comparison.drop(besides);
  rememberSoon();
  if (!rests) return;
  viewer.play({ ...motion, events: results.events }, { loop: true, fit: fitted !== robots.robot.id });
  fitted = robots.robot.id;
  showGhost();
}

/** Put the verified run in the place of the quick one, which plays. */
async function showVerified(job, isLate) {
  const [motion, columns] = await Promise.all([motionOf(job), columnsOf(job)]);
  if (isLate()) return;
  results.show(job, whole.joints, columns);
  outdate();
  comparison.refresh();
  byId("run-status").textContent = "The error bar is there.";
  const { t, playing } = viewer.timeline;
  viewer.play({ ...motion, events: results.events }, { loop: true, fit: false });
  viewer.seek(t);
  if (!playing) viewer.timeline.pause();
  showGhost();
  besideAgain();
}

// Another run beside the one shown, of the same settings: what other simulators do, or rough steps.

const BESIDE = {
  mujoco: { simulator: "mujoco", method: "auto" },
  coarse: { simulator: "twolink", method: "semi-implicit-euler", step: 0.002, verify: false },
};
const beside = new Job(
  "simulations",
  { ...jobControls("besides", "").parts, status: byId("beside-status"), problem: byId("beside-problem") },
  async job => {
    byId("beside-status").textContent = "";
    await comparison.keep(job, whole.joints);
  },
);

/** Whether a run was made to stand beside others. */
function besides({ request: { simulator = "twolink", verify = true } }) {
  return simulator !== "twolink" || !verify;
}

function besideAgain() {
  comparison.drop(besides);
  beside.drop();
  const kind = BESIDE[byId("beside").value];
  clearProblem(byId("beside-problem"));
  if (kind && results.job) beside.run({ ...editor.request, ...kind });
}

beside.onProblem = problem => {
  if (!["missing-extra", "no-peer"].includes(problem.code) || byId("beside").value === "coarse") return;
  byId("beside").value = "coarse";
  byId("beside-status").textContent = "A coarse run stands beside it instead.";
  besideAgain();
};
byId("beside").addEventListener("change", besideAgain);

/** Lay the run that was kept last over the one shown. */
async function showGhost() {
  const other = comparison.kept.findLast(({ job }) => job.id !== results.job?.id);
  if (!other || !results.job) {
    viewer.uncompare();
    return;
  }
  other.motion ??= await motionOf(other.job);
  viewer.compare(other.motion, null, other.job.result.setting ?? "the run kept to compare");
}

/** Set the controls as they were for the run that is shown. */
byId("stale-back").addEventListener("click", () => openPast(results.job));

/** Set the controls to a request for a run. */
async function useRequest({ scene, accuracy, method, precision }) {
  const exponent = Math.round(-Math.log10(accuracy ?? 1e-6)); // the service says null of what was not given
  await useScene(null, scene, { accuracy: String(exponent), method: method ?? "auto", precision: precision ?? "auto" });
}

/** Show one run of a sweep. */
async function runCell(request) {
  awaited = true;
  await changing(() => useRequest(request));
  awaited = false;
  remember(true);
  byId("run-button").click();
  byId("results-title").scrollIntoView({ block: "start" });
}

async function openPast(job) {
  const compared = comparison.kept;
  awaited = true;
  await changing(async () => {
    await useRequest(job.request);
    awaited = false;
    comparison.kept = compared.filter(each => each.job.result.robot === job.result.robot);
    await showAgain(job);
  });
  remember(true);
  byId("results-title").scrollIntoView({ block: "start" });
}

wireTabs(document.querySelector("[role=tablist]"), id => {
  if (["tab-sense", "tab-sweep", "tab-operation"].includes(id)) learnQuantities();
  if (id === "tab-past") listPast(openPast, job => comparison.keep(job, whole.joints), () => robots.robot);
});

const relearn = debounce(() => {
  if (["sense", "sweep", "operation"].some(name => !byId(`panel-${name}`).hidden)) learnQuantities();
}, 400);

/** What can be varied in the scene, for the panels that offer it. */
async function learnQuantities() {
  try {
    const rows = await post("/v1/scenes/quantities", { scene: editor.current() });
    sensitivity.set(rows, whole);
    sweep.set(rows);
    if (!byId("panel-operation").hidden) await operations.set(rows);
  } catch (failure) {
    showProblem(byId("scene-problem"), failure);
  }
}

function lists() {
  return Promise.allSettled([robots.list(), editor.list(), query.list()]);
}

async function begin(listed = lists()) {
  try {
    for (const { reason } of await listed) if (reason) throw reason;
    await restore();
  } catch (failure) {
    showProblem(byId("robot-problem"), failure);
  }
}

watchService(() => {
  if (robots.robot) editor.refresh();
  else begin();
});
const listed = lists(); // while the viewer's script is loaded
const { robot: named } = readAddress();
if (named) robots.look(named).catch(() => {}); // it takes longest; draw says what is wrong with it
await Promise.all([begin(listed), started]);
byId("loading").remove();
document.documentElement.dataset.ready = "yes";
