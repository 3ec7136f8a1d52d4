// The viewer: one robot, or a second one as a ghost, its motion with time controls, and a menu of what is shown.

import { check, make } from "./elements.js";
import { Motion, revive, sizes } from "./motion.js";
import { CONTACT_COLOUR, FORCE_COLOUR, Overlays } from "./overlays.js";
import { Robot } from "./robot.js";
import { Stage } from "./stage.js";
import { Timeline } from "./timeline.js";

const GHOST = 0.28; // opacity
const LABEL = "The robot in 3D. Drag to turn it, arrow keys do too.";

export class Viewer {
  /** root: an empty element. onTime(t) is called for each time shown. wheel: it always zooms. */
  constructor(root, { onTime = () => {}, wheel = false } = {}) {
    this.onTime = onTime;
    this.wheel = wheel;
    this.pane = make("div", { id: "pane", className: "pane", tabIndex: 0, role: "img", ariaLabel: LABEL });
    this.note = make("p", { id: "view-note", className: "view-note", role: "status" });
    this.fitButton = make("button", { type: "button", id: "view-fit", className: "quiet", title: "Show all of it" }, "Fit");
    this.fitButton.addEventListener("click", () => this.fit(true));
    this.menu = make("div", { className: "menu", id: "view-menu" });
    const shown = make("details", { id: "view-shown" }, make("summary", { className: "quiet" }, "Show"), this.menu);
    const bar = make("div", { className: "playback", id: "playback", role: "group", ariaLabel: "Playback", hidden: true });
    root.classList.add("viewer");
    const view = make("div", { className: "view" }, this.pane, this.note);
    view.append(make("div", { className: "view-buttons" }, this.fitButton, shown));
    root.append(view, bar);
    this.timeline = new Timeline(bar, t => this.#show(t));
    this.pane.addEventListener("keydown", event => {
      if (event.key === "0") this.fit(true);
      if (event.key !== " " || bar.hidden) return;
      event.preventDefault();
      this.timeline.toggle();
    });
    this.choice = { shadows: true, follow: "", frames: false, centre: false, contacts: true, forces: false, ghost: true, trails: null };
  }

  /** Start drawing; meshcat's script must be loaded. Where that is impossible the note says so: all else works. */
  start() {
    try {
      if (!window.MeshCat) throw new Error("meshcat's viewer could not be loaded");
      this.stage = new Stage(this.pane, this.wheel);
      this.overlays = new Overlays(this.stage);
    } catch (failure) {
      this.stage = null;
      this.note.textContent = `The robot cannot be drawn in this browser (${failure.message}); all else works.`;
    }
  }

  /** Draw a robot. visuals: as the service sends them. */
  load(visuals) {
    this.stop();
    if (!this.stage) return;
    this.robot?.remove();
    this.visuals = revive(visuals);
    this.robot = new Robot(this.stage.viewer, this.stage.THREE, this.visuals, "robot");
    const left = visuals.skipped.length + this.robot.unread;
    this.note.textContent =
      visuals.pieces.length === 0
        ? "This robot has nothing to draw: its links have no <visual> elements, or their meshes are missing. All else works."
        : left
          ? `${left} of its pieces cannot be drawn`
          : "";
    this.choice.trails = this.robot.tips.length === 1 ? [...this.robot.tips] : [];
    this.choice.follow = "";
  }

  /** Pose the robot: poses of links by name, [x, y, z, qx, qy, qz, qw] each. */
  pose(links, poses) {
    this.timeline.unload();
    this.still = new Motion({ t: [0], links, poses });
    this.posed = true;
    if (!this.stage) return;
    this.#redraw();
    this.#show(0);
  }

  /** What is under the pointer: {link, point (along its axes), to(event): the point of the world under a pointer, as far
   * from the eye}; null: no link. */
  grab(event) {
    if (!this.stage || !this.robot) return null;
    const { THREE, viewer } = this.stage;
    const ray = pointer => {
      const { left, top, width, height } = this.pane.getBoundingClientRect();
      const at = { x: (2 * (pointer.clientX - left)) / width - 1, y: 1 - (2 * (pointer.clientY - top)) / height };
      const caster = new THREE.Raycaster();
      caster.setFromCamera(at, viewer.camera);
      return caster;
    };
    const hits = [...this.robot.links].flatMap(([link, { group }]) =>
      ray(event).intersectObject(group, true).map(hit => ({ ...hit, link, group })),
    );
    const hit = hits.sort((a, b) => a.distance - b.distance)[0];
    if (!hit) return null;
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(
      viewer.camera.getWorldDirection(new THREE.Vector3()),
      hit.point,
    );
    const to = pointer => {
      const at = ray(pointer).ray.intersectPlane(plane, new THREE.Vector3()) ?? hit.point;
      return hit.group.parent.worldToLocal(at.clone()).toArray();
    };
    return { link: hit.link, point: hit.group.worldToLocal(hit.point.clone()).toArray(), to };
  }

  /** Play a motion of the robot: {t, links, poses, ...} as `Motion` takes it. fit: the camera is aimed anew. */
  play(data, { speed = null, loop = false, fit = true } = {}) {
    this.motion = new Motion(revive(data));
    this.posed = false;
    if (fit) this.fit();
    else this.#redraw();
    this.timeline.loop = loop;
    this.timeline.load(this.motion.begin, this.motion.end, this.motion.events, speed);
  }

  /** Lay a second motion over the first, as a ghost: of the same robot, or of the one that visuals describe. */
  compare(data, visuals = null, title = "compared run") {
    if (!this.stage || !this.motion) return;
    this.uncompare();
    const { viewer, THREE } = this.stage;
    this.ghost = {
      robot: new Robot(viewer, THREE, visuals ? revive(visuals) : this.visuals, "ghost", GHOST),
      motion: new Motion(revive(data)),
      title,
    };
    this.fit();
    this.#show(this.timeline.t);
  }

  uncompare() {
    this.ghost?.robot.remove();
    this.ghost = null;
  }

  /** Show a time of the motion, also after the robot was posed otherwise. */
  seek(t) {
    if (!this.motion) return;
    this.timeline.root.hidden = false;
    if (this.posed) {
      this.posed = false;
      this.#redraw();
    }
    this.timeline.seek(t);
  }

  /** Forget the motion, and hide the time controls. */
  stop() {
    this.timeline.unload();
    this.uncompare();
    this.motion = null;
    this.posed = false;
  }

  get #shown() {
    return this.posed ? this.still : (this.motion ?? this.still);
  }

