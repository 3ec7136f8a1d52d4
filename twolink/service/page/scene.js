// The scene: its choice, its effects and their switches, its start, and the estimated cost of a run.

import { get, post } from "./api.js";
import { byId, clearProblem, debounce, el, seconds, sentence, short, showProblem } from "./dom.js";

const OWN = "own"; // id of the scene that is in no file: the robot released at rest
const G = -9.81;

/** Effects that can be added to any robot, with values to start from. */
function templates(robot) {
  const single = robot.joints
    .filter(joint => joint.v[1] - joint.v[0] === 1 && joint.layout !== "mimic")
    .map(joint => joint.name);
  const tip = robot.links.at(-1);
  const each = value => Object.fromEntries(single.map(name => [name, value]));
  const jointed = single.length
    ? {
        "Damping in the joints": { type: "joint-damping", damping: each(0.5) },
        "Springs in the joints": { type: "joint-spring", stiffness: each(10) },
        "Dry friction in the joints": { type: "dry-friction", friction: each(0.5) },
        "A sine torque at the first joint": {
          type: "torque",
          inputs: { [single[0]]: { kind: "sine", amplitude: 2, frequency: 3 } },
        },
        "PD control to zero": { type: "joint-pd", target: each(0), kp: each(100), kd: each(10) },
        "Motors that carry the weight": { type: "gravity-compensation" },
      }
    : {};
  return {
    Gravity: { type: "gravity", field: [0, 0, G] },
    ...jointed,
    [`1 kg at ${tip}`]: { type: "payload", frame: tip, mass: 1 },
    [`Air drag at ${tip}`]: { type: "air-drag", frame: tip, area: 0.01 },
  };
}

export class SceneEditor {
  /** onPick(content, id): the user chose a scene. onChange(): what current() gives has changed. */
  constructor({ onPick, onChange }) {
    Object.assign(this, { onPick, onChange });
    this.effects = []; // [{content, on}]
    this.refresh = debounce(() => this.explain(), 150);
    byId("scene-select").addEventListener("change", event => this.onPick(event.target.value));
    byId("accuracy").addEventListener("input", () => {
      byId("accuracy-value").textContent = `1e-${byId("accuracy").value}`;
      byId("accuracy").setAttribute("aria-valuetext", `1e-${byId("accuracy").value}`);
      this.refresh();
    });
    byId("accuracy").setAttribute("aria-valuetext", "1e-6");
    for (const id of ["duration", "method", "precision"]) byId(id).addEventListener("change", () => this.changed());
    byId("scene-apply").addEventListener("click", () => this.#apply());
    byId("add-effect").addEventListener("change", event => {
      const added = templates(this.robot)[event.target.value];
      event.target.value = "";
      if (!added) return;
      this.effects.push({ content: added, on: true });
      this.changed();
    });
  }

  async list() {
    this.scenes = await get("/v1/scenes");
    const methods = (await get("/v1/methods")).filter(method => method.kind !== "scipy");
    byId("method").append(
      ...methods.map(method => el("option", { value: method.name }, `${method.name}: ${method.good_for}`)),
    );
  }

  /** The scenes for a robot first, then the others. */
  offer(source, chosen) {
    const option = scene => el("option", { value: scene.id }, scene.title || scene.id);
    const [fit, rest] = [
      this.scenes.filter(scene => scene.robot === source),
      this.scenes.filter(scene => scene.robot !== source),
    ];
    byId("scene-select").replaceChildren(
      el(
        "optgroup",
        { label: "With this robot" },
        el("option", { value: OWN }, "Let it go, as the sliders stand"),
        ...fit.map(option),
      ),
      el("optgroup", { label: "With a robot of their own" }, ...rest.map(option)),
    );
    byId("scene-select").value = chosen;
  }

  /** Show a scene of a robot. start: its q, as the service gives it. */
  set(content, robot, id) {
    this.id = id;
    this.robot = robot;
    this.base = content;
    this.q = { ...(content.q ?? {}) };
    this.effects = (content.effects ?? []).map(effect => ({ content: effect, on: true }));
    byId("duration").value = content.duration ?? 10;
    const offered = Object.keys(templates(robot)).map(name => el("option", { value: name }, name));
    byId("add-effect").replaceChildren(el("option", { value: "" }, "Add an effect…"), ...offered);
    this.changed();
  }

  /** A scene for any robot: it is released at rest, under gravity. */
  own(robot) {
    const gravity = robot.gravity ?? [0, 0, G];
    return {
      robot: robot.id,
      title: `${robot.name}, let go`,
      duration: 3,
      q: {},
      effects: [{ type: "gravity", field: gravity }],
    };
  }

  /** The scene as the service takes it, always with its content. */
  current() {
    const duration = Number(byId("duration").value);
    const effects = this.effects.filter(effect => effect.on).map(effect => effect.content);
    return { ...this.base, duration: duration || this.base.duration, q: this.q, effects };
  }

  get accuracy() {
    return Number(`1e-${byId("accuracy").value}`);
  }

  /** Options of the run beside the accuracy. Short motions are sampled more often than 200 times a second. */
  get how() {
    const samples = Math.max(200, Math.ceil(1000 / this.current().duration));
    return { method: byId("method").value, precision: byId("precision").value, samples };
  }

  /** Set a control as the user does. */
  alter(id, value) {
    byId(id).value = value;
    byId(id).dispatchEvent(new Event("change"));
  }

  move(joint, value) {
    this.q[joint] = value;
    this.changed(false);
  }

  changed(redraw = true) {
    if (redraw) this.#effects();
    byId("scene-json").value = JSON.stringify(this.current(), null, 2);
    this.refresh();
    this.onChange();
  }

  async #apply() {
    clearProblem(byId("scene-problem"));
    let content;
    try {
      content = JSON.parse(byId("scene-json").value);
    } catch (failure) {
      showProblem(
        byId("scene-problem"),
        Object.assign(new Error(`This is not JSON: ${failure.message}`), {
          remedy: "Mend it, or pick the scene again.",
        }),
      );
      return;
    }
    await this.onPick(null, content);
  }

