// The lidar: which one, where it stands, and how its points are coloured; and saving them.

import { add, axes, looking, mul, sub, unit } from "./camera.js";
import { count, h, short } from "./dom.js";
import { commandOf, saveFiles } from "./files.js";
import { Store } from "./store.js";

/** @typedef {import("./store.js").LidarState} LidarState */

/** Colours of classes, as the program draws them; surfaces are coloured by height. */
const CLASSES = { surface: "linear-gradient(90deg, #3e4dc0, #1ccfd0, #a3fd3c, #fb8022, #a31101)", drop: "#82e6ff", flake: "#fff", air: "#be96ff", ghost: "#ff3cc8" };
/** The meaning of the colours. @type {Object<string, string>} */
const SAID = {
  class: "Surfaces by height, red is 10 m above the lowest; weather in its own colours.",
  range: "Red is near, blue is 100 m away.",
  intensity: "Black is no echo, white the strongest.",
};

export class LidarPanel {
  /** @param {HTMLElement} root @param {Store} store @param {(pose: import("./store.js").Pose) => void} flyTo */
  constructor(root, store, flyTo) {
    this.store = store;
    const { lidars, returns } = store.parameters;
    this.model = h("select", { id: "lidar-model", ariaLabel: "Lidar", onchange: () => this.choose(this.model.value) }, h("option", { value: "" }, "off"), ...lidars.map((lidar) => h("option", { value: lidar.name }, lidar.name)));
    this.about = h("p", { id: "lidar-about", className: "quiet" });
    const place = (/** @type {string} */ id, /** @type {string} */ text, /** @type {string} */ title, /** @type {() => void} */ act) => h("button", { id, title, onclick: act }, text);
    this.stays = place("lidar-here", "Place here", "Put the sensor where the camera is now: it stays there, upright, and looks ahead as the camera does", () => this.set({ at: this.here() }));
    this.rides = place("lidar-ride", "At the camera", "Move the sensor with the camera, also along the path", () => this.set({ at: null }));
    this.goes = place("lidar-go", "Go to it", "Fly to the sensor", () => this.go(flyTo));
    this.where = h("p", { id: "lidar-where", className: "quiet" });
    this.rays = this.choice("lidar-rays", [["1", "1"], ["7", "7"]], (rays) => this.set({ sub_rays: Number(rays) }));
    this.returns = h("select", { id: "lidar-returns", ariaLabel: "Returns", onchange: () => this.set({ returns: this.returns.value }) }, ...returns.map((name) => h("option", { value: name }, name)));
    this.colors = this.choice("lidar-colors", [["class", "Class"], ["range", "Range"], ["intensity", "Intensity"]], (colors) => this.set({ colors }));
    this.legend = h("p", { id: "lidar-legend", className: "quiet" });
    this.counts = h("div", { id: "lidar-counts", role: "status" });
    this.command = h("pre", { id: "lidar-command", tabIndex: 0, ariaLabel: "Command that makes the same points" });
    this.rest = h("div", {},
      h("h2", {}, "Place"),
      h("div", { className: "buttons" }, this.stays, this.rides, this.goes), this.where,
      h("h2", {}, "Pulses"),
      h("div", { className: "param" }, h("label", {}, "Rays of a pulse"), this.rays.box),
      h("div", { className: "param" }, h("label", {}, "Returns"), this.returns),
      h("h2", {}, "Points"),
      this.colors.box, this.legend, this.counts,
      h("div", { className: "buttons" },
        h("button", { id: "lidar-save", className: "main", title: "Save the points, and the weather and camera files that the command below needs", onclick: () => this.save() }, "Save points")),
      h("p", { className: "quiet" }, "The command makes the same points from the saved files. Pictures and videos are saved without points."),
      this.command);
    root.replaceChildren(h("div", { className: "param" }, h("label", {}, "Lidar"), this.model), this.about, this.rest);
    this.timer = 0;
    store.listen((changed) => {
      if (["lidar", "camera", "follow"].some((what) => changed.has(what))) this.refresh();
      if ([...changed].some((what) => !["playing", "divider", "duration", "size"].includes(what))) this.soon();
    });
    this.refresh();
    this.soon();
  }

