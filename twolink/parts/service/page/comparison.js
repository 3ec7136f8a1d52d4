// Runs kept to compare with: a line for each, with what differs from the run shown.

import { byId, el, short } from "./dom.js";
import { differences } from "./settings.js";
import { columnsOf, samplesOf } from "./samples.js";

const MOST = 3;

export class Comparison {
  /** results: where the curves are drawn. onChange(): the list has changed. */
  constructor(results, onChange) {
    Object.assign(this, { results, onChange });
    this.kept = []; // [{job, samples}]
  }

  get ids() {
    return this.kept.map(({ job }) => job.id);
  }

  clear() {
    this.drop(() => true);
  }

  /** Compare with those no more that which(job) is true of. */
  drop(which) {
    this.kept = this.kept.filter(({ job }) => !which(job));
    this.refresh();
  }

  /** Keep a finished run of the robot shown. */
  async keep(job, joints) {
    const samples = samplesOf(await columnsOf(job), joints);
    if (this.ids.includes(job.id)) return;
    this.kept = [...this.kept, { job, samples }].slice(-MOST);
    this.refresh();
    this.onChange();
  }

  /** Draw the kept runs beside the one shown, and say what differs. */
  refresh() {
    this.results.compare(this.kept);
    const { job } = this.results;
    const rows = this.kept.map(({ job: kept, samples }, i) => {
      const words = job ? differences(kept.request, job.request) : [];
      const same = job?.id === kept.id;
      const what = same ? "the run shown" : words.length ? `other ${words.join(", ")}` : "the same settings";
      const far = job && !same ? `: q differs by up to ${short(Math.max(...this.results.distance(samples)), 2)}` : "";
      const title = kept.request.scene.title || kept.result.robot;
      const { accuracy, cost, setting } = kept.result;
      const how = setting ?? (accuracy === null ? `${cost.method}, ${kept.result.bound || "not verified"}` : `at ${short(accuracy, 1)}`);
      return el(
        "li",
        {},
        el("span", { className: `line line-${i}`, "aria-hidden": "true" }),
        el("span", {}, `${title}, ${short(kept.result.duration)} s, ${how}`),
        el("span", { className: "hint" }, `${what}${far}`),
        el(
          "button",
          {
            type: "button",
            className: "quiet",
            "aria-label": `Remove ${title} from the comparison`,
            onclick: () => {
              this.kept = this.kept.filter(each => each.job !== kept);
              this.refresh();
              this.onChange();
            },
          },
          "Remove",
        ),
      );
    });
    byId("compared").replaceChildren(...rows);
    byId("compared").hidden = !rows.length;
  }
}
