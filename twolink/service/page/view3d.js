// The robot in 3D: meshcat's viewer (three.js inside) from the service, without its controls.

const FIELD_OF_VIEW = 32; // degrees; narrow, so that parallel rods look parallel
const DIRECTION = [0.3, -1, 0.24]; // from the robot to the eye; z is up
const MOST = 0.8; // of the links: the picture reaches twice as far as they do

/** Load meshcat's script. It writes style rules for menus this page does not show, and the page's policy refuses
 * inline styles; so while it loads, elements for such rules are harmless ones. */
async function loadMeshcat() {
  if (window.MeshCat) return;
  const create = document.createElement;
  document.createElement = function (name, ...rest) {
    if (String(name).toLowerCase() !== "style") return create.call(document, name, ...rest);
    return Object.assign(create.call(document, "meta"), { sheet: { insertRule() {} } });
  };
  try {
    await new Promise((done, fail) => {
      const script = create.call(document, "script");
      script.src = "/page/meshcat.js";
      script.onload = done;
      script.onerror = () => fail(new Error("meshcat's viewer could not be loaded"));
      document.head.append(script);
    });
  } finally {
    delete document.createElement;
  }
  if (!window.MeshCat) throw new Error("meshcat's viewer could not be started");
}

/** Typed arrays come as {"$array": class, "base64": bytes}. */
function revive(value) {
  if (Array.isArray(value)) return value.map(revive);
  if (value === null || typeof value !== "object") return value;
  if (value.$array) {
    const bytes = Uint8Array.from(atob(value.base64), c => c.charCodeAt(0));
    return new globalThis[value.$array](bytes.buffer);
  }
  return Object.fromEntries(Object.entries(value).map(([name, item]) => [name, revive(item)]));
}

export class View {
  constructor(pane, note) {
    this.pane = pane;
    this.note = note;
    this.links = new Map(); // name -> three.js group
    this.turned = false;
    this.swept = null; // the corners that the camera keeps in the picture
  }

  /** Start drawing. The page says so when that is impossible, and works without it. */
  async start() {
    try {
      await loadMeshcat();
      this.viewer = new window.MeshCat.Viewer(this.pane);
    } catch (failure) {
      this.viewer = null;
      this.note.textContent = `The robot cannot be drawn in this browser (${failure.message}); all else works.`;
      return;
    }
    const { viewer } = this;
    this.three = window.MeshCat.THREE;
    viewer.gui.domElement.remove();
    window.onload = null;
    viewer.set_3d_pane_size = () => this.resize();
    new ResizeObserver(() => this.resize()).observe(this.pane);
    for (const name of ["Grid", "Axes"]) viewer.set_property([name], "visible", false);
    for (const name of ["PointLightNegativeX", "PointLightPositiveX"]) {
      viewer.set_property(["Lights", name], "visible", false);
    }
    viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.6);
    viewer.set_property(["Lights", "FillLight", "<object>"], "intensity", 0.5);
    viewer.set_property(["Lights", "FillLight", "<object>"], "position", [6, -10, 11]);
    viewer.camera.fov = FIELD_OF_VIEW;
    viewer.controls.enableZoom = false; // the wheel scrolls the page until someone takes hold of the robot
    viewer.controls.addEventListener("start", () => {
      this.turned = true;
    });
    this.pane.addEventListener("pointerdown", () => {
      this.pane.focus({ preventScroll: true });
    });
    this.pane.addEventListener("focus", () => {
      viewer.controls.enableZoom = true;
    });
    this.pane.addEventListener("blur", () => {
      viewer.controls.enableZoom = false;
    });
    this.pane.addEventListener("keydown", event => this.#key(event));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#colours());
    this.#colours();
    this.resize();
  }

  #colours() {
    const style = getComputedStyle(document.documentElement);
    const numbers = name =>
      style
        .getPropertyValue(name)
        .trim()
        .split(/[ ,]+/)
        .map(x => Number(x) / 255);
    this.viewer.set_property(["Background"], "top_color", numbers("--view-top"));
    this.viewer.set_property(["Background"], "bottom_color", numbers("--view-bottom"));
    if (this.floor) this.floor.material.color.set(style.getPropertyValue("--view-grid").trim());
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

  /** Draw a robot. visuals: as the service sends them. */
  load(visuals) {
    if (!this.viewer) return;
    this.viewer.delete_path(["robot"]);
    this.links.clear();
    let unread = 0;
    visuals.pieces.forEach((piece, i) => {
      const link = piece.link === null ? "world" : `link ${visuals.links.indexOf(piece.link)}`;
      const path = ["robot", link, `piece ${i}`];
      try {
        this.viewer.set_object_from_json(path, revive(piece.object));
      } catch (failure) {
        // one mesh that cannot be read must not hide the others
        console.warn(`${piece.name} cannot be drawn:`, failure);
        unread += 1;
      }
      const node = this.viewer.scene_tree.find(path).object;
      node.position.fromArray(piece.placement);
      node.quaternion.fromArray(piece.placement, 3);
      if (piece.link !== null) this.links.set(piece.link, this.viewer.scene_tree.find(path.slice(0, 2)).object);
    });
    const left = visuals.skipped.length + unread;
    this.note.textContent =
      visuals.pieces.length === 0
        ? "This robot has nothing to draw: its links have no <visual> elements. All else works."
        : left
          ? `${left} of its pieces cannot be drawn`
          : "";
    this.turned = false;
    this.swept = null;
    this.viewer.set_dirty();
  }

  /** Move the links: poses in the order of the names, [x, y, z, qx, qy, qz, qw] each. */
  pose(names, poses) {
    if (!this.viewer) return;
    names.forEach((name, i) => {
      const group = this.links.get(name);
      if (!group) return;
      group.position.fromArray(poses[i]);
      group.quaternion.fromArray(poses[i], 3);
    });
    this.viewer.set_dirty();
  }

