// A job of the service: start it, follow its progress, cancel it. One at a time.

import { events, get, post, Problem } from "./api.js";
import { clearProblem, el, seconds, short, showProblem } from "./dom.js";

const OVER = ["done", "failed", "cancelled", "interrupted"];

/** A simulation with the whole of its scene. Throws Problem where it is not kept. */
export async function finished(id) {
  const job = await get(`/v1/simulations/${encodeURIComponent(id)}`);
  if (typeof job.request.scene === "string") job.request.scene = await get(`/v1/scenes/${job.request.scene}`);
  return job;
}

/** The controls of a job: {node, parts}, for pages that build them. text: of the button. */
export function jobControls(id, text) {
  const parts = {
    start: el("button", { type: "button", className: "primary", id: `${id}-button` }, text),
    cancel: el("button", { type: "button", hidden: true }, "Cancel"),
    progress: el("progress", { max: 1, value: 0, hidden: true, "aria-label": `Progress: ${text}` }),
    status: el("p", { className: "facts", role: "status", id: `${id}-status` }),
    problem: el("div", { id: `${id}-problem` }),
  };
  const row = el("div", { className: "run-row" }, parts.start, parts.cancel, parts.progress);
  return { node: el("div", {}, parts.problem, row, parts.status), parts };
}

export class Job {
  /** parts: the elements start, cancel, progress, status and problem. kind: such as "simulations".
   *
   * onResult(job): it is done. onStart(job): the service has taken it, or has it already. */
  constructor(kind, parts, onResult, onStart = () => {}) {
    Object.assign(this, { kind, parts, onResult, onStart });
    parts.cancel.addEventListener("click", () => this.cancel());
  }

  get busy() {
    return this.abort !== undefined;
  }

  /** Ask for a job and wait for its end. body: the request. */
  async run(body) {
    this.duration = body.duration ?? body.scene?.duration;
    await this.#until(async () => {
      let job = await post(`/v1/${this.kind}`, { ...body, wait: 0 });
      const stored = job.state === "done";
      if (["failed", "cancelled", "interrupted"].includes(job.state))
        job = await post(`/v1/${this.kind}/${job.id}/run`, {});
      return [job, stored];
    });
  }

  /** Wait no longer for what is under way. cancel: nobody else waits for it. */
  drop(cancel = true) {
    if (cancel) this.#end().catch(() => {});
    this.abort?.abort();
    this.abort = this.path = undefined;
  }

  /** Have the service end the job; one that it has not taken yet, once it has. */
  async #end() {
    if (this.path) await post(`${this.path}/cancel`, {});
    else if (this.abort) this.abort.unwanted = true;
  }

  /** Wait for the end of a job that was asked for earlier, such as before the page was loaded again. */
  async follow(job) {
    this.duration = job.request?.duration ?? job.request?.scene?.duration;
    await this.#until(async () => [job, job.state === "done"]);
  }

  async #until(begin) {
    if (this.busy) return;
    const abort = (this.abort = new AbortController());
    this.began = performance.now();
    clearProblem(this.parts.problem);
    this.#show(true);
    this.#say("Asking…");
    try {
      let [job, stored] = await begin();
      const path = `/v1/${this.kind}/${job.id}`;
      if (abort.unwanted && !OVER.includes(job.state)) post(`${path}/cancel`, {}).catch(() => {});
      if (abort.signal.aborted) return;
      this.path = path;
      this.onStart(job);
      while (!OVER.includes(job.state)) job = await this.#next(job);
      if (abort.signal.aborted) return;
      if (job.state === "done") {
        job = job.result ? job : await get(this.path);
        const took = `Done in ${seconds((performance.now() - this.began) / 1000)}.`;
        this.#say(stored ? "From the store: the same was asked before." : took);
        await this.onResult(job);
      } else if (job.state === "cancelled") {
        this.#say("Cancelled.");
      } else {
        job = await get(this.path);
        throw new Problem(job.problem ?? { detail: `It was ${job.state}.`, remedy: "Run it again." });
      }
    } catch (failure) {
      if (abort.signal.aborted) return;
      this.#say("");
      showProblem(this.parts.problem, failure);
      this.onProblem?.(failure);
    } finally {
      if (this.abort === abort) {
        this.abort = this.path = undefined;
        this.#show(false);
      }
    }
  }

  /** The job's next states from its stream of events; when the stream breaks off, by another request. */
  async #next(job) {
    try {
      for await (const { event, data } of events(`${this.path}/events`, this.abort.signal)) {
        job = data;
        this.#progress(job);
        if (event === "end") return job;
      }
    } catch (failure) {
      if (failure.gone || failure.status || failure.name === "AbortError") throw failure;
    }
    await new Promise(done => setTimeout(done, 500));
    return get(this.path);
  }

  async cancel() {
    this.#say("Cancelling…");
    try {
      await this.#end();
    } catch (failure) {
      if (failure.status !== 409) showProblem(this.parts.problem, failure);
    }
  }

  #progress(job) {
    const { progress } = this.parts;
    const fraction = job.progress?.fraction;
    if (job.state === "queued" || fraction === undefined) progress.removeAttribute("value");
    else progress.value = fraction;
    const percent = fraction === undefined ? "" : ` ${Math.round(100 * fraction)} %`;
    this.#say(`${job.state === "queued" ? "Queued" : "Running"}${percent}: ${this.#doing(job)}`);
    this.onProgress?.(job);
  }

  /** What a job is doing, in words. */
  #doing({ state, progress }) {
    if (state === "queued") return "waiting for its turn";
    if (progress?.t === undefined) return progress?.label ?? "preparing and starting";
    const whole = this.duration ? ` of ${short(this.duration)}` : "";
    const again = { 1: "", 2: ", solved again for the error bar" }[progress.solution] ?? ", solved more accurately";
    return `t = ${progress.t.toFixed(2)}${whole} s${again}`;
  }

  #show(running) {
    const { start, cancel, progress } = this.parts;
    const focused = document.activeElement;
    start.disabled = running;
    cancel.hidden = progress.hidden = !running;
    if (running) progress.removeAttribute("value");
    if (running && focused === start) cancel.focus();
    if (!running && (focused === cancel || focused === document.body)) start.focus({ preventScroll: true });
  }

  #say(text) {
    this.parts.status.textContent = text;
  }
}
