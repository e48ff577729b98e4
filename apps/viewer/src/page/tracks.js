// Parameters over time, and sliders for numbers of very different size.

/** @typedef {import("./store.js").Param} Param */
/** @typedef {import("./store.js").Track} Track */

/** A number of JSON, where infinity is a text. @param {any} value */
export function number(value) {
  if (value === "inf") return Infinity;
  if (value === "-inf") return -Infinity;
  return typeof value === "number" ? value : NaN;
}

/** The keys of a track; none if it is the same at all times. @param {any} track @returns {any[][]} */
export function keysOf(track) {
  return track !== null && typeof track === "object" && !Array.isArray(track) ? track.keys : [];
}

/** Times of the keyframes of a weather. @param {Object<string, any>} weather @returns {number[]} */
export function timesOf(weather) {
  const tracks = Object.values(weather).flatMap((effect) => (effect && typeof effect === "object" ? Object.values(effect) : []));
  return tracks.flatMap((track) => keysOf(track).map((key) => key[0]));
}

/** @type {Object<string, (s: number) => number>} */
const EASINGS = {
  linear: (s) => s,
  hold: () => 0,
  smooth: (s) => s * s * (3 - 2 * s),
  "ease-in": (s) => s * s,
  "ease-out": (s) => s * (2 - s),
};

/** The value of a track at a time, as far as it is to be shown. @param {any} track @param {number} time */
export function valueAt(track, time) {
  const keys = keysOf(track);
  if (keys.length === 0) return track;
  const next = keys.findIndex((key) => key[0] > time);
  if (next === 0) return keys[0][1];
  if (next < 0) return keys[keys.length - 1][1];
  const [a, b] = [keys[next - 1], keys[next]];
  if (typeof a[1] !== "number" || typeof b[1] !== "number") return a[1];
  const share = EASINGS[a[2] ?? "linear"]((time - a[0]) / (b[0] - a[0]));
  return a[1] + (b[1] - a[1]) * share;
}

/** How near two times are the same key, s. */
export const SAME = 0.02;

/** A track with a key at a time. @param {any} track @param {number} time @param {any} value @returns {Track} */
export function withKey(track, time, value) {
  const at = Math.round(time * 1000) / 1000;
  const old = keysOf(track);
  const here = old.find((key) => Math.abs(key[0] - at) < SAME);
  const keys = old.filter((key) => key !== here);
  const key = here?.[2] ? [here[0], value, here[2]] : [here ? here[0] : at, value];
  return { keys: /** @type {any} */ ([...keys, key].sort((a, b) => a[0] - b[0])) };
}

/** A track without its key at a time; the last one leaves its value. @param {any} track @param {number} time @returns {Track} */
export function withoutKey(track, time) {
  const keys = keysOf(track).filter((key) => Math.abs(key[0] - time) >= SAME);
  return keys.length > 0 ? { keys: /** @type {any} */ (keys) } : valueAt(track, time);
}

/** True if there is a key at a time. @param {any} track @param {number} time */
export function hasKey(track, time) {
  return keysOf(track).some((key) => Math.abs(key[0] - time) < SAME);
}

/**
 * How a slider from 0 to 1 stands for a parameter: evenly, by its logarithm, or finer near zero.
 * @param {Param} param @returns {{toValue: (s: number) => number, toSlider: (v: number) => number}}
 */
export function scaleOf(param) {
  let [least, greatest] = [number(param.least), number(param.greatest)];
  const usual = number(param.default);
  const clamp = (/** @type {number} */ s) => Math.min(1, Math.max(0, Number.isFinite(s) ? s : 1));
  if (param.unit === "deg" && greatest - least > 720) [least, greatest] = [-180, 180];
  if (least < 0 && greatest > 100 && least === -greatest) [least, greatest] = [-50, 50];
  if (least > 0 && greatest / least > 500) {
    const open = greatest === Infinity;
    const low = Math.max(least, param.unit === "m" && least >= 1 ? 10 : least);
    const high = open ? Math.max(20000, Number.isFinite(usual) ? usual * 4 : 0) : greatest;
    // The last hundredth of an open range is infinity.
    const span = Math.log(high / low);
    return {
      toValue: (s) => (open && s > 0.985 ? Infinity : tidy(low * Math.exp(span * Math.min(1, open ? s / 0.985 : s)))),
      toSlider: (v) => (v === Infinity ? 1 : clamp((Math.log(v / low) / span) * (open ? 0.985 : 1))),
    };
  }
  if (least === 0 && greatest >= 10) {
    const power = greatest > 5000 ? 6 : 3;
    return {
      toValue: (s) => tidy(greatest * s ** power),
      toSlider: (v) => clamp((v / greatest) ** (1 / power)),
    };
  }
  return { toValue: (s) => tidy(least + (greatest - least) * s), toSlider: (v) => clamp((v - least) / (greatest - least)) };
}

/** Three digits are enough for a slider. @param {number} value */
function tidy(value) {
  return Math.abs(value) < 1e-9 ? 0 : Number(value.toPrecision(3));
}

/** A colour of JSON as `#rrggbb`. @param {any} color */
export function hexOf(color) {
  if (typeof color === "string" && /^#[0-9a-f]{6}$/i.test(color)) return color.toLowerCase();
  if (!Array.isArray(color)) return "#808080";
  return "#" + color.map((v) => Math.round(255 * Math.min(1, Math.max(0, v))).toString(16).padStart(2, "0")).join("");
}
