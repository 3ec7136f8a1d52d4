// The scene: its choice, its effects, its start, and the estimated cost of a run.

import { get, getOnce, post } from "./api.js";
import { byId, clearProblem, debounce, el, seconds, sentence, showProblem } from "./dom.js";
import { listEffects } from "./effects.js";
import { searchable } from "./search.js";
import { canonical } from "./settings.js";
import { templates } from "./templates.js";

export const OWN = "own"; // id of the scene that is in no file: the robot with all that its own says
const CONTROLS = { accuracy: "6", method: "auto", precision: "auto" }; // with what they show at first

export class SceneEditor {
  /** onPick(content, id): the user chose a scene. onChange(numbers): what request gives has changed. pose(): q, and where
   * the links are, {frames, poses}. */
  constructor({ onPick, onChange, pose }) {
    Object.assign(this, { onPick, onChange, pose });
    this.effects = []; // [{content, on}]
    this.refresh = debounce(() => this.explain(), 150);
    byId("scene-select").addEventListener("change", event => this.onPick(event.target.value));
    byId("accuracy").addEventListener("input", () => {
      this.#sayAccuracy();
      this.changed(false, false);
    });
    for (const id of ["duration", "method", "precision"])
      byId(id).addEventListener("change", () => this.changed(false, false));
    byId("scene-apply").addEventListener("click", () => this.#apply());
    byId("add-effect").addEventListener("change", event => this.#add(event.target));
  }

  async list() {
    const [scenes, methods, schema] = await Promise.all([get("/v1/scenes"), get("/v1/methods"), get("/v1/scene-schema")]);
    this.scenes = scenes;
    byId("method").append(
      ...methods
        .filter(method => method.kind !== "scipy")
        .map(method => el("option", { value: method.name }, `${method.name}: ${method.good_for}`)),
    );
    const defs = schema.$defs;
    const tagged = Object.values(defs).filter(part => part.properties?.type?.enum?.length === 1);
    const effects = Object.fromEntries(tagged.map(part => [part.properties.type.enum[0], part]));
    this.names = { defs, effects, joints: [], coordinates: [], links: [], constants: {} };
    this.searched = searchable(byId("scene-select"), byId("scene-search"));
  }

  /** The scenes for a robot first, then the others. */
  offer(source, chosen) {
    const option = scene => el("option", { value: scene.id }, scene.title || scene.id);
    const fit = this.scenes.filter(scene => scene.robot === source);
    const rest = this.scenes.filter(scene => scene.robot !== source);
    byId("scene-select").replaceChildren(
      el(
        "optgroup",
        { label: "With this robot" },
        el("option", { value: OWN }, "Let go, with all that its file says"),
        ...fit.map(option),
      ),
      el("optgroup", { label: "With a robot of their own" }, ...rest.map(option)),
    );
    this.searched();
    byId("scene-select").value = chosen;
  }

  /** Show a scene of a robot, changed as `changes` says: parts of the scene, `off` (places of effects that are off),
   * and the controls of the run. */
  set(content, robot, id, changes = {}) {
    Object.assign(this, { id, robot, base: content });
    const scene = { ...content, ...changes };
    this.about = { robot: scene.robot, title: scene.title ?? "", objects: scene.objects ?? [] };
    this.q = { ...scene.q };
    this.v = { ...scene.v };
    const off = new Set(changes.off ?? []);
    this.effects = (scene.effects ?? []).map((effect, i) => ({ content: effect, on: !off.has(i) }));
    byId("duration").value = scene.duration ?? 10;
    for (const [name, first] of Object.entries(CONTROLS)) byId(name).value = changes[name] ?? first;
    this.#sayAccuracy();
    const single = robot.joints.filter(joint => joint.v[1] - joint.v[0] === 1);
    const named = joints => joints.map(joint => joint.name);
    const coordinates = named(single.filter(joint => joint.q[1] - joint.q[0] === 1));
    const units = Object.fromEntries(single.map(joint => [joint.name, joint.kind === "prismatic" ? "m" : "rad"]));
    this.names = { ...this.names, joints: named(single), coordinates, links: robot.links, constants: {}, units };
    this.#offerEffects();
    this.changed(true, false); // who sets it tells when it is to be looked at
  }

  /** The scene of a robot with all that its file says; of one without joints an empty one. */
  async own(robot) {
    try {
      return await getOnce(`/v1/robots/${encodeURIComponent(robot.id)}/scene`);
    } catch (failure) {
      if (failure.code !== "nothing-moves") throw failure;
      return { robot: robot.id, title: robot.name, duration: 2, q: {}, effects: [] };
    }
  }

  /** The scene as the service takes it, always with its content. */
  current() {
    const duration = Number(byId("duration").value) || this.base.duration;
    const effects = this.effects.filter(effect => effect.on).map(effect => effect.content);
    const moving = Object.keys(this.v).length ? { v: this.v } : {};
    return { ...this.about, duration, q: this.q, ...moving, effects };
  }

  /** What differs from the scene that was picked, for `set`. */
  get changes() {
    const now = {
      ...this.about,
      duration: Number(byId("duration").value) || this.base.duration,
      q: this.q,
      v: this.v,
      effects: this.effects.map(effect => effect.content),
    };
    const first = { title: "", objects: [], duration: 10, q: {}, v: {}, effects: [], ...this.base };
    const changed = Object.entries(now).filter(([name, value]) => canonical(value) !== canonical(first[name]));
    const off = this.effects.flatMap((effect, i) => (effect.on ? [] : [i]));
    const controls = Object.entries(CONTROLS).filter(([name, value]) => byId(name).value !== value);
    return {
      ...Object.fromEntries(changed),
      ...(off.length ? { off } : {}),
      ...Object.fromEntries(controls.map(([name]) => [name, byId(name).value])),
    };
  }

  /** What is asked for; nothing where the control was left alone: contacts that are stepped may not reach 1e-6. */
  get accuracy() {
    if (byId("accuracy").value === CONTROLS.accuracy) return undefined;
    return Number(`1e-${byId("accuracy").value}`);
  }

  /** The request for a run. Short motions are sampled more often than 200 times a second. */
  get request() {
    const scene = this.current();
    const samples_per_second = Math.max(200, Math.ceil(1000 / scene.duration));
    const [method, precision] = [byId("method").value, byId("precision").value];
    return { scene, accuracy: this.accuracy, method, precision, samples_per_second };
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

  push(joint, value) {
    this.v[joint] = value;
    if ([value].flat().every(x => x === 0)) delete this.v[joint];
    this.changed(false);
  }

  /** numbers: of the scene, not of how it is run. */
  changed(redraw = true, numbers = true) {
    if (redraw) {
      listEffects(byId("effects"), this.effects, this.names, {
        onChange: () => this.changed(false),
        onRemove: effect => {
          this.effects.splice(this.effects.indexOf(effect), 1);
          this.changed();
        },
      });
    }
    byId("scene-json").value = JSON.stringify(this.current(), null, 2);
    this.refresh();
    this.onChange(numbers);
  }

  /** The robot's physical constants, for forms. They wait for nobody: forms work without. */
  async learnConstants(robot) {
    try {
      const rows = await post("/v1/scenes/quantities", { scene: { robot: this.about.robot } });
      if (robot !== this.robot) return;
      const constants = rows.filter(row => row.kind === "constant" && !row.name.endsWith(".damping"));
      this.names.constants = Object.fromEntries(constants.map(row => [row.name, row.value]));
    } catch (failure) {
      console.warn("The robot's constants are not known:", failure.message);
    }
  }

  get #templates() {
    const { q, frames, poses } = this.pose();
    const fixed = new Set(this.robot.fixed_links);
    const tip = this.robot.links.filter(link => !fixed.has(link)).at(-1);
    const place = poses?.[frames.indexOf(tip)] ?? [0, 0, 0, 0, 0, 0, 1];
    return templates({ robot: this.robot, q, place, constants: this.names.constants });
  }

  #offerEffects() {
    const groups = Object.entries(this.#templates).map(([label, effects]) =>
      el("optgroup", { label }, ...Object.keys(effects).map(name => el("option", {}, name))),
    );
    byId("add-effect").replaceChildren(el("option", { value: "" }, "Add an effect…"), ...groups);
  }

  #add(select) {
    const added = Object.values(this.#templates).find(effects => select.value in effects)?.[select.value];
    select.value = "";
    if (!added) return;
    this.effects.push({ content: added, on: true, open: true });
    this.changed();
  }

  #sayAccuracy() {
    const text = `1e-${byId("accuracy").value}`;
    byId("accuracy-value").textContent = text;
    byId("accuracy").setAttribute("aria-valuetext", text);
  }

