// The page: connects the robot, the scene, the run and the view.

import { get, onTokenWanted, post, setToken } from "./api.js";
import { announce, byId, clearProblem, el, showProblem, wireTabs } from "./dom.js";
import { Job } from "./jobs.js";
import { QueryForm } from "./query.js";
import { Results } from "./results.js";
import { Robots } from "./robots.js";
import { SceneEditor } from "./scene.js";
import { Sliders } from "./sliders.js";
import { listPast, Study } from "./study.js";
import { Viewer } from "./viewer/viewer.js";
import { loadMeshcat } from "./viewer_script.js";

const FIRST = "arm-swing";
const FRAMES = 600;
const OWN = "own"; // id of the scene that is in no file

const viewer = new Viewer(byId("stage"), { onTime: t => results.cursor(t) });
const robots = new Robots(robot => useRobot(robot));
const editor = new SceneEditor({ onPick: useScene, onChange: () => {} });
const sliders = new Sliders(byId("sliders"), (q, joint) => {
  viewer.timeline.unload();
  editor.move(joint.name, sliders.part(joint));
  poseAt(q);
});
const results = new Results((t, kind) => {
  if (kind === "hover" && viewer.timeline.playing) results.cursor(t);
  else {
    if (kind !== "hover") viewer.timeline.pause();
    viewer.seek(t);
  }
});
const query = new QueryForm(() => sliders.q);
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
);
new Study(() => editor.current());

let drawn = null; // id of the robot in the 3D view
let start = []; // q at the scene's start
let turn = 0; // counts picks: an answer to an earlier pick is dropped

// Picking ---------------------------------------------------------------------------------------------------------

async function useRobot(robot) {
  turn += 1;
  editor.offer(robots.source, OWN);
  await arrange(editor.own(robot), robot, OWN);
}

/** Show a bundled scene by its id, or a scene that the user wrote. */
async function useScene(id, written = null) {
  const thisTurn = ++turn;
  const problem = byId("scene-problem");
  clearProblem(problem);
  try {
    if (id === OWN) {
      await arrange(editor.own(robots.robot), robots.robot, OWN);
      return;
    }
    const content = written ?? (await get(`/v1/scenes/${encodeURIComponent(id)}`));
    const checked = written === null ? null : await post("/v1/scenes/validate", { scene: content });
    const robot = await robots.ofScene(content.robot);
    if (robot === null || thisTurn !== turn) return;
    editor.offer(robots.source, id ?? OWN);
    await arrange(content, robot, id ?? OWN, checked);
  } catch (failure) {
    if (thisTurn === turn) showProblem(problem, failure);
  }
}

async function arrange(content, robot, id, checked = null) {
  viewer.stop();
  results.clear();
  editor.set(content, robot, id);
  history.replaceState(
    null,
    "",
    id === OWN ? `#robot=${encodeURIComponent(robot.id)}` : `#scene=${encodeURIComponent(id)}`,
  );
  let q = robot.neutral;
  try {
    q = (checked ?? (await post("/v1/scenes/validate", { scene: editor.current() }))).q;
  } catch {
    /* explain says what is wrong with it */
  }
  start = q;
  sliders.set(robot, q);
  query.set(robot);
  await draw(robot, q);
}

async function draw(robot, q) {
  try {
    if (drawn !== robot.id) {
      viewer.note.textContent = "Drawing…";
      const visuals = await robots.look(robot.id);
      if (robots.robot.id !== robot.id) return;
      viewer.load(visuals);
      drawn = robot.id;
    }
    await poseAt(q);
    viewer.fit();
  } catch (failure) {
    viewer.note.textContent = `It cannot be drawn: ${failure.message}`;
  }
}

// The 3D robot ----------------------------------------------------------------------------------------------------

let nextQ = null,
  asking = false;