  /** Aim the camera at what is reached. whole: also by what flies far away. */
  fit(whole = false) {
    const motion = this.#shown;
    if (!this.stage || !this.robot || !motion) return;
    const shown = [{ robot: this.robot, motion }];
    if (this.ghost && !this.posed) shown.push(this.ghost);
    this.stage.fit(shown, motion.direction ?? this.visuals.direction, whole);
    this.#redraw();
  }

  #show(t) {
    const motion = this.#shown;
    if (this.stage && this.robot && motion) {
      this.robot.at(motion, t);
      this.ghost?.robot.at(this.ghost.motion, t);
      this.overlays.at(motion, t);
      this.stage.follow(this.choice.follow ? this.#followed(motion, t) : null);
    }
    if (this.motion && !this.posed) this.onTime(t);
  }

  /** Where the frame is that the camera follows; null for one that the motion does not have. */
  #followed(motion, t) {
    const [i, part] = motion.locate(t);
    const [here, next] = [i, Math.min(i + 1, motion.t.length - 1)].map(k =>
      this.robot.frameAt(motion, this.choice.follow, k),
    );
    return here && here.position.lerp(next.position, part).toArray();
  }

  /** Let the camera go with a frame (""), from near where the way is long. */
  #follow(frame) {
    this.choice.follow = frame;
    const motion = this.#shown;
    if (frame) this.stage.approach(this.#followed(motion, this.timeline.t), this.robot.reached(motion, 0, true));
    else this.fit();
    this.#show(this.timeline.t);
  }

  /** Draw what is chosen over the robot, and the menu of the choices there are. */
  #redraw() {
    const motion = this.#shown;
    if (!this.stage || !this.robot || !motion) return;
    const { overlays, choice, stage, robot } = this;
    const moving = motion.t.length > 1;
    overlays.clear();
    stage.shadows = choice.shadows;
    this.ghost?.robot.show(choice.ghost && !this.posed);
    if (choice.frames) overlays.frames("frames", robot, motion, [...robot.frames.keys()], 0.1 * stage.size);
    if (choice.centre && motion.centre) overlays.centre("centre", motion, stage.floor.position.z);
    if (choice.contacts && motion.contacts.length) overlays.arrows("contacts", motion.contacts, CONTACT_COLOUR);
    if (choice.forces && motion.forces.length) overlays.arrows("forces", motion.forces, FORCE_COLOUR);
    for (const frame of moving ? choice.trails : []) {
      overlays.trail(`trail ${frame}`, robot, motion, frame, () => this.timeline.speed);
    }
    overlays.at(motion, this.posed ? 0 : this.timeline.t);
    this.#menu(motion, moving);
  }

  #menu(motion, moving) {
    const { choice } = this;
    const item = (key, text) =>
      check(text, choice[key], checked => {
        choice[key] = checked;
        this.#redraw();
      });
    const newtons = [motion.contacts, motion.forces].map(acting => Number((sizes(acting).at(-1) ?? 0).toPrecision(3)));
    const items = [
      item("shadows", "shadows"),
      item("frames", "frames of the links"),
      motion.centre && item("centre", "centre of mass"),
      motion.contacts.length && item("contacts", `contact forces, up to ${newtons[0]} N`),
      motion.forces.length && item("forces", `forces on links, up to ${newtons[1]} N`),
      this.ghost && item("ghost", this.ghost.title),
    ];
    const key = JSON.stringify([moving, newtons, this.ghost?.title, [...this.robot.frames.keys()]]);
    if (key === this.menu.dataset.key) return; // whoever is choosing keeps the focus
    this.menu.dataset.key = key;
    this.menu.replaceChildren(...items.filter(Boolean));
    if (moving) this.menu.append(this.#camera(), this.#trails());
  }

  #camera() {
    const names = ["", ...this.robot.frames.keys()];
    const select = make("select", {}, ...names.map(value => make("option", { value }, value || "all of the motion")));
    select.value = this.choice.follow;
    select.addEventListener("change", () => this.#follow(select.value));
    return make("label", {}, "camera on ", select);
  }

  #trails() {
    const { choice } = this;
    const boxes = [...this.robot.frames.keys()].map(frame =>
      check(frame, choice.trails.includes(frame), checked => {
        choice.trails = checked ? [...choice.trails, frame] : choice.trails.filter(other => other !== frame);
        this.#redraw();
      }),
    );
    return make("fieldset", {}, make("legend", {}, "trails"), ...boxes);
  }
}
