// The data that the viewer shows: typed arrays as the server writes them, and a motion with its time axis.

/** The bytes of a text in base64. */
export function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i); // ten times as quick as Uint8Array.from
  return bytes;
}

/** Typed arrays come as {"$array": class, "base64": bytes}; with "below_new" each number is how far it is below the next
 * one that no number before it has reached. */
export function revive(value) {
  if (Array.isArray(value)) return value.map(revive);
  if (value === null || typeof value !== "object") return value;
  if (value.$array) {
    const array = new globalThis[value.$array](bytesOf(value.base64).buffer);
    return value.below_new ? counted(array) : array;
  }
  return Object.fromEntries(Object.entries(value).map(([name, item]) => [name, revive(item)]));
}

function counted(array) {
  let next = 0;
  return array.map(below => (below === 0 ? next++ : next - below));
}

/** Nested lists of numbers as one array; a gap (null) is NaN. */
function flat(numbers) {
  return ArrayBuffer.isView(numbers) ? numbers : Float64Array.from(numbers.flat(Infinity), x => x ?? NaN);
}

export class Motion {
  /** data: {t [s], links, poses: [x, y, z, qx, qy, qz, qw] a link and time, and optionally centre_of_mass, contacts,
   * forces, events, direction}. */
  constructor(data) {
    this.links = data.links;
    this.t = flat(data.t);
    this.poses = flat(data.poses);
    this.centre = data.centre_of_mass ? flat(data.centre_of_mass) : null;
    const arrows = list => (list ?? []).map(({ pair, points, forces }) => ({ pair, points: flat(points), forces: flat(forces) }));
    this.contacts = arrows(data.contacts);
    this.forces = arrows(data.forces);
    this.events = data.events ?? [];
    this.direction = data.direction ?? null;
  }

  get begin() {
    return this.t[0];
  }

  get end() {
    return this.t[this.t.length - 1];
  }

  /** The frame at or before a time, and how far the time is on the way to the next: [i, part]. */
  locate(t) {
    let [low, high] = [0, this.t.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.t[middle] <= t) low = middle;
      else high = middle;
    }
    if (high === low || t <= this.t[low]) return [low, 0];
    return t >= this.t[high] ? [high, 0] : [low, (t - this.t[low]) / (this.t[high] - this.t[low])];
  }

  /** The pose of link k in frame i: seven numbers. */
  pose(i, k) {
    const at = 7 * (i * this.links.length + k);
    return this.poses.subarray(at, at + 7);
  }

  /** Some frames along the motion, the first and the last among them. */
  some(most) {
    const step = Math.max(1, Math.ceil((this.t.length - 1) / (most - 1)));
    const frames = [];
    for (let i = 0; i < this.t.length - 1; i += step) frames.push(i);
    return [...frames, this.t.length - 1];
  }
}

/** The sizes [N] of contact forces, or of other ones, in order; without those that are 0 or not there. */
export function sizes(arrows) {
  const out = arrows.flatMap(({ forces }) =>
    Array.from({ length: forces.length / 3 }, (_, i) => Math.hypot(...forces.subarray(3 * i, 3 * i + 3))),
  );
  return Float64Array.from(out.filter(size => size > 0)).sort();
}