  async #apply() {
    clearProblem(byId("scene-problem"));
    let content;
    try {
      content = JSON.parse(byId("scene-json").value);
    } catch (failure) {
      const remedy = "Mend it, or pick the scene again.";
      showProblem(byId("scene-problem"), Object.assign(new Error(`This is not JSON: ${failure.message}`), { remedy }));
      return;
    }
    await this.onPick(null, content);
  }

  /** Have the service check the scene and estimate its cost. While a request is under way only the newest waits: one
   * that is aborted ends a process of the service. */
  explain() {
    byId("price").textContent = "Counting…";
    this.wanted = true;
    this.explaining ??= this.#explained().finally(() => {
      this.explaining = null;
    });
  }

  async #explained() {
    while (this.wanted) {
      this.wanted = false;
      const { scene, accuracy, method } = this.request;
      try {
        const explanation = await post("/v1/scenes/explain", { scene, accuracy, method });
        if (this.wanted) continue;
        clearProblem(byId("scene-problem"));
        this.#showCost(explanation);
      } catch (failure) {
        if (this.wanted) continue;
        byId("price").textContent = "";
        byId("operations").textContent = "";
        this.#refused(failure);
      }
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
    const later = explanation.formulation.startsWith("events") ? " and later events" : "";
    byId("price").replaceChildren(
      el("b", { id: "expected" }, `≈ ${seconds(explanation.expected_seconds)}`),
      ` by ${explanation.method}, plus error bar${later}`,
    );
    byId("price").title = explanation.why;
  }
}