  /** Between two frames of a motion: part 0 is the first, 1 the second. */
  between(names, before, after, part) {
    if (!this.viewer) return;
    this.other ??= new this.three.Quaternion();
    names.forEach((name, i) => {
      const group = this.links.get(name);
      if (!group) return;
      const [a, b] = [before[i], after[i]];
      group.position.set(...[0, 1, 2].map(k => a[k] + part * (b[k] - a[k])));
      group.quaternion.fromArray(a, 3).slerp(this.other.fromArray(b, 3), part);
    });
    this.viewer.set_dirty();
  }

  /** Aim the camera at all that the robot covers now, or at several times (functions that pose it). */
  fit(moments = [() => {}]) {
    if (!this.viewer) return;
    const all = [];
    for (const moment of moments) {
      moment();
      this.viewer.scene.updateMatrixWorld(true);
      const links = this.viewer.scene_tree.find(["robot"]).object.children;
      all.push(links.map(link => new this.three.Box3().setFromObject(link)).filter(part => !part.isEmpty()));
    }
    const box = new this.three.Box3(),
      corners = [];
    for (const part of this.#near(all)) {
      box.union(part);
      const { min, max } = part;
      for (const x of [min.x, max.x])
        for (const y of [min.y, max.y])
          for (const z of [min.z, max.z]) {
            corners.push(new this.three.Vector3(x, y, z));
          }
    }
    if (box.isEmpty()) return;
    this.swept = corners;
    this.turned = false;
    this.#lay(box);
    this.#aim();
  }

  /** The links' boxes at all times, without links that fly far away: the others would be too small to see. */
  #near(all) {
    const first = all[0].reduce((whole, part) => whole.union(part), new this.three.Box3());
    const [centre, size] = [
      first.getCenter(new this.three.Vector3()),
      first.getSize(new this.three.Vector3()).length(),
    ];
    const far = part => part.getCenter(new this.three.Vector3()).distanceTo(centre);
    const parts = all.flat();
    const sorted = parts.map(far).sort((a, b) => a - b);
    const reach = 2 * (sorted[Math.floor(MOST * (sorted.length - 1))] ?? 0) + size / 2;
    return parts.filter(part => far(part) <= reach);
  }

  /** Place the camera so that all corners are visible. The scene is turned: z up is three.js's y. */
  #aim() {
    if (!this.swept) return;
    const { camera, controls } = this.viewer;
    const eye = new this.three.Vector3(DIRECTION[0], DIRECTION[2], -DIRECTION[1]).normalize();
    const right = new this.three.Vector3(0, 1, 0).cross(eye).normalize();
    const up = eye.clone().cross(right);
    const slope = Math.tan((FIELD_OF_VIEW * Math.PI) / 360) / 1.12;
    const middle = axis => {
      const along = this.swept.map(corner => corner.dot(axis));
      return (Math.min(...along) + Math.max(...along)) / 2;
    };
    const centre = new this.three.Vector3();
    for (const axis of [eye, right, up]) centre.addScaledVector(axis, middle(axis));
    let distance = 0.05;
    for (const corner of this.swept) {
      const at = corner.clone().sub(centre);
      const wide = Math.max(Math.abs(at.dot(up)), Math.abs(at.dot(right)) / camera.aspect);
      distance = Math.max(distance, at.dot(eye) + wide / slope);
    }
    camera.near = distance / 100;
    camera.far = distance * 100;
    controls.target.copy(centre);
    camera.position.copy(centre).addScaledVector(eye, distance);
    this.viewer.set_dirty();
  }

  /** A floor of round squares below what is swept. */
  #lay(box) {
    const size = Math.max(...box.getSize(new this.three.Vector3()).toArray(), 0.02);
    const decade = 10 ** Math.floor(Math.log10(size / 2));
    const cell = decade * (size / 2 / decade >= 5 ? 5 : size / 2 / decade >= 2 ? 2 : 1);
    const centre = box.getCenter(new this.three.Vector3());
    const [x, y] = [Math.round(centre.x / cell) * cell, Math.round(-centre.z / cell) * cell];
    const reach = Math.ceil((0.9 * size) / cell);
    const points = [];
    for (let i = -reach; i <= reach; i++) {
      points.push(x + i * cell, y - reach * cell, 0, x + i * cell, y + reach * cell, 0);
      points.push(x - reach * cell, y + i * cell, 0, x + reach * cell, y + i * cell, 0);
    }
    const geometry = new this.three.BufferGeometry();
    geometry.setAttribute("position", new this.three.Float32BufferAttribute(points, 3));
    this.floor = new this.three.LineSegments(geometry, new this.three.LineBasicMaterial());
    this.floor.position.z = box.min.y - 0.002 * size;
    this.viewer.set_object(["floor"], this.floor);
    this.#colours();
  }

  #key(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const zoom = { "+": 1 / 1.15, "=": 1 / 1.15, "-": 1.15 }[event.key];
    if (event.key === "0") this.fit();
    if (!turns && !zoom) return;
    event.preventDefault();
    this.turned = true;
    const { camera, controls } = this.viewer;
    const offset = camera.position.clone().sub(controls.target);
    const round = new this.three.Spherical().setFromVector3(offset);
    if (turns) {
      round.theta += 0.12 * turns[0];
      round.phi = Math.min(Math.max(round.phi + 0.12 * turns[1], 0.05), Math.PI - 0.05);
    } else round.radius *= zoom;
    camera.position.copy(controls.target).add(offset.setFromSpherical(round));
    this.viewer.set_dirty();
  }
}
