// The accuracy study: its job, its figure and the cost of each digit; and the list of earlier runs.

import { downloadButton, get, request } from "./api.js";
import { byId, clearProblem, count, el, seconds, short, showProblem, table } from "./dom.js";
import { finished, Job } from "./jobs.js";
import { settingsForm } from "./operations.js";

const FEW = ["rk4", "rk45", "dop853", "taylor"]; // methods that are ticked at first
const FIRST = { tolerances: [1e-3, 1e-5, 1e-7, 1e-9, 1e-11] };
const SETTINGS = ["tolerances", "samples_per_second", "repeats", "budget"];

export class Study {
  /** getScene(): the current scene. */
  constructor(getScene) {
    this.settings = { ...FIRST };
    settingsForm(byId("study-settings"), "StudyRequest", SETTINGS, FIRST, to => (this.settings = to), "Study");
    this.#offer();
    const parts = Object.fromEntries(
      ["cancel", "progress", "status", "problem"].map(name => [name, byId(`study-${name}`)]),
    );
    this.job = new Job("studies", { start: byId("study-button"), ...parts }, job => this.#show(job));
    byId("study-button").addEventListener("click", () => {
      const ticked = this.boxes.filter(box => box.checked).map(box => box.value);
      this.job.run({
        scene: getScene(),
        duration: Number(byId("study-duration").value) || 2,
        ...(ticked.length < this.boxes.length ? { methods: ticked } : {}),
        ...this.settings,
      });
    });
  }

  /** List the methods to tick. */
  async #offer() {
    const methods = await get("/v1/methods");
    this.boxes = methods.map(({ name }) => el("input", { type: "checkbox", value: name, checked: FEW.includes(name) }));
    const rows = this.boxes.map((box, i) => el("li", {}, el("label", { className: "check", title: methods[i].good_for }, box, box.value)));
    const tick = (text, fits) => el("button", { type: "button", onclick: () => this.boxes.forEach(box => (box.checked = fits(box.value))) }, text);
    byId("study-methods").append(
      el("ul", { className: "picker" }, ...rows),
      el("p", { className: "buttons" }, tick("These four", name => FEW.includes(name)), tick("All: a minute or more", () => true)),
    );
  }

  async #show(job) {
    const path = `/v1/studies/${job.id}`;
    const picture = await (await request(`${path}/figure?format=svg`)).blob();
    if (this.address) URL.revokeObjectURL(this.address);
    this.address = URL.createObjectURL(picture);
    const { rows, reference, price_of_digits: prices, robot, duration } = job.result;
    const figure = el("img", {
      src: this.address,
      className: "figure",
      alt: `Work-precision diagram of ${robot}, ${duration} s: ${count(rows.length, "point")}; the table below has the best of them.`,
    });
    const cells = price => [
      short(price.accuracy, 1),
      seconds(price.seconds),
      price.ratio === null ? "" : `× ${short(price.ratio, 2)}`,
      price.method,
      price.tolerance === null ? `step ${short(price.step, 2)}` : `tolerance ${short(price.tolerance, 2)}`,
    ];
    const heads = ["Accuracy", "Seconds", "To the row before", "Method", "Setting"];
    const name = `${robot}-${job.id.slice(-6)}`;
    const button = (text, address, file) => downloadButton(text, address, file, byId("study-problem"));
    byId("study-result").replaceChildren(
      figure,
      el("p", { className: "hint" }, `Errors are against ${reference.how}.`),
      table("The price of each digit", heads, prices.map(cells), [3, 4]),
      el(
        "p",
        { className: "downloads" },
        el("span", { className: "hint" }, "Download "),
        button("CSV", `${path}/result?format=csv`, `${name}.csv`),
        button("Figure", `${path}/figure?format=svg`, `${name}.svg`),
      ),
    );
  }
}

/** List earlier runs. onOpen(job): the user wants to see one. onKeep(job): to compare with it, if its robot is robot(). */
export async function listPast(onOpen, onKeep, robot) {
  clearProblem(byId("past-problem"));
  try {
    const jobs = (await get("/v1/simulations")).sort((a, b) => b.created - a.created).slice(0, 30);
    byId("past").replaceChildren(
      ...(jobs.length ? jobs.map(job => pastRow(job, onOpen, onKeep, robot())) : [el("li", { className: "hint" }, "None yet.")]),
    );
  } catch (failure) {
    showProblem(byId("past-problem"), failure);
  }
}

function pastRow(job, onOpen, onKeep, robot) {
  const { scene, accuracy } = job.request ?? { scene: { title: "a large scene" } }; // lists leave large ones out
  const title = typeof scene === "string" ? scene : scene.title || scene.robot?.source || scene.robot;
  const when = new Date(job.created * 1000).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
  const button = (text, act, enabled) => {
    const element = el(
      "button",
      {
        type: "button",
        className: "quiet",
        disabled: job.state !== "done" || !enabled,
        onclick: async () => {
          try {
            await act(await finished(job.id));
          } catch (failure) {
            showProblem(byId("past-problem"), failure);
          }
        },
      },
      text,
    );
    element.setAttribute("aria-label", `${text} ${title}, ${when}`);
    return element;
  };
  const same = [robot?.id, robot?.source].includes(scene.robot?.source ?? scene.robot);
  return el(
    "li",
    {},
    el("span", { className: "past-title" }, title),
    el("span", { className: "hint" }, `accuracy ${short(accuracy, 1)} · ${job.state} · ${when}`),
    el("span", { className: "past-buttons" }, button("Show", onOpen, true), button("Compare", onKeep, same)),
  );
}
