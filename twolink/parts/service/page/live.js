// A live simulation of the scene: its links are dragged with the mouse, and answer.

import { Problem, socket } from "./api.js";
import { byId, clearProblem, showProblem } from "./dom.js";

const MOST = 60; // messages a second

export class Live {
  /** scene(): the scene as JSON. onEnd(): the simulation is over. */
  constructor(viewer, scene, onEnd) {
    Object.assign(this, { viewer, scene, onEnd, socket: null, grip: null, sent: 0 });
    this.button = byId("live-button");
    this.button.addEventListener("click", () => (this.socket ? this.stop() : this.start()));
    const { pane } = viewer;
    pane.addEventListener("pointerdown", event => this.#grab(event), true);
    pane.addEventListener("pointermove", event => this.grip && this.#pull(event), true);
    for (const kind of ["pointerup", "pointercancel"]) pane.addEventListener(kind, () => this.#release(), true);
  }

  start() {
    clearProblem(byId("live-problem"));
    const opened = (this.socket = socket("/v1/live"));
    let links = null;
    this.#say("It begins…");
    opened.onopen = () => opened.send(JSON.stringify({ scene: this.scene() }));
    opened.onmessage = ({ data }) => {
      if (opened !== this.socket) return;
      const frame = JSON.parse(data);
      if (frame.problem) showProblem(byId("live-problem"), new Problem(frame.problem));
      if (!frame.poses) return;
      links ??= frame.links;
      this.viewer.pose(links, frame.poses);
      this.#say(`${frame.t.toFixed(1)} s. Drag a link with the mouse.`);
    };
    opened.onclose = () => opened === this.socket && this.stop();
  }

  stop() {
    if (!this.socket) return;
    const closed = this.socket;
    this.socket = this.grip = null;
    closed.close();
    this.#say("");
    this.onEnd();
  }

  #say(text) {
    this.button.textContent = this.socket ? "Stop" : "Live";
    byId("live-status").textContent = text;
  }

  #grab(event) {
    if (event.button !== 0 || this.socket?.readyState !== WebSocket.OPEN) return;
    this.grip = this.viewer.grab(event);
    if (!this.grip) return;
    event.stopPropagation(); // the camera stays
    this.viewer.pane.setPointerCapture(event.pointerId);
    this.#pull(event);
  }

  #pull(event) {
    event.stopPropagation();
    if (performance.now() - this.sent < 1000 / MOST) return;
    this.sent = performance.now();
    const { link, point, to } = this.grip;
    this.#send({ drag: { link, point, to: to(event) } });
  }

  #release() {
    if (this.grip) this.#send({});
    this.grip = null;
  }

  #send(words) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(words));
  }
}
