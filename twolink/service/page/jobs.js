// A job of the service: start it, follow its progress, cancel it. One at a time.

import { events, get, post, Problem } from "./api.js";
import { clearProblem, seconds, showProblem } from "./dom.js";

const OVER = ["done", "failed", "cancelled", "interrupted"];

export class Job {
  /** parts: the elements start, cancel, progress, status and problem. kind: "simulations" or "studies". */
  constructor(kind, parts, onResult) {
    Object.assign(this, { kind, parts, onResult });
    parts.cancel.addEventListener("click", () => this.cancel());
  }

  get busy() {
    return this.abort !== undefined;
  }

  /** Ask for a job and wait for its end; onResult(job) when it is done. */
  async run(body) {
    if (this.busy) return;
    this.abort = new AbortController();
    this.began = performance.now();
    clearProblem(this.parts.problem);
    this.#show(true);
    this.#say("Asking…");
    try {
      let job = await post(`/v1/${this.kind}`, { ...body, wait: 0 });
      this.path = `/v1/${this.kind}/${job.id}`;
      const stored = job.state === "done";
      if (["failed", "cancelled", "interrupted"].includes(job.state)) job = await post(`${this.path}/run`, {});
      while (!OVER.includes(job.state)) job = await this.#follow(job);
      if (job.state === "done") {
        job = job.result ? job : await get(this.path);
        this.#say(
          stored
            ? "From the store: the same was asked before."
            : `Done in ${seconds((performance.now() - this.began) / 1000)}.`,
        );
        await this.onResult(job);
      } else if (job.state === "cancelled") {
        this.#say("Cancelled.");
      } else {
        job = await get(this.path);
        throw new Problem(job.problem ?? { detail: `It was ${job.state}.`, remedy: "Run it again." });
      }
    } catch (failure) {
      this.#say("");
      showProblem(this.parts.problem, failure);
      this.onProblem?.(failure);
    } finally {
      this.abort = this.path = undefined;
      this.#show(false);
    }
  }

  /** The job's next states from its stream of events; when the stream breaks off, by another request. */
  async #follow(job) {
    try {
      for await (const { event, data } of events(`${this.path}/events`, this.abort.signal)) {
        job = data;
        this.#progress(job);
        if (event === "end") return job;
      }
    } catch (failure) {
      if (failure.gone || failure.status) throw failure;
    }
    await new Promise(done => setTimeout(done, 500));
    return get(this.path);
  }

  async cancel() {
    if (!this.path) return;
    this.#say("Cancelling…");
    try {
      await post(`${this.path}/cancel`, {});
    } catch (failure) {
      if (failure.status !== 409) showProblem(this.parts.problem, failure);
    }
  }

  #progress(job) {
    const { progress } = this.parts;
    const fraction = job.progress?.fraction;
    if (job.state === "queued" || fraction === undefined) progress.removeAttribute("value");
    else progress.value = fraction;
    const p = job.progress ?? {};
    const done =
      p.t !== undefined
        ? `t = ${p.t.toFixed(2)} s${p.solution ? `, ${p.solution}` : ""}`
        : (p.label ?? (job.state === "queued" ? "waiting for its turn" : "compiling and starting"));
    const percent = fraction === undefined ? "" : ` ${Math.round(100 * fraction)} %`;
    this.#say(`${job.state === "queued" ? "Queued" : "Running"}${percent}: ${done}`);
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
