// What hands do with the picture: mouse, fingers and keys move the camera.

import { add, aimed, axes, between, dot, length, looking, mul, orbited, sub } from "./camera.js";
import { Store } from "./store.js";
import { $ } from "./dom.js";

/** @typedef {import("./store.js").Pose} Pose */

/** Turn of a drag across the whole height of the picture, radians. */
const TURN = 2.4;
/** Time of a flight to another place, ms. */
const FLIGHT = 700;

export class Controls {
  /** @param {HTMLElement} surface @param {Store} store @param {(x: number, y: number) => void} pick */
  constructor(surface, store, pick) {
    this.surface = surface;
    this.store = store;
    this.pick = pick;
    /** @type {"orbit" | "fly"} */
    this.mode = "orbit";
    /** @type {number[] | null} What an orbit goes round. */
    this.pivot = null;
    /** Factor on the speed of walking. */
    this.speed = 1;
    /** @type {Map<number, {x: number, y: number}>} */
    this.pointers = new Map();
    /** @type {Set<string>} */
    this.keys = new Set();
    /** @type {{from: Pose, to: Pose, start: number} | null} */
    this.flight = null;
    this.last = performance.now();
    this.pinch = 0;
    surface.addEventListener("pointerdown", (event) => this.down(event));
    surface.addEventListener("pointermove", (event) => this.move(event));
    for (const kind of ["pointerup", "pointercancel"]) {
      surface.addEventListener(kind, (event) => this.pointers.delete(/** @type {PointerEvent} */ (event).pointerId));
    }
    surface.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    surface.addEventListener("dblclick", (event) => {
      const box = surface.getBoundingClientRect();
      pick((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    });
    surface.addEventListener("contextmenu", (event) => event.preventDefault());
    addEventListener("blur", () => this.keys.clear());
    this.joystick();
    const tick = (/** @type {number} */ now) => {
      this.tick(now);
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  get up() {
    return this.store.parameters.scene.up;
  }

  /** @returns {Pose} */
  get pose() {
    return this.store.state.camera;
  }

  /** Sets the camera, and looks through it. @param {Pose} pose */
  set(pose) {
    this.store.set({ camera: pose, follow: "camera" });
  }

  /** Scene units that a hand's width of walking is. */
  get reach() {
    return 0.12 * this.store.parameters.scene.radius * this.speed;
  }

  /** The point that an orbit goes round: the middle of the place, as far as it is ahead. */
  center() {
    if (this.pivot) return this.pivot;
    const { scene } = this.store.parameters;
    const { forward } = axes(this.pose);
    const ahead = dot(sub(scene.center, this.pose.eye), forward);
    const far = Math.min(Math.max(ahead, 0.15 * scene.radius), scene.radius);
    return add(this.pose.eye, mul(forward, far));
  }

  /** @param {"orbit" | "fly"} mode */
  setMode(mode) {
    this.mode = mode;
    this.pivot = null;
    for (const name of ["orbit", "fly"]) $(`mode-${name}`).setAttribute("aria-pressed", String(name === mode));
  }

  /** Flies to a pose. @param {Pose} to */
  flyTo(to) {
    this.pivot = null;
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return this.set(to);
    this.flight = { from: this.pose, to, start: performance.now() };
  }

  /** Turns the picture until its horizon is level. */
  level() {
    const { eye, fov } = this.pose;
    this.flyTo(looking(eye, aimed(axes(this.pose).forward, this.up, 0, 0), this.up, fov));
  }

  /** Goes round a point from now on, with it in the middle. @param {number[]} point */
  focus(point) {
    const { scene } = this.store.parameters;
    const from = sub(point, this.pose.eye);
    const far = Math.max(length(from), 1e-6);
    // Not nearer than half way, nor than a step.
    const eye = add(this.pose.eye, mul(from, Math.min(0.35, Math.max(0, 1 - (0.05 * scene.radius) / far))));
    const forward = mul(sub(point, eye), 1 / length(sub(point, eye)));
    this.setMode("orbit");
    this.flyTo(looking(eye, aimed(forward, this.up, 0, 0), this.up, this.pose.fov));
    this.pivot = point;
  }

  /** @param {PointerEvent} event */
  down(event) {
    this.surface.setPointerCapture(event.pointerId);
    this.surface.focus({ preventScroll: true });
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.flight = null;
    this.pinch = 0;
  }

  /** @param {PointerEvent} event */
  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before || !this.store.state) return;
    const after = { x: event.clientX, y: event.clientY };
    this.pointers.set(event.pointerId, after);
    const scale = TURN / this.surface.clientHeight;
    let [dx, dy] = [(after.x - before.x) * scale, (after.y - before.y) * scale];
    if (this.pointers.size >= 2) {
      // Two fingers: together they shift, apart they go nearer. Each brings its half.
      const [a, b] = [...this.pointers.values()];
      const apart = Math.hypot(a.x - b.x, a.y - b.y);
      if (this.pinch > 0) this.dolly((apart - this.pinch) * scale * 1.2);
      this.pinch = apart;
      this.shift(dx / 2, dy / 2);
    } else if (event.buttons & 2 || event.shiftKey) {
      this.shift(dx, dy);
    } else {
      this.turn(dx, dy);
    }
  }

  /** @param {number} dx @param {number} dy */
  turn(dx, dy) {
    if (this.mode === "orbit") {
      const pivot = (this.pivot = this.center());
      this.set(orbited(this.pose, pivot, this.up, -dx, -dy));
    } else {
      const forward = aimed(axes(this.pose).forward, this.up, dx * 0.6, dy * 0.6);
      this.set(looking(this.pose.eye, forward, this.up, this.pose.fov));
    }
  }

  /** @param {number} dx @param {number} dy */
  shift(dx, dy) {
    const { right, down } = axes(this.pose);
    const far = this.mode === "orbit" ? length(sub(this.center(), this.pose.eye)) : 4 * this.reach;
    const step = add(mul(right, -dx * far * 0.4), mul(down, -dy * far * 0.4));
    this.step(step);
  }

  /** @param {number[]} step */
  step(step) {
    if (this.pivot) this.pivot = add(this.pivot, step);
    this.set({ ...this.pose, eye: add(this.pose.eye, step) });
  }

  /** Nearer by a share of the way, or ahead. @param {number} by */
  dolly(by) {
    const { forward } = axes(this.pose);
    if (this.mode === "orbit") {
      const pivot = (this.pivot = this.center());
      const from = sub(this.pose.eye, pivot);
      const least = (0.004 * this.store.parameters.scene.radius) / Math.max(length(from), 1e-9);
      this.set({ ...this.pose, eye: add(pivot, mul(from, Math.max(Math.exp(-by), least))) });
    } else {
      this.step(mul(forward, by * 3 * this.reach));
    }
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    event.preventDefault();
    if (!this.store.state) return;
    this.flight = null;
    const lines = event.deltaMode === 1 ? 30 : 1;
    this.dolly(-event.deltaY * lines * 0.0012);
  }

  /** A pad for the thumb, where there is no keyboard. */
  joystick() {
    const pad = $("pad");
    const knob = pad.firstElementChild;
    this.stick = [0, 0];
    const put = (/** @type {PointerEvent} */ event) => {
      const box = pad.getBoundingClientRect();
      const half = box.width / 2;
      const v = [(event.clientX - box.left - half) / half, (event.clientY - box.top - half) / half];
      const far = Math.max(1, Math.hypot(...v));
      this.stick = v.map((x) => x / far);
      knob.style.transform = `translate(${this.stick[0] * half * 0.6}px, ${this.stick[1] * half * 0.6}px)`;
    };
    pad.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
      pad.setPointerCapture(event.pointerId);
      put(event);
    });
    pad.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => event.buttons && put(event));
    for (const kind of ["pointerup", "pointercancel"]) {
      pad.addEventListener(kind, () => {
        this.stick = [0, 0];
        knob.style.transform = "";
      });
    }
  }

  /** Does what keys and flights do since the last picture of the screen. @param {number} now */
  tick(now) {
    const seconds = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    if (!this.store.state) return;
    if (this.flight) {
      const t = Math.min(1, (now - this.flight.start) / FLIGHT);
      const pivot = this.pivot;
      this.set(t === 1 ? this.flight.to : between(this.flight.from, this.flight.to, t));
      this.pivot = pivot;
      if (t === 1) this.flight = null;
      return;
    }
    const on = (/** @type {string} */ key) => (this.keys.has(key) ? 1 : 0);
    const [sx, sy] = this.stick ?? [0, 0];
    const ahead = on("KeyW") - on("KeyS") - sy;
    const aside = on("KeyD") - on("KeyA") + sx;
    const above = on("KeyE") - on("KeyQ");
    const [yaw, pitch] = [on("ArrowLeft") - on("ArrowRight"), on("ArrowUp") - on("ArrowDown")];
    if (!ahead && !aside && !above && !yaw && !pitch) return;
    const fast = this.keys.has("ShiftLeft") || this.keys.has("ShiftRight") ? 4 : 1;
    const way = this.reach * 2 * seconds * fast;
    const { right, forward } = axes(this.pose);
    const step = add(add(mul(forward, ahead * way), mul(right, aside * way)), mul(this.up, above * way));
    if (length(step) > 0) this.step(step);
    if (yaw || pitch) {
      const aim = aimed(axes(this.pose).forward, this.up, yaw * seconds, pitch * seconds);
      this.pivot = null;
      this.set(looking(this.pose.eye, aim, this.up, this.pose.fov));
    }
  }

  /** True for a key that moves. @param {string} code */
  static moves(code) {
    return /^(Key[WASDQE]|Arrow(Left|Right|Up|Down))$/.test(code);
  }
}

