// The weather: presets as pictures, and a panel for each effect made from its table.

import * as backend from "./backend.js";
import { SunDial } from "./dial.js";
import { h, roving, short, toast } from "./dom.js";
import { Store } from "./store.js";
import { hasKey, hexOf, keysOf, number, scaleOf, timesOf, valueAt, withKey, withoutKey } from "./tracks.js";

/** @typedef {import("./store.js").Param} Param */
/** @typedef {import("./store.js").Effect} Effect */

/** Parameters that are shown at once; the others are behind "more". */
const FIRST = {
  sky: ["model", "color", "panorama", "heading", "brightness"],
  dust_cover: ["depth", "color"],
  snow_cover: ["depth", "temperature", "hours", "lapse"],
  wetness: ["amount", "puddles", "rained_before", "lapse"],
  wind: ["speed", "direction", "gusts"],
  fog: ["mor", "scale_height", "airlight"],
  haze: ["mor", "scale_height", "airlight"],
  smog: ["mor", "scale_height", "airlight", "tint"],
  rain: ["rate", "exposure", "size"],
  snowfall: ["rate", "exposure", "size"],
  light: ["model", "sun_elevation", "sun_azimuth", "hour", "clouds", "lamps"],
  lightning: ["rate", "distance"],
  look: ["exposure", "contrast", "saturation", "temperature"],
  lens: ["rate", "distance", "aperture", "rained_before", "dirt", "veil"],
};

/** Effects by where in the render they act.  @type {[string, string[]][]} */
const GROUPS = [["Air", ["air"]], ["Falling", ["falls", "wind"]], ["Lying", ["lies"]], ["Water", ["water"]], ["Light", ["sky", "light", "lens"]]];

/** A name as people write it. @param {string} name */
export const titled = (name) => (name === "mor" ? "Visibility (MOR)" : name.charAt(0).toUpperCase() + name.slice(1).replaceAll(/[_-]/g, " "));

export class WeatherPanel {
  /** @param {HTMLElement} root @param {Store} store */
  constructor(root, store) {
    this.store = store;
    /** @type {Map<string, () => void>} */
    this.refreshers = new Map();
    this.name = h("input", { id: "weather-name", value: "", spellcheck: false, maxLength: 60, ariaLabel: "Name of the weather", onchange: () => this.rename() });
    this.presets = h("div", { id: "presets", role: "group", ariaLabel: "Presets" }, ...store.parameters.presets.map((preset) => this.preset(preset)));
    const groups = GROUPS.map(([title, roles]) => /** @type {[string, Effect[]]} */ ([title, store.parameters.effects.filter((effect) => roles.includes(effect.role))]));
    this.effects = h("div", { id: "effects" }, ...groups.flatMap(([title, effects]) => [h("h2", {}, title), ...effects.map((effect) => this.effect(effect))]));
    this.fidelity = this.choice("fidelity", ["physical", "paper"], () => store.state.weather.fidelity ?? "physical", (word) => {
      const { fidelity: _, ...others } = store.state.weather;
      store.setWeather(word === "paper" ? { ...others, fidelity: "paper" } : others);
    });
    roving(this.presets, () => /** @type {HTMLElement[]} */ ([...this.presets.children]));
    root.replaceChildren(
      h("div", { className: "row" }, this.name, h("button", { id: "all-off", title: "Turn all weather off", onclick: () => this.choose("clear") }, "Clear")),
      this.presets,
      this.effects,
      h("details", { className: "more" }, h("summary", {}, "Fidelity"), this.fidelity, h("p", { className: "quiet" }, "physical: units and linear light. paper: the formulas as they were printed.")),
    );
    store.listen((changed) => {
      if (["weather", "time", "all"].some((what) => changed.has(what))) this.refresh();
    });
    this.refresh();
  }

  refresh() {
    const { weather } = this.store.state;
    if (document.activeElement !== this.name) this.name.value = weather.name ?? "";
    for (const card of this.presets.children) card.setAttribute("aria-pressed", String(card.dataset.name === weather.name));
    for (const refresh of this.refreshers.values()) refresh();
  }

  rename() {
    const { weather } = this.store.state;
    this.store.set({ weather: { ...weather, name: this.name.value.trim() || "mine" } });
  }

