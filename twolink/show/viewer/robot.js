// One robot in the picture: the pieces of its links, and where they are.

const DRAWN_FIRST = 16; // steps of depth that keep coinciding faces of different links from flickering

export class Robot {
  /** visuals: {links, objects, pieces: [{name, link, placement, box, object}]}; opacity below 1: a ghost. */
  constructor(viewer, THREE, visuals, name, opacity = 1) {
    Object.assign(this, { viewer, THREE, name });
    this.links = new Map(); // name -> {group, corners}
    this.still = []; // corners of what is fixed to the world
    this.unread = 0;
    this.frames = new Map((visuals.frames ?? visuals.links.map(link => ({ name: link, link }))).map(f => [f.name, f]));
    this.tips = visuals.tips ?? [];
    visuals.pieces.forEach((piece, i) => this.#add(piece, i, visuals, opacity));
    this.other = new THREE.Quaternion();
    viewer.set_dirty();
  }

  #add(piece, i, visuals, opacity) {
    const { viewer, THREE } = this;
    const order = piece.link === null ? 0 : 1 + visuals.links.indexOf(piece.link);
    const path = [this.name, piece.link === null ? "world" : `link ${order}`, `piece ${i}`];
    try {
      viewer.set_object_from_json(path, shaded(visuals.objects[piece.object], order % DRAWN_FIRST, opacity));
    } catch (failure) {
      // one mesh that cannot be read must not hide the others
      console.warn(`${piece.name} cannot be drawn:`, failure);
      this.unread += 1;
    }
    const node = viewer.scene_tree.find(path).object;
    node.position.fromArray(piece.placement);
    node.quaternion.fromArray(piece.placement, 3);
    node.updateMatrix();
    const corners = cornersOf(piece.box).map(corner => new THREE.Vector3(...corner).applyMatrix4(node.matrix));
    if (piece.link === null) this.still.push(...corners);
    else if (this.links.has(piece.link)) this.links.get(piece.link).corners.push(...corners);
    else this.links.set(piece.link, { group: viewer.scene_tree.find(path.slice(0, 2)).object, corners });
  }

  remove() {
    this.viewer.delete_path([this.name]);
    this.viewer.set_dirty();
  }

  show(visible) {
    this.viewer.set_property([this.name], "visible", visible);
    this.viewer.set_dirty();
  }

  /** Put the links where a motion has them at a time. */
  at(motion, t) {
    const [i, part] = motion.locate(t);
    motion.links.forEach((name, k) => {
      const link = this.links.get(name);
      if (!link) return;
      const pose = motion.pose(i, k);
      link.group.position.fromArray(pose);
      link.group.quaternion.fromArray(pose, 3);
      if (part === 0) return;
      const next = motion.pose(i + 1, k);
      link.group.position.lerp(this.#point(next), part);
      link.group.quaternion.slerp(this.other.fromArray(next, 3), part);
    });
    this.viewer.set_dirty();
  }

  #point(numbers) {
    this.scratch ??= new this.THREE.Vector3();
    return this.scratch.fromArray(numbers);
  }

  /** The corners of each link's boxes in frame i of a motion, one list a link; moving: without what is fixed. */
  reached(motion, i, moving = false) {
    const turned = new this.THREE.Quaternion(),
      shift = new this.THREE.Vector3();
    const boxes = motion.links.flatMap((name, k) => {
      const link = this.links.get(name);
      if (!link) return [];
      const pose = motion.pose(i, k);
      turned.fromArray(pose, 3);
      shift.fromArray(pose);
      return [link.corners.map(corner => corner.clone().applyQuaternion(turned).add(shift))];
    });
    return this.still.length && !moving ? [this.still, ...boxes] : boxes;
  }

  /** Where a frame is in frame i of a motion: {position, quaternion}, or null for one that the motion does not have. */
  frameAt(motion, name, i) {
    const frame = this.frames.get(name);
    const k = frame ? motion.links.indexOf(frame.link) : -1;
    if (k < 0) return null;
    const pose = motion.pose(i, k);
    const position = new this.THREE.Vector3(),
      quaternion = new this.THREE.Quaternion().fromArray(pose, 3);
    if (frame.placement) position.fromArray(frame.placement);
    position.applyQuaternion(quaternion).add(new this.THREE.Vector3().fromArray(pose));
    if (frame.placement) quaternion.multiply(new this.THREE.Quaternion().fromArray(frame.placement, 3));
    return { position, quaternion };
  }
}

/** The eight corners of a box [x, y, z, X, Y, Z]. */
function cornersOf(box) {
  return Array.from({ length: 8 }, (_, i) => [0, 1, 2].map(k => box[k + (i & (1 << k) ? 3 : 0)]));
}

/** An object's JSON with its materials at a depth of their own, and see-through for a ghost. */
function shaded(object, depth, opacity) {
  const changed = { polygonOffset: true, polygonOffsetFactor: 0.3 * depth, polygonOffsetUnits: 2 * depth };
  if (opacity < 1) Object.assign(changed, { opacity, transparent: true, depthWrite: false });
  return { ...object, materials: object.materials.map(material => ({ ...material, ...changed })) };
}
