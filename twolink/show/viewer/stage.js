// The 3D picture: meshcat's viewer (three.js inside) without its own controls; light, shadow, floor and camera.

const FIELD_OF_VIEW = 32; // degrees; narrow, so that parallel rods look parallel
const SLANTED = [0.3, -1, 0.24]; // from the robot to the eye, where the motion has no plane; z is up
const MOST = 0.8; // of the links: the picture reaches twice as far as they do
const FAR = 4; // sizes of a robot, which a link that has left it flies
const MARGIN = 1.12;
const SHADOW_PIXELS = 1024;
const FRAMES = 40; // of a motion, which decide where the camera stands

export class Stage {
  /** pane: the element to draw in; meshcat's script must be loaded. wheel: it zooms even without the focus. Throws where
   * the browser cannot draw in 3D. */
  constructor(pane, wheel) {
    this.pane = pane;
    this.viewer = new window.MeshCat.Viewer(pane);
    this.THREE = window.MeshCat.THREE;
    this.turned = false; // someone has turned the camera
    this.swept = null; // the corners that the camera keeps in the picture
    this.direction = SLANTED;
    this.anchor = null; // what the camera follows
    const { viewer } = this;
    viewer.gui.domElement.remove();
    window.onload = null;
    viewer.set_3d_pane_size = () => this.resize();
    viewer.camera.fov = FIELD_OF_VIEW;
    viewer.renderer.shadowMap.type = this.THREE.PCFShadowMap; // the soft one takes half as long again, unseen here
    viewer.controls.enableZoom = wheel; // otherwise it scrolls the page until someone takes hold of the robot
    viewer.controls.addEventListener("start", () => (this.turned = true));
    pane.addEventListener("pointerdown", () => pane.focus({ preventScroll: true }));
    pane.addEventListener("focus", () => (viewer.controls.enableZoom = true));
    pane.addEventListener("blur", () => (viewer.controls.enableZoom = wheel));
    pane.addEventListener("keydown", event => this.#key(event));
    this.#light();
    new ResizeObserver(() => this.resize()).observe(pane);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#colours());
    this.#colours();
    this.resize();
  }

  /** Light from the sky and one lamp. Together they are 1 on a surface that faces them: colours are those of the URDF. */
  #light() {
    const { viewer, THREE } = this;
    for (const name of ["Grid", "Axes", "Lights"]) viewer.set_property([name], "visible", false);
    const sky = new THREE.HemisphereLight(0xffffff, 0xd4d8e0, 0.58);
    sky.position.set(0, 0, 1);
    this.lamp = new THREE.DirectionalLight(0xffffff, 0.48);
    this.lamp.castShadow = true;
    this.lamp.shadow.mapSize.set(SHADOW_PIXELS, SHADOW_PIXELS);
    this.lamp.shadow.radius = 3;
    viewer.scene.add(sky, this.lamp, this.lamp.target);
  }