  /** @param {string} name */
  choose(name) {
    const preset = this.store.parameters.presets.find((preset) => preset.name === name);
    if (!preset) return;
    this.store.set({ weather: preset.weather });
    const end = Math.max(0, ...timesOf(preset.weather));
    if (end > this.store.duration) this.store.setDuration(end);
  }

  /** @param {import("./store.js").Preset} preset */
  preset(preset) {
    const picture = h("span", { className: "thumb" });
    return h("button", { className: "preset", title: preset.about, "data-name": preset.name, onclick: () => this.choose(preset.name) }, picture, h("span", {}, titled(preset.name)));
  }

  /** The picture of a preset is there. @param {string} name */
  thumbnail(name) {
    const card = [...this.presets.children].find((card) => card.dataset.name === name);
    card?.querySelector(".thumb")?.replaceChildren(h("img", { src: backend.thumbnail(name), alt: "" }));
  }

  /** @param {Effect} effect */
  effect(effect) {
    const { store } = this;
    const params = effect.params.filter((param) => !param.name.startsWith("paper_"));
    const paper = effect.params.filter((param) => param.name.startsWith("paper_"));
    const first = /** @type {any} */ (FIRST)[effect.name] ?? params.slice(0, 4).map((param) => param.name);
    const isFirst = (/** @type {Param} */ param) => first.includes(param.name);
    const onOff = h("input", { type: "checkbox", className: "switch", ariaLabel: titled(effect.name), onchange: () => store.turn(effect.name, onOff.checked) });
    const rows = (/** @type {Param[]} */ list) => list.map((param) => this.param(effect, param));
    const rest = params.filter((param) => !isFirst(param));
    const more = rest.length > 0 ? h("details", { className: "more" }, h("summary", { ariaLabel: `${rest.length} more of ${titled(effect.name).toLowerCase()}` }, `${rest.length} more`), ...rows(rest)) : null;
    const papers = paper.length > 0 ? h("details", { className: "more paper" }, h("summary", {}, "Fidelity paper"), ...rows(paper)) : null;
    const summary = h("span", { className: "summary quiet" });
    const dial = effect.name === "light" ? new SunDial(store) : null;
    const body = h("div", { className: "body" }, h("p", { className: "quiet about" }, effect.about), dial?.root ?? null, ...rows(params.filter(isFirst)), more, papers);
    // The switch is beside what opens the effect, not in it: each is a control of its own.
    const box = h("div", { className: "effect", "data-effect": effect.name }, onOff,
      h("details", {}, h("summary", {}, h("span", { className: "name" }, titled(effect.name)), summary), body));
    this.refreshers.set(effect.name, () => {
      const values = store.state.weather[effect.name];
      onOff.checked = values !== undefined;
      dial?.refresh();
      box.classList.toggle("on", values !== undefined);
      if (papers) papers.hidden = store.state.weather.fidelity !== "paper";
      const lead = params.find((param) => first[0] === param.name);
      const value = values && lead ? valueAt(values[lead.name] ?? lead.default, store.state.time) : undefined;
      summary.textContent = value === undefined ? "" : typeof value === "number" || value === "inf" ? `${short(number(value))} ${lead?.unit ?? ""}` : typeof value === "string" ? value : "";
    });
    return box;
  }

  /** Where a parameter's words are chosen. @param {string} label @param {string[]} words @param {() => string} get @param {(word: string) => void} set */
  choice(label, words, get, set) {
    const box = h("select", { ariaLabel: label, onchange: () => set(box.value) }, ...words.map((word) => h("option", { value: word }, word)));
    this.refreshers.set(`choice ${label}`, () => (box.value = get()));
    return box;
  }

