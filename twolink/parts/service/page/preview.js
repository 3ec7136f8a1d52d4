// A look at the scene while it is changed: a quick run without an error bar at once, and the run that has one when the
// changes rest. A late answer never replaces a newer one.

import { post } from "./api.js";
import { debounce, seconds } from "./dom.js";
import { Job, jobControls } from "./jobs.js";

const REST = 600; // ms without a change, before the error bar is asked for
const MOST = 2; // looks that are asked for at once
const FRAMES = 300;

export class Preview {
  /** request(): what to run. say(text): what is going on. ready(): what is waited for before an answer is shown.
   * onLook(found, request, rests): a quick run; rests: nothing has changed since. onVerified(job, isLate): its verified
   * run; isLate(): something has changed since. onRefused(problem): there is no quick run. */
  constructor({ request, say, ready, problem, onLook, onVerified, onRefused }) {
    Object.assign(this, { request, say, ready, onLook, onVerified, onRefused });
    this.asked = this.sent = this.shown = this.flying = 0; // numbers of changes; and how many answers are waited for
    this.job = new Job("simulations", { ...jobControls("preview", "").parts, problem }, job => {
      const number = this.asked;
      return this.onVerified(job, () => number !== this.asked);
    });
    this.job.onProgress = ({ progress }) =>
      this.say(`The error bar is being found${progress?.fraction ? `: ${Math.round(100 * progress.fraction)} %` : ""}…`);
    this.verify = debounce(number => number === this.asked && this.job.run(this.request()), REST);
  }

  /** Something has changed. */
  ask() {
    this.job.drop();
    this.say("Looking…");
    this.asked += 1;
    this.#send();
  }

  /** What is under way is of no use any more. cancel: not even to others. */
  drop(cancel = true) {
    this.job.drop(cancel);
    this.sent = this.shown = ++this.asked;
  }

  async #send() {
    if (this.sent === this.asked || this.flying === MOST) return;
    const number = (this.sent = this.asked);
    const request = this.request();
    const { scene, accuracy, method, precision, samples_per_second } = request;
    const began = performance.now();
    this.flying += 1;
    try {
      const asked = { scene, accuracy, method, precision, samples_per_second, frames: FRAMES };
      const found = await post("/v1/scenes/preview", asked);
      await this.ready();
      if (number <= this.shown) return;
      this.shown = number;
      this.onLook(found, request, number === this.asked);
      if (number !== this.asked) return;
      this.say(`A quick look, in ${seconds((performance.now() - began) / 1000)}. The error bar follows…`);
      this.verify(number);
    } catch (failure) {
      if (number === this.asked) this.onRefused(failure);
    } finally {
      this.flying -= 1;
      this.#send();
    }
  }
}
