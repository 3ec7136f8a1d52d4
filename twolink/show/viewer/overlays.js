// What is drawn over a robot: trails, axes of frames, the centre of mass, points and forces that act there.

import { sizes } from "./motion.js";

const TRAIL_COLOURS = [0xd1495b, 0x00798c, 0xedae49, 0x5b3f8c, 0x3a7d44, 0x8d5524];
export const CONTACT_COLOUR = 0xc2255c,
  FORCE_COLOUR = 0x1c7ed6;
const CENTRE_COLOUR = 0x111111;
const SIDES = 6; // of a trail's tube
const FEW = 1500; // frames, between which a trail is rounded
const KEPT = 4; // seconds of playing that a trail goes back
const TYPICAL = 2; // times the force that nine of ten stay below has the longest arrow

export class Overlays {
  constructor(stage) {
    this.stage = stage;
    this.group = new stage.THREE.Group();
    stage.viewer.scene.add(this.group);
    this.parts = new Map(); // name -> {object, at(t, i, share)}: share of the way from frame i to the next
  }

  /** Remove a part, or all. */
  clear(name = null) {
    for (const [key, { object }] of this.parts) {
      if (name !== null && key !== name) continue;
      this.group.remove(object);
      object.traverse(child => child.geometry?.dispose());
      this.parts.delete(key);
    }
    this.stage.viewer.set_dirty();
  }

  /** Bring all parts to a time. */
  at(motion, t) {
    const [i, share] = motion.locate(t);
    for (const part of this.parts.values()) part.at(t, i, share);
  }

  #put(name, object, at) {
    this.clear(name);
    this.parts.set(name, { object, at });
    this.group.add(object);
  }

  /** The way of a frame's origin during the last seconds: a tube. speed: simulated seconds a second of playing. */
  trail(name, robot, motion, frame, speed) {
    const { THREE, size } = this.stage;
    if (motion.t.length < 2 || !robot.frameAt(motion, frame, 0)) return;
    const points = Array.from(motion.t, (_, i) => robot.frameAt(motion, frame, i).position);
    const path = new THREE.CatmullRomCurve3(points);
    path.getPointAt = u => path.getPoint(u); // by time, not by length
    path.getTangentAt = u => path.getTangent(u);
    const fine = points.length < FEW ? 3 : 1;
    const colour = TRAIL_COLOURS[[...this.parts.keys()].filter(key => key.startsWith("trail")).length % 6];
    const tube = new THREE.Mesh(
      new THREE.TubeGeometry(path, fine * (points.length - 1), size / 800, SIDES),
      new THREE.MeshBasicMaterial({ color: colour, side: THREE.DoubleSide }),
    );
    tube.frustumCulled = false;
    const each = fine * SIDES * 6; // indices from frame to frame
    this.#put(name, tube, (t, i) => {
      const [first] = motion.locate(t - KEPT * speed());
      tube.geometry.setDrawRange(first * each, (i - first) * each);
    });
  }

  /** Axes x, y, z (red, green, blue) of frames by name. */
  frames(name, robot, motion, frames, length) {
    const { THREE } = this.stage;
    const group = new THREE.Group();
    const axes = frames
      .filter(frame => robot.frameAt(motion, frame, 0))
      .map(frame => {
        const object = new THREE.AxesHelper(length);
        object.material.depthTest = false;
        object.renderOrder = 2;
        group.add(object);
        return { frame, object };
      });
    this.#put(name, group, (_, i) => {
      for (const { frame, object } of axes) {
        const { position, quaternion } = robot.frameAt(motion, frame, i);
        object.position.copy(position);
        object.quaternion.copy(quaternion);
      }
    });
  }

  /** The centre of mass: a dark ball that bodies do not hide, and its plumb line to the floor. */
  centre(name, motion, floor) {
    const { THREE, size } = this.stage;
    const material = new THREE.MeshBasicMaterial({ color: CENTRE_COLOUR, depthTest: false, transparent: true, opacity: 0.8 });
    const ball = new THREE.Mesh(new THREE.SphereGeometry(size / 70, 24, 16), material);
    const line = new THREE.Mesh(new THREE.CylinderGeometry(size / 900, size / 900, 1, 6), material);
    line.rotation.x = Math.PI / 2;
    ball.renderOrder = line.renderOrder = 3;
    const group = new THREE.Group();
    group.add(ball, line);
    this.#put(name, group, (_, i) => {
      const [x, y, z] = motion.centre.subarray(3 * i, 3 * i + 3);
      ball.position.set(x, y, z);
      line.position.set(x, y, (z + floor) / 2);
      line.scale.y = Math.max(Math.abs(z - floor), 1e-9);
    });
  }

  /** A dot at each point where a force acts, and an arrow for the force, at most a fifth of the picture. */
  arrows(name, acting, colour) {
    const { THREE, size } = this.stage;
    const [newtons, longest] = [sizes(acting), 0.22 * size];
    const typical = newtons[Math.floor(0.9 * (newtons.length - 1))] ?? 1; // blows last one frame
    const scale = longest / Math.min(TYPICAL * typical, newtons.at(-1) ?? 1);
    const material = new THREE.MeshBasicMaterial({ color: colour, depthTest: false, transparent: true, opacity: 0.85 });
    const [dot, shaft, head] = [
      new THREE.SphereGeometry(size / 120, 16, 12),
      new THREE.CylinderGeometry(size / 400, size / 400, 1, 10).translate(0, 0.5, 0),
      new THREE.ConeGeometry(size / 120, size / 40, 14).translate(0, -size / 80, 0),
    ];
    const group = new THREE.Group();
    const arrows = acting.map(contact => {
      const parts = [dot, shaft, head].map(geometry => new THREE.Mesh(geometry, material));
      for (const part of parts) part.renderOrder = 4;
      const arrow = new THREE.Group();
      arrow.add(...parts);
      group.add(arrow);
      return { contact, arrow, parts };
    });
    const force = new THREE.Vector3(),
      next = new THREE.Vector3(),
      upward = new THREE.Vector3(0, 1, 0);
    this.#put(name, group, (_, i, share) => {
      for (const { contact, arrow, parts } of arrows) {
        arrow.visible = Number.isFinite(contact.points[3 * i]);
        if (!arrow.visible) continue;
        arrow.position.fromArray(contact.points, 3 * i);
        next.fromArray(contact.points, 3 * i + 3);
        if (Number.isFinite(next.x)) arrow.position.lerp(next, share); // with the body, whose pose is between frames too
        force.fromArray(contact.forces, 3 * i);
        const length = Math.min(scale * force.length(), longest);
        parts[1].visible = parts[2].visible = length > size / 200;
        if (!parts[1].visible) continue;
        arrow.quaternion.setFromUnitVectors(upward, force.normalize());
        parts[1].scale.y = Math.max(length - size / 40, 1e-9);
        parts[2].position.y = Math.max(length, size / 40);
      }
    });
  }
}