  /** @param {Effect} effect @param {Param} param */
  param(effect, param) {
    const { store } = this;
    const id = `${effect.name}.${param.name}`;
    const label = `${titled(param.name)} of ${titled(effect.name).toLowerCase()}`;
    const track = () => store.state.weather[effect.name]?.[param.name];
    const now = () => valueAt(track() ?? param.default, store.state.time);
    const set = (/** @type {any} */ value) => {
      const isKeyed = keysOf(track()).length > 0;
      store.setParam(effect.name, param.name, isKeyed && value !== "auto" ? withKey(track(), store.state.time, value) : value);
    };
    const takesAuto = param.kind.endsWith("-or-auto");
    const auto = takesAuto && param.kind !== "picture-or-auto" ? h("button", { className: "auto", title: "Determine the value automatically", ariaLabel: `auto ${label}`, onclick: () => set(now() === "auto" ? starting(param) : "auto") }, "auto") : null;
    const reset = h("button", { className: "icon-button reset", title: "Reset to the default", ariaLabel: `Reset ${label}`, onclick: () => store.setParam(effect.name, param.name, undefined) }, "↺");
    const key = param.kind === "picture-or-auto" ? null : h("button", { className: "icon-button key", ariaLabel: `Keyframe of ${label}`, onclick: () => this.toggleKey(effect, param) }, "◆");
    const [control, refresh] = this.control(effect, param, now, set);
    const row = h("div", { className: "param", "data-param": id },
      h("label", { title: param.meaning }, titled(param.name)), h("span", { className: "tools" }, auto, key, reset), control);
    this.refreshers.set(id, () => {
      refresh();
      const mine = track();
      row.classList.toggle("changed", mine !== undefined);
      auto?.setAttribute("aria-pressed", String(now() === "auto"));
      if (!key) return;
      const here = hasKey(mine, store.state.time);
      key.classList.toggle("here", here);
      key.classList.toggle("keyed", keysOf(mine).length > 0);
      key.title = here ? "Remove this keyframe" : `Keyframe at ${short(store.state.time)} s`;
    });
    return row;
  }

  /** @param {Effect} effect @param {Param} param */
  toggleKey(effect, param) {
    const { store } = this;
    const track = store.state.weather[effect.name]?.[param.name] ?? param.default;
    const value = valueAt(track, store.state.time);
    if (hasKey(track, store.state.time)) return store.setParam(effect.name, param.name, withoutKey(track, store.state.time));
    if (value === "auto" || number(value) === Infinity) return toast("Keyframes need finite values: set one first");
    store.setParam(effect.name, param.name, withKey(track, store.state.time, value));
  }

  /**
   * What a parameter is changed with, and how it is brought up to date.
   * @param {Effect} effect @param {Param} param @param {() => any} now @param {(value: any) => void} set
   * @returns {[HTMLElement, () => void]}
   */
  control(effect, param, now, set) {
    const label = `${titled(param.name)} of ${titled(effect.name).toLowerCase()}`;
    if (param.kind === "word") {
      const box = h("select", { ariaLabel: label, onchange: () => set(box.value) }, ...param.words.map((word) => h("option", { value: word }, word)));
      return [box, () => (box.value = now())];
    }
    if (param.kind === "picture-or-auto") {
      const names = this.store.parameters.panoramas;
      const box = h("select", { ariaLabel: label, onchange: () => set(box.value) }, h("option", { value: "auto" }, "none"), ...names.map((name) => h("option", { value: name }, name.split(/[/\\]/).pop())));
      return [box, () => (box.value = now())];
    }
    if (param.kind === "color-or-auto") {
      const box = h("input", { type: "color", ariaLabel: label, oninput: () => set(box.value) });
      return [box, () => {
        box.value = hexOf(now());
        box.classList.toggle("dim", now() === "auto");
      }];
    }
    const scale = scaleOf(param);
    const json = (/** @type {number} */ value) => (Number.isFinite(value) ? value : value > 0 ? "inf" : "-inf");
    const slider = h("input", { type: "range", min: "0", max: "1", step: "0.001", ariaLabel: label, oninput: () => set(json(scale.toValue(Number(slider.value)))) });
    const box = h("input", { type: "text", inputMode: "decimal", ariaLabel: `${label} as a number`, className: "number", onchange: () => {
      const text = box.value.trim().replace(",", ".");
      const value = /^(inf|∞)$/i.test(text) ? Infinity : text === "" ? NaN : Number(text);
      const [least, greatest] = [number(param.least), number(param.greatest)];
      if (Number.isNaN(value)) return this.refresh();
      set(json(Math.min(greatest, Math.max(least, value))));
    } });
    const control = h("div", { className: "slide" }, slider, box, h("span", { className: "unit quiet" }, param.unit));
    return [control, () => {
      const value = now();
      const isAuto = value === "auto";
      control.classList.toggle("dim", isAuto);
      if (!isAuto) slider.value = String(scale.toSlider(number(value)));
      if (document.activeElement !== box) box.value = isAuto ? "auto" : short(number(value), 4);
    }];
  }
}

/** A number or colour to begin with where there was `auto`. @param {Param} param */
function starting(param) {
  if (param.kind === "color-or-auto") return "#c8ced4";
  return scaleOf(param).toValue(0.5);
}
