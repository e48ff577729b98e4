// The tool that sets facts of the scene by clicks: up and the ground from three points, the scale
// from two, lamps and lit windows, and the sun of the photos from a point and the end of its
// shadow. Fetched when it is opened.

import * as backend from "./backend.js";
import { axes, dot, sub } from "./camera.js";
import { $, h, short } from "./dom.js";
import { Store } from "./store.js";

/** Longest way of a hand in a click, px. */
const STEADY = 5;
/** @typedef {"ground" | "scale" | "lamp" | "window" | "sun"} Mode */
/** @type {Record<Mode, number>} */
const POINTS = { ground: 3, scale: 2, lamp: 1, window: 2, sun: 2 };
/** @type {Record<Mode, string>} */
const ASK = {
  ground: "Click three points of the ground, far apart",
  scale: "Click two points whose distance you know",
  lamp: "Click a lamp, or the ground where one shall stand",
  window: "Click two opposite corners of a window",
  sun: "Click the top of something that casts a shadow, then the end of its shadow",
};

export class AlignTool {
  /** @param {HTMLCanvasElement} canvas @param {Store} store */
  constructor(canvas, store) {
    this.canvas = canvas;
    this.store = store;
    /** @type {Mode} */
    this.mode = "ground";
    /** @type {number[][]} */
    this.points = [];
    /** Words of the last change. */
    this.done = "";
    this.isBusy = false;
    this.isOpen = false;
    const mode = (/** @type {Mode} */ name, /** @type {string} */ text) => h("button", { id: `align-${name}`, onclick: () => this.begin(name) }, text);
    this.modes = { ground: mode("ground", "Ground"), scale: mode("scale", "Scale"), lamp: mode("lamp", "Lamp"), window: mode("window", "Window"), sun: mode("sun", "Sun of the photos") };
    this.said = h("p", { id: "align-said", role: "status" });
    this.error = h("p", { id: "align-error", role: "alert", hidden: true });
    this.metres = h("input", { id: "align-metres", className: "number", inputMode: "decimal", ariaLabel: "Metres between the points", oninput: () => this.refresh(), onkeydown: (/** @type {KeyboardEvent} */ event) => event.key === "Enter" && this.setScale() });
    this.set = h("button", { id: "align-set", onclick: () => this.setScale() }, "Set");
    this.length = h("div", { className: "row" }, h("label", { htmlFor: "align-metres", className: "grow" }, "Metres between them"), this.metres, this.set);
    this.facts = h("p", { id: "align-facts", className: "quiet" });
    this.save = h("button", { id: "align-save", className: "main", title: "Write the facts beside the scene", onclick: () => this.change({ action: "save" }) }, "Save");
    this.undo = h("button", { id: "align-undo", title: "Return to the facts of the file", onclick: () => this.change({ action: "undo" }) }, "Undo");
    this.root = h("div", { id: "align", role: "dialog", ariaLabel: "Align" },
      h("div", { className: "row" }, h("h2", {}, "Align"), h("button", { id: "align-close", className: "icon-button", ariaLabel: "Close", title: "Close (Escape)", onclick: () => this.close() }, "×")),
      h("div", { className: "segments", role: "group", ariaLabel: "What to set" }, this.modes.ground, this.modes.scale,
        h("button", { id: "align-flip", title: "Turn the scene upside down", onclick: () => this.change({ action: "flip" }) }, "Flip")),
      h("div", { className: "segments", role: "group", ariaLabel: "What to light by night" }, this.modes.lamp, this.modes.window,
        h("button", { id: "align-dark", title: "Take all lamps and lit windows away", onclick: () => this.change({ action: "dark" }) }, "Dark")),
      h("div", { className: "segments", role: "group", ariaLabel: "Light of the photos" }, this.modes.sun,
        h("button", { id: "align-clouds", title: "No sun cast shadows in the photos", onclick: () => this.change({ action: "clouds" }) }, "No sun")),
      this.said, this.length, this.error, this.facts,
      h("div", { className: "buttons" }, this.save, this.undo));
    /** @type {{x: number, y: number} | null} Where the mouse was pressed. */
    this.pressed = null;
    canvas.addEventListener("pointerdown", (event) => (this.pressed = { x: event.clientX, y: event.clientY }));
    canvas.addEventListener("click", (event) => this.isOpen && this.click(event));
    // Quick clicks are points, not a flight to one.
    canvas.addEventListener("dblclick", (event) => this.isOpen && event.stopImmediatePropagation(), true);
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.isOpen && !$("help").open) this.close();
    });
    store.listen(() => this.isOpen && this.refresh());
  }

  toggle() {
    if (this.isOpen) this.close();
    else this.open();
  }

  open() {
    this.isOpen = true;
    $("stage").append(this.root);
    this.begin("ground");
    const follow = () => {
      if (!this.isOpen) return;
      this.mark();
      requestAnimationFrame(follow);
    };
    follow();
  }

  close() {
    this.isOpen = false;
    this.root.remove();
    this.points = [];
    this.mark();
    document.body.classList.remove("aligning");
    $("align-switch").setAttribute("aria-pressed", "false");
    this.canvas.focus({ preventScroll: true });
  }

  /** Starts with no points. @param {Mode} mode */
  begin(mode) {
    [this.mode, this.points, this.done] = [mode, [], ""];
    document.body.classList.add("aligning");
    $("align-switch").setAttribute("aria-pressed", "true");
    this.complain("");
    this.refresh();
  }

  /** @param {string} text */
  complain(text) {
    this.error.textContent = text;
    this.error.hidden = text === "";
  }

  refresh() {
    const { scene } = this.store.parameters;
    for (const [name, button] of Object.entries(this.modes)) button.setAttribute("aria-pressed", String(name === this.mode));
    const left = POINTS[this.mode] - this.points.length;
    const more = `${left} more point${left === 1 ? "" : "s"}`;
    const ask = ASK[this.mode];
    if (this.isBusy) this.said.textContent = "One moment …";
    else if (this.done && this.points.length === 0) this.said.textContent = this.done;
    else if (left > 0) this.said.textContent = this.points.length === 0 ? `${ask}: ${more}.` : `${more}.`;
    else this.said.textContent = "Type the metres between the two points.";
    this.length.hidden = this.mode !== "scale";
    this.set.disabled = left > 0 || !(Number(this.metres.value.replace(",", ".")) > 0);
    const scale = scene.has_scale ? `1 unit is ${short(scene.metres_per_unit)} m` : "scale unknown";
    this.facts.textContent = `Up ${scene.up.map((v) => short(v, 2)).join(", ")} (${scene.up_confidence}), ${scale}${scene.unsaved ? ", not saved" : ""}`;
    this.save.disabled = this.undo.disabled = !scene.unsaved;
  }

  /** @param {MouseEvent} event */
  async click(event) {
    const moved = this.pressed ? Math.hypot(event.clientX - this.pressed.x, event.clientY - this.pressed.y) : 0;
    if (moved > STEADY || this.isBusy || this.points.length === POINTS[this.mode] || !this.canvas.dataset.camera) return;
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    // The camera of the picture that was clicked on.
    const state = { ...this.store.state, camera: JSON.parse(this.canvas.dataset.camera), follow: "camera" };
    const mode = this.mode;
    await this.work(async () => {
      const { point } = await backend.surface({ state, x, y });
      if (!point) throw new Error("There is no surface at this point, only sky. Click where something is.");
      if (mode === this.mode) this.points.push(point);
    });
    if (this.points.length < POINTS[this.mode]) return;
    if (this.mode === "scale") this.metres.focus();
    else if (this.mode === "lamp") await this.change({ action: "lamp", point: this.points[0] });
    else await this.change({ action: this.mode, points: this.points, ...(this.mode === "window" ? { eye: state.camera.eye } : {}) });
  }

  async setScale() {
    if (this.set.disabled) return;
    const metres = Number(this.metres.value.replace(",", "."));
    await this.change({ action: "scale", points: this.points, metres });
  }

  /** Changes the facts. The points of a change are used up, also where they do not do. @param {any} change */
  async change(change) {
    await this.work(async () => {
      this.points = [];
      this.done = "";
      this.done = (await backend.facts(change)).text;
    });
  }

  /** Does one thing at a time, and says what was wrong. @param {() => Promise<void>} job */
  async work(job) {
    if (this.isBusy) return;
    this.isBusy = true;
    this.complain("");
    this.refresh();
    try {
      await job();
    } catch (error) {
      const text = /** @type {Error} */ (error).message;
      this.complain(text.charAt(0).toUpperCase() + text.slice(1));
    }
    this.isBusy = false;
    this.refresh();
  }

  /** Marks the points in the picture that is shown. */
  mark() {
    const marks = [...document.querySelectorAll(".align-point")];
    while (marks.length > this.points.length) marks.pop()?.remove();
    while (marks.length < this.points.length) {
      const mark = h("i", { className: "align-point" });
      this.root.before(mark);
      marks.push(mark);
    }
    if (marks.length === 0 || !this.canvas.dataset.camera) return;
    const pose = JSON.parse(this.canvas.dataset.camera);
    const { right, down, forward } = axes(pose);
    const focal = 0.5 / Math.tan((pose.fov * Math.PI) / 360);
    const aspect = this.canvas.width / this.canvas.height;
    this.points.forEach((point, index) => {
      const ray = sub(point, pose.eye);
      const depth = dot(ray, forward);
      const mark = /** @type {HTMLElement} */ (marks[index]);
      mark.hidden = depth <= 0;
      mark.style.left = `${100 * (0.5 + (focal * dot(ray, right)) / depth / aspect)}%`;
      mark.style.top = `${100 * (0.5 + (focal * dot(ray, down)) / depth)}%`;
    });
  }
}