  /** Have the service check the scene and estimate its cost; a newer request aborts an older one. */
  async explain() {
    this.abort?.abort();
    const abort = (this.abort = new AbortController());
    const scene = this.current();
    byId("price").textContent = "Counting…";
    try {
      const { method } = this.how;
      const explanation = await post(
        "/v1/scenes/explain",
        { scene, accuracy: this.accuracy, method },
        { signal: abort.signal },
      );
      clearProblem(byId("scene-problem"));
      this.#showCost(explanation);
    } catch (failure) {
      if (failure.name === "AbortError") return;
      byId("price").textContent = "";
      byId("operations").textContent = "";
      this.#refused(failure);
    }
  }

  #refused(problem) {
    const row = this.effects.filter(effect => effect.on)[problem.data?.effect]?.row;
    showProblem(byId("scene-problem"), problem);
    if (row) row.classList.add("wrong");
  }

  #showCost(explanation) {
    const largest = Math.max(1, ...explanation.shares.map(share => share.operations));
    const left = [...explanation.shares];
    for (const effect of this.effects) {
      effect.row.classList.remove("wrong");
      const at = effect.on ? left.findIndex(share => share.effect === effect.content.type) : -1;
      const share = at < 0 ? null : left.splice(at, 1)[0];
      effect.price.textContent = share ? share.operations.toLocaleString("en") : "";
      effect.bar.style.width = share ? `${Math.max(2, (100 * share.operations) / largest)}%` : "0";
    }
    byId("operations").textContent =
      `${explanation.operations.toLocaleString("en")} operations an evaluation, robot included. ${sentence(explanation.formulation)}`;
    byId("price").replaceChildren(
      el("b", { id: "expected" }, `≈ ${seconds(explanation.expected_seconds)}`),
      ` by ${explanation.method}, plus error bar and compiling`,
    );
    byId("price").title = explanation.why;
  }

  #effects() {
    const rows = this.effects.map(effect => {
      const box = el("input", {
        type: "checkbox",
        role: "switch",
        checked: effect.on,
        onchange: () => {
          effect.on = box.checked;
          effect.row.classList.toggle("off", !effect.on);
          this.changed(false);
        },
      });
      effect.price = el("span", { className: "price" });
      effect.bar = el("span", { className: "bar" });
      const name = effect.content.type.replaceAll("-", " ");
      const about = wordsOf(effect.content);
      effect.row = el(
        "li",
        { className: effect.on ? "" : "off" },
        el(
          "label",
          { title: JSON.stringify(effect.content) },
          box,
          el("span", { className: "effect-name" }, sentence(name).slice(0, -1)),
          el("span", { className: "about" }, about),
        ),
        el(
          "span",
          { className: "cost", title: "operations an evaluation" },
          effect.price,
          el("span", { className: "track" }, effect.bar),
        ),
      );
      return effect.row;
    });
    byId("effects").replaceChildren(
      ...(rows.length ? rows : [el("li", { className: "hint" }, "None: nothing acts on it.")]),
    );
  }
}

/** The values of an effect in one line. */
function wordsOf(content) {
  const say = value => {
    if (typeof value === "number") return short(value);
    if (Array.isArray(value)) return `(${value.map(say).join(", ")})`;
    if (value && typeof value === "object") {
      return Object.entries(value)
        .filter(([key]) => key !== "kind")
        .map(([key, item]) => `${key} ${say(item)}`)
        .join(", ");
    }
    return String(value);
  };
  return Object.entries(content)
    .filter(([key]) => key !== "type")
    .map(([key, value]) => `${key} ${say(value)}`)
    .join(" · ");
}
