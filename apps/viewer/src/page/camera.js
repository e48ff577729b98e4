// Cameras as vectors: where from, which way, around what.

/** @typedef {import("./store.js").Pose} Pose */

/** @param {number[]} a @param {number[]} b */
export const add = (a, b) => a.map((v, k) => v + b[k]);
/** @param {number[]} a @param {number[]} b */
export const sub = (a, b) => a.map((v, k) => v - b[k]);
/** @param {number[]} a @param {number} s */
export const mul = (a, s) => a.map((v) => v * s);
/** @param {number[]} a @param {number[]} b */
export const dot = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);
/** @param {number[]} a @param {number[]} b */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {number[]} a */
export const length = (a) => Math.hypot(...a);
/** @param {number[]} a */
export const unit = (a) => mul(a, 1 / (length(a) || 1));

/** `v` turned by `angle` about a unit `axis`. @param {number[]} v @param {number[]} axis @param {number} angle */
export function turned(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(mul(v, c), mul(cross(axis, v), s)), mul(axis, dot(axis, v) * (1 - c)));
}

/** Right, down and forward of a pose, world axes. @param {Pose} pose */
export function axes({ rotation }) {
  const [w, x, y, z] = unit(rotation);
  return {
    right: [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    down: [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    forward: [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  };
}

/** The quaternion whose matrix has these rows. @param {number[]} r @param {number[]} d @param {number[]} f */
function quaternion(r, d, f) {
  const trace = r[0] + d[1] + f[2];
  if (trace > 0) {
    const s = 2 * Math.sqrt(trace + 1);
    return [s / 4, (f[1] - d[2]) / s, (r[2] - f[0]) / s, (d[0] - r[1]) / s];
  }
  if (r[0] > d[1] && r[0] > f[2]) {
    const s = 2 * Math.sqrt(1 + r[0] - d[1] - f[2]);
    return [(f[1] - d[2]) / s, s / 4, (r[1] + d[0]) / s, (r[2] + f[0]) / s];
  }
  if (d[1] > f[2]) {
    const s = 2 * Math.sqrt(1 + d[1] - r[0] - f[2]);
    return [(r[2] - f[0]) / s, (r[1] + d[0]) / s, s / 4, (d[2] + f[1]) / s];
  }
  const s = 2 * Math.sqrt(1 + f[2] - r[0] - d[1]);
  return [(d[0] - r[1]) / s, (r[2] + f[0]) / s, (d[2] + f[1]) / s, s / 4];
}

/**
 * A pose at `eye` that looks along `forward` with its horizon level.
 * @param {number[]} eye @param {number[]} forward @param {number[]} up @param {number} fov @returns {Pose}
 */
export function looking(eye, forward, up, fov) {
  const right = unit(cross(forward, up));
  const down = cross(forward, right);
  return { eye, rotation: quaternion(right, down, forward), fov };
}

/** Nearest that a camera looks to straight up or down, as a cosine. */
const STEEPEST = 0.995;

/**
 * `forward` turned by angles about up and across, but not over the top.
 * @param {number[]} forward @param {number[]} up @param {number} yaw @param {number} pitch
 */
export function aimed(forward, up, yaw, pitch) {
  const level = turned(forward, up, yaw);
  const right = unit(cross(level, up));
  const tilted = turned(level, right, pitch);
  return Math.abs(dot(tilted, up)) < STEEPEST ? unit(tilted) : unit(level);
}

/**
 * A pose gone round `pivot` by angles about up and across.
 * @param {Pose} pose @param {number[]} pivot @param {number[]} up @param {number} yaw @param {number} pitch @returns {Pose}
 */
export function orbited(pose, pivot, up, yaw, pitch) {
  const { forward } = axes(pose);
  const from = sub(pose.eye, pivot);
  const right = unit(cross(forward, up));
  const level = turned(from, up, yaw);
  const across = turned(right, up, yaw);
  const turn = turned(forward, up, yaw);
  const tilted = turned(turn, across, pitch);
  if (Math.abs(dot(tilted, up)) >= STEEPEST) return looking(add(pivot, level), unit(turn), up, pose.fov);
  return looking(add(pivot, turned(level, across, pitch)), unit(tilted), up, pose.fov);
}

/** Between two poses. @param {Pose} a @param {Pose} b @param {number} t 0-1 @returns {Pose} */
export function between(a, b, t) {
  const s = t * t * (3 - 2 * t);
  let cosine = dot(a.rotation, b.rotation);
  const near = cosine < 0 ? mul(b.rotation, -1) : b.rotation;
  cosine = Math.min(1, Math.abs(cosine));
  const angle = Math.acos(cosine);
  const [p, q] = angle < 1e-4 ? [1 - s, s] : [Math.sin((1 - s) * angle) / Math.sin(angle), Math.sin(s * angle) / Math.sin(angle)];
  return {
    eye: add(mul(a.eye, 1 - s), mul(b.eye, s)),
    rotation: unit(add(mul(a.rotation, p), mul(near, q))),
    fov: a.fov + (b.fov - a.fov) * s,
  };
}
