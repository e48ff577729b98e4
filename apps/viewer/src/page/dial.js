// The sun on a dial: the sky from above, north up, the zenith in the middle and the horizon as a
// ring. What is outside of the ring is below the horizon.

import { h, shape } from "./dom.js";
import { Store } from "./store.js";
import { keysOf, number, valueAt, withKey } from "./tracks.js";

/** Radius of the horizon and of the dial, as shares of its half width; the dial ends at 30 degrees below the horizon. */
const HORIZON = 0.72;
const LOWEST = -30;
const SIZE = 132;

/** Place of the sun on the dial, half widths from its middle, north up. @param {number} elevation @param {number} azimuth degrees */
export function placeOf(elevation, azimuth) {
  const radius = elevation >= 0 ? HORIZON * (1 - elevation / 90) : HORIZON + (1 - HORIZON) * Math.min(1, elevation / LOWEST);
  const turn = (azimuth * Math.PI) / 180;
  return [radius * Math.sin(turn), -radius * Math.cos(turn)];
}

/** Elevation and azimuth of a place on the dial, degrees. @param {number} x @param {number} y */
export function sunAt(x, y) {
  const radius = Math.min(1, Math.hypot(x, y));
  const elevation = radius <= HORIZON ? 90 * (1 - radius / HORIZON) : (LOWEST * (radius - HORIZON)) / (1 - HORIZON);
  const azimuth = (Math.atan2(x, -y) * 180) / Math.PI;
  return [Math.round(elevation), Math.round((azimuth + 360) % 360)];
}

export class SunDial {
  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    this.sun = shape("circle", { r: 6, class: "sun" });
    const half = SIZE / 2;
    const marks = [["N", 0], ["E", 90], ["S", 180], ["W", 270]].map(([name, azimuth]) => {
      const turn = (Number(azimuth) * Math.PI) / 180;
      return shape("text", { x: half + 0.88 * half * Math.sin(turn), y: half - 0.88 * half * Math.cos(turn) }, String(name));
    });
    this.face = /** @type {SVGSVGElement} */ (shape("svg", { viewBox: `0 0 ${SIZE} ${SIZE}`, width: SIZE, height: SIZE, tabindex: 0, role: "slider", "aria-label": "Place of the sun", "aria-valuemin": LOWEST, "aria-valuemax": 90 }));
    this.face.append(shape("circle", { cx: half, cy: half, r: half - 1, class: "below" }), shape("circle", { cx: half, cy: half, r: HORIZON * half, class: "above" }), ...marks, this.sun);
    this.text = h("p", { className: "quiet" });
    this.root = h("div", { id: "sun-dial" }, this.face, this.text);
    this.face.addEventListener("pointerdown", (event) => {
      this.face.setPointerCapture(event.pointerId);
      this.drag(event);
    });
    this.face.addEventListener("pointermove", (event) => this.face.hasPointerCapture(event.pointerId) && this.drag(event));
    this.face.addEventListener("keydown", (event) => this.step(event));
  }

  /** A number of the effect at the time that is shown; `otherwise` where it is not set. @param {string} param @param {number} otherwise */
  now(param, otherwise) {
    const value = valueAt(this.store.state.weather.light?.[param] ?? otherwise, this.store.state.time);
    return value === "auto" ? otherwise : number(value);
  }

  refresh() {
    const light = this.store.state.weather.light;
    const isOwn = valueAt(light?.model ?? "auto", this.store.state.time) === "clear";
    const [elevation, azimuth] = [this.now("sun_elevation", 45), this.now("sun_azimuth", 180)];
    const [x, y] = placeOf(elevation, azimuth);
    this.sun.setAttribute("cx", String((SIZE / 2) * (1 + x)));
    this.sun.setAttribute("cy", String((SIZE / 2) * (1 + y)));
    this.root.classList.toggle("off", !isOwn);
    const words = `${Math.round(elevation)}° high, azimuth ${Math.round(azimuth)}°`;
    this.face.setAttribute("aria-valuenow", String(elevation));
    this.face.setAttribute("aria-valuetext", words);
    this.text.textContent = isOwn ? words : "Drag the sun to light the place with it";
  }

  /** @param {PointerEvent} event */
  drag(event) {
    const box = this.face.getBoundingClientRect();
    this.place(.../** @type {[number, number]} */ (sunAt((2 * (event.clientX - box.left)) / box.width - 1, (2 * (event.clientY - box.top)) / box.height - 1)));
  }

  /** @param {KeyboardEvent} event */
  step(event) {
    const ways = /** @type {Record<string, [number, number]>} */ ({ ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowRight: [0, 2], ArrowLeft: [0, -2] });
    const way = ways[event.key];
    if (!way) return;
    event.preventDefault();
    const elevation = Math.max(LOWEST, Math.min(90, this.now("sun_elevation", 45) + way[0]));
    this.place(elevation, (this.now("sun_azimuth", 180) + way[1] + 360) % 360);
  }

  /** Puts the sun somewhere. @param {number} elevation @param {number} azimuth degrees */
  place(elevation, azimuth) {
    const { store } = this;
    const { light = {}, ...others } = store.state.weather;
    const put = (/** @type {string} */ param, /** @type {any} */ value) =>
      keysOf(light[param]).length > 0 ? withKey(light[param], store.state.time, value) : value;
    const sun = { model: put("model", "clear"), sun_elevation: put("sun_elevation", elevation), sun_azimuth: put("sun_azimuth", azimuth) };
    store.setWeather({ ...others, light: { ...light, ...sun } });
  }
}