/** Pose the robot at q. While a request is under way only the newest q waits. */
async function poseAt(q) {
  nextQ = [...q];
  if (asking) return;
  asking = true;
  try {
    while (nextQ) {
      const [id, sentQ] = [robots.robot.id, nextQ];
      nextQ = null;
      const { frames, poses } = await post(`/v1/robots/${encodeURIComponent(id)}/kinematics`, { q: sentQ });
      if (id === robots.robot.id && !viewer.timeline.playing) viewer.pose(frames, poses);
    }
  } catch (failure) {
    viewer.note.textContent = failure.message;
  } finally {
    asking = false;
  }
}

byId("sliders-reset").addEventListener("click", () => {
  sliders.set(robots.robot, start);
  for (const name of Object.keys(editor.q)) if (!(name in (editor.base.q ?? {}))) delete editor.q[name];
  Object.assign(editor.q, editor.base.q);
  editor.changed(false);
  viewer.timeline.unload();
  poseAt(start);
});

// Running ---------------------------------------------------------------------------------------------------------

byId("run-button").addEventListener("click", () => {
  runRobot = robots.robot.id;
  run.run({ scene: editor.current(), accuracy: editor.accuracy, ...editor.how });
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
  if (precision === "quad") buttons.push(again("Run in quadruple precision", "precision", "quad"));
  byId("run-problem").firstChild.append(el("p", { className: "buttons" }, ...buttons));
};

let runRobot = null; // id of the robot of the run

async function showRun(job) {
  if (runRobot !== robots.robot.id) {
    byId("run-status").textContent = "Done, but another robot was picked meanwhile: see Earlier runs.";
    return;
  }
  const loaded = await get(`/v1/simulations/${job.id}/motion?frames=${FRAMES}`);
  await results.show(job, robots.robot.joints);
  viewer.play({ ...loaded, events: results.moments });
  if (matchMedia("(max-width: 899px)").matches) byId("results-title").scrollIntoView({ block: "start" });
}

async function openPast(job) {
  const { scene } = job.request;
  await useScene(typeof scene === "string" ? scene : null, typeof scene === "string" ? null : scene);
  runRobot = robots.robot.id;
  await showRun(job);
  byId("results-title").scrollIntoView({ block: "start" });
}

wireTabs(document.querySelector("[role=tablist]"), id => {
  if (id === "tab-past") listPast(openPast);
});

// The service: ask for a token when it needs one, and say when it is gone --------------------------------------------------

onTokenWanted(
  () =>
    new Promise(done => {
      const dialog = byId("token-dialog");
      byId("token").value = "";
      byId("token-button").hidden = false;
      dialog.addEventListener("close", () => done(dialog.returnValue === "ok" ? byId("token").value.trim() : null), {
        once: true,
      });
      dialog.returnValue = "cancel";
      dialog.showModal();
    }),
);
byId("token-button").addEventListener("click", () => {
  setToken("");
  location.reload();
});

let watching = false;
addEventListener("service-gone", async () => {
  if (watching) return;
  watching = true;
  const banner = byId("banner");
  banner.textContent =
    "The service does not answer. Is “twolink serve” still running? What is shown here stays; this page goes on when it is back.";
  banner.hidden = false;
  for (;;) {
    await new Promise(wait => setTimeout(wait, 2000));
    try {
      if ((await fetch("/health")).ok) break;
    } catch {
      /* not yet */
    }
  }
  watching = false;
  banner.hidden = true;
  announce("The service answers again.");
  if (robots.robot) editor.refresh();
  else begin();
});

async function begin() {
  try {
    await Promise.all([robots.list(), editor.list()]);
    const address = new URLSearchParams(location.hash.slice(1));
    if (address.get("robot")) await robots.pick(address.get("robot"));
    else await useScene(address.get("scene") ?? FIRST);
    if (!robots.robot) await useScene(FIRST);
  } catch (failure) {
    showProblem(byId("robot-problem"), failure);
  }
}

await loadMeshcat();
viewer.start();
await begin();
document.documentElement.dataset.ready = "yes";