  #colours() {
    const style = getComputedStyle(this.pane);
    const numbers = name =>
      style
        .getPropertyValue(name)
        .trim()
        .split(/[ ,]+/)
        .map(x => Number(x) / 255);
    this.viewer.set_property(["Background"], "top_color", numbers("--view-top"));
    this.viewer.set_property(["Background"], "bottom_color", numbers("--view-bottom"));
    if (this.grid) this.grid.material.color.set(style.getPropertyValue("--view-grid").trim());
    this.viewer.set_dirty();
  }

  resize() {
    if (!this.viewer?.camera) return;
    const { clientWidth: width, clientHeight: height } = this.pane;
    if (!width || !height) return;
    this.viewer.camera.aspect = width / height;
    this.viewer.renderer.setSize(width, height);
    if (!this.turned) this.#aim();
    this.viewer.set_dirty();
  }

  set shadows(wanted) {
    this.lamp.castShadow = wanted;
    this.viewer.set_dirty();
  }

  /** Aim the camera at what robots cover along their motions: [{robot, motion}]. whole: also where links fly away from
   * others that stay, which are too small then. */
  fit(shown, direction = null, whole = false) {
    this.turned = false;
    this.direction = direction ?? SLANTED;
    const near = this.#near(shown, whole);
    if (!near.length) return;
    this.swept = near;
    this.box = new this.THREE.Box3().setFromPoints(this.swept);
    const lowest = reachedBy(shown[0], false).map(parts => Math.min(...parts.flat().map(corner => corner.z)));
    const moves = Math.max(...lowest) - Math.min(...lowest) > 1e-6;
    this.touches = shown.some(({ motion }) => motion.contacts.length || motion.events.some(e => e.text.startsWith("impact")));
    this.#lay(moves && !this.touches ? 0.04 : 0.0005);
    this.#aim();
  }

  /** The corners that links reach, without those far away: the others would be too small to see. whole: with all of the
   * scenery, and with links that leave the others. */
  #near(shown, whole) {
    const moving = shown.flatMap(each => reachedBy(each, true));
    const still = shown.flatMap(({ robot }) => robot.still);
    const start = moving[0]?.flat() ?? [];
    if (!start.length) return still;
    const [middle, size] = [this.#centre(start), this.#length(start)];
    const parts = moving.flat().map(corners => ({ corners, far: this.#centre(corners).distanceTo(middle) }));
    const sorted = parts.map(part => part.far).sort((a, b) => a - b);
    const left = !whole && shown.some(each => this.#isLeft(each));
    const reach = left ? 2 * size : 2 * sorted[Math.floor(MOST * (sorted.length - 1))] + size / 2;
    const near = parts.filter(part => part.far <= reach).flatMap(part => part.corners);
    const around = near.reduce((most, corner) => Math.max(most, corner.distanceTo(middle)), FAR * size);
    return [...near, ...still.filter(corner => whole || corner.distanceTo(middle) <= around)];
  }

  #centre(corners) {
    return new this.THREE.Box3().setFromPoints(corners).getCenter(new this.THREE.Vector3());
  }

  #length(corners) {
    return new this.THREE.Box3().setFromPoints(corners).getSize(new this.THREE.Vector3()).length();
  }

  /** Whether links fly far away from others that stay, as a ball that is thrown. */
  #isLeft(each) {
    const frames = reachedBy(each, true);
    const size = this.#length(frames[0].flat());
    const ways = frames[0].map((start, k) =>
      Math.max(...frames.map(parts => this.#centre(parts[k]).distanceTo(this.#centre(start)))),
    );
    return Math.min(...ways) <= size && Math.max(...ways) > FAR * size;
  }

  /** The size of what is shown, m. */
  get size() {
    return this.box ? Math.max(...this.box.getSize(new this.THREE.Vector3()).toArray(), 1e-6) : 1;
  }

  /** Place the camera so that all corners are visible. */
  #aim() {
    if (!this.swept) return;
    const { camera, controls } = this.viewer;
    const eye = this.#up(this.direction).normalize();
    const right = new this.THREE.Vector3(0, 1, 0).cross(eye).normalize();
    const up = eye.clone().cross(right);
    const slope = Math.tan((FIELD_OF_VIEW * Math.PI) / 360) / MARGIN;
    const seen = this.swept.map(corner => {
      const at = this.#up(corner.toArray());
      return [right, up, eye].map(axis => at.dot(axis));
    });
    const middle = [0, 1, 2].map(k => {
      const along = seen.map(at => at[k]);
      return (Math.min(...along) + Math.max(...along)) / 2;
    });
    const centre = new this.THREE.Vector3();
    [right, up, eye].forEach((axis, k) => centre.addScaledVector(axis, middle[k]));
    let distance = 1e-4;
    for (const [x, y, z] of seen) {
      const wide = Math.max(Math.abs(y - middle[1]), Math.abs(x - middle[0]) / camera.aspect);
      distance = Math.max(distance, z - middle[2] + wide / slope);
    }
    camera.near = distance / 100;
    camera.far = distance * 100;
    controls.target.copy(centre);
    camera.position.copy(centre).addScaledVector(eye, distance);
    this.anchor = null;
    this.viewer.set_dirty();
  }

  /** A vector with z up as the camera counts it, with y up. */
  #up([x, y, z]) {
    return new this.THREE.Vector3(x, z, -y);
  }

  /** Move the camera with a point (x, y, z), or stop (null). */
  follow(point) {
    const at = point && this.#up(point);
    if (at && this.anchor) {
      const shift = at.clone().sub(this.anchor);
      this.viewer.controls.target.add(shift);
      this.viewer.camera.position.add(shift);
    }
    this.anchor = at;
  }

  /** Look at a point from near enough to see what has these corners. */
  approach(point, parts) {
    if (!point || !parts.length) return;
    const { camera, controls } = this.viewer;
    const size = new this.THREE.Box3().setFromPoints(parts.flat()).getSize(new this.THREE.Vector3()).length();
    const target = this.#up(point);
    const away = camera.position.clone().sub(controls.target);
    away.setLength(Math.min(away.length(), 3 * size));
    controls.target.copy(target);
    camera.position.copy(target).add(away);
    camera.near = away.length() / 100;
    this.turned = true;
    this.anchor = null;
  }

  /** A floor of round squares with a shadow on it, `gap` of the size below what is swept; and the lamp above. */
  #lay(gap) {
    const { THREE, viewer, box, size } = this;
    if (this.floor) {
      viewer.scene.remove(this.floor);
      this.floor.children.forEach(child => child.geometry.dispose());
    }
    const decade = 10 ** Math.floor(Math.log10(size / 4));
    const cell = decade * (size / 4 / decade >= 5 ? 5 : size / 4 / decade >= 2 ? 2 : 1);
    const centre = box.getCenter(new THREE.Vector3());
    const reach = cell * Math.round((0.95 * size) / cell); // it ends in front of the camera
    const points = [];
    for (let at = -reach; at <= reach + cell / 2; at += cell) {
      points.push(at, -reach, 0, at, reach, 0, -reach, at, 0, reach, at, 0);
    }
    const lines = new THREE.BufferGeometry();
    lines.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    this.grid = new THREE.LineSegments(lines, new THREE.LineBasicMaterial());
    const shade = new THREE.Mesh(
      new THREE.PlaneGeometry(8 * size, 8 * size),
      new THREE.ShadowMaterial({ opacity: 0.22, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 40 }),
    );
    shade.receiveShadow = true;
    this.floor = new THREE.Group();
    this.floor.add(this.grid, shade);
    this.floor.position.set(
      ...[centre.x, centre.y].map(x => cell * Math.round(x / cell)),
      box.min.z - gap * size,
    );
    viewer.scene.add(this.floor);
    this.cell = cell;
    const eye = new THREE.Vector3(...this.direction).normalize();
    const left = eye.clone().cross(new THREE.Vector3(0, 0, 1));
    const to = eye.addScaledVector(left, 0.5).add(new THREE.Vector3(0, 0, 0.9)).normalize();
    const { lamp } = this;
    lamp.target.position.copy(centre);
    lamp.position.copy(centre).addScaledVector(to, 4 * size);
    const half = 1.3 * size;
    Object.assign(lamp.shadow.camera, { left: -half, right: half, bottom: -half, top: half, near: size, far: 8 * size });
    lamp.shadow.camera.updateProjectionMatrix();
    lamp.shadow.normalBias = (3 * half) / SHADOW_PIXELS;
    lamp.shadow.bias = -0.0005;
    this.#colours();
  }

  #key(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const zoom = { "+": 1 / 1.15, "=": 1 / 1.15, "-": 1.15 }[event.key];
    if (!turns && !zoom) return;
    event.preventDefault();
    this.turned = true;
    const { camera, controls } = this.viewer;
    const offset = camera.position.clone().sub(controls.target);
    const round = new this.THREE.Spherical().setFromVector3(offset);
    if (turns) {
      round.theta += 0.12 * turns[0];
      round.phi = Math.min(Math.max(round.phi + 0.12 * turns[1], 0.05), Math.PI - 0.05);
    } else round.radius *= zoom;
    camera.position.copy(controls.target).add(offset.setFromSpherical(round));
    this.viewer.set_dirty();
  }
}

/** The corners of a robot's links along its motion, by time and link; moving: without what is fixed. */
function reachedBy({ robot, motion }, moving) {
  return motion.some(FRAMES).map(i => robot.reached(motion, i, moving));
}