  /** Buttons of which one is chosen. @param {string} id @param {[string, string][]} choices @param {(value: string) => void} set */
  choice(id, choices, set) {
    const buttons = choices.map(([value, text]) => h("button", { "data-value": value, onclick: () => set(value) }, text));
    const box = h("div", { id, className: "segments", role: "group" }, ...buttons);
    const show = (/** @type {string} */ value) => buttons.forEach((button) => button.setAttribute("aria-pressed", String(button.dataset.value === value)));
    return { box, show };
  }

  /** The camera's place as that of a sensor. @returns {LidarState["at"]} */
  here() {
    const { camera } = this.store.state;
    const round = (/** @type {number[]} */ point) => point.map((v) => Math.round(v * 1e4) / 1e4);
    return { eye: round(camera.eye), target: round(add(camera.eye, mul(axes(camera).forward, 10))) };
  }

  /** Flies to the sensor. @param {(pose: import("./store.js").Pose) => void} flyTo */
  go(flyTo) {
    const { camera, lidar } = this.store.state;
    if (!lidar?.at) return;
    const { eye, target } = lidar.at;
    flyTo(looking(eye, unit(sub(target, eye)), this.store.parameters.scene.up, camera.fov));
  }

  /** @param {string} model */
  choose(model) {
    const { lidar } = this.store.state;
    if (!model) return this.store.set({ lidar: null });
    this.store.set({ lidar: lidar ? { ...lidar, model } : { model, at: this.here(), sub_rays: 1, returns: "strongest", colors: "class" } });
  }

  /** @param {Partial<LidarState>} patch */
  set(patch) {
    const { lidar } = this.store.state;
    if (lidar) this.store.set({ lidar: { ...lidar, ...patch } });
  }

  refresh() {
    const { lidar } = this.store.state;
    this.model.value = lidar?.model ?? "";
    this.rest.hidden = !lidar;
    this.about.textContent = lidar ? this.store.parameters.lidars.find((known) => known.name === lidar.model)?.about ?? "" : "Points of a lidar in this weather, over the picture.";
    if (!lidar) return;
    const at = lidar.at?.eye.map((v) => short(v)).join(", ");
    this.where.textContent = at ? `Stands at ${at}` : "Moves with the camera: points come when it stops";
    this.rides.setAttribute("aria-pressed", String(!lidar.at));
    this.goes.disabled = !lidar.at;
    this.rays.show(String(lidar.sub_rays));
    this.returns.value = lidar.returns;
    this.colors.show(lidar.colors);
    this.legend.textContent = SAID[lidar.colors] ?? "";
  }

  /** The points of the picture that is shown. @param {import("./connection.js").Head} head */
  report({ lidar }) {
    const state = this.store.state.lidar;
    if (!state) return;
    this.counts.classList.toggle("bad", Boolean(lidar?.error));
    if (!lidar) return this.counts.replaceChildren(h("span", { className: "quiet" }, "Grey points are those of the last sweep"));
    if (lidar.error) return this.counts.replaceChildren(lidar.error);
    const classes = Object.entries(CLASSES).filter(([name]) => lidar.classes[name] > 0);
    this.counts.replaceChildren(
      h("span", { title: `${lidar.pulses} pulses, made in ${Math.round(lidar.ms)} ms` }, h("b", {}, count(lidar.points)), ` points of ${count(lidar.pulses)} pulses`),
      ...classes.map(([name, color]) => h("span", {}, state.colors === "class" ? h("i", { style: `background: ${color}` }) : null, h("b", {}, count(lidar.classes[name])), ` ${name}`)));
  }

  /** Asks for the command a little later: not for every step of a slider. */
  soon() {
    clearTimeout(this.timer);
    if (this.store.isPlaying || !this.store.state.lidar) return;
    this.timer = window.setTimeout(async () => {
      const command = await commandOf("scan", this.store.state);
      if (command) this.command.textContent = command;
    }, 400);
  }

  save() {
    const { state } = this.store;
    return saveFiles(["points", "weather", ...(state.lidar?.at ? [] : ["camera"])], state);
  }
}
