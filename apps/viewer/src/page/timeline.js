// Time: a scrubber with play, and the keyframes of weather and camera on it.

import { h, short } from "./dom.js";
import { Store } from "./store.js";
import { SAME, timesOf } from "./tracks.js";

export class Timeline {
  /** @param {HTMLElement} root @param {Store} store */
  constructor(root, store) {
    this.store = store;
    this.button = h("button", { id: "play", className: "icon-button", title: "Play (space)", ariaLabel: "Play", onclick: () => this.toggle() }, "▶");
    this.scrub = h("input", { id: "time", type: "range", min: "0", step: "0.001", ariaLabel: "Time, seconds", oninput: () => this.goTo(Number(this.scrub.value)) });
    this.box = h("input", { id: "time-box", type: "text", inputMode: "decimal", className: "number", ariaLabel: "Time in seconds", onchange: () => this.goTo(Number(this.box.value.replace(",", ".")) || 0) });
    this.end = h("input", { id: "duration", type: "text", inputMode: "decimal", className: "number", ariaLabel: "Length in seconds", title: "Length, seconds", onchange: () => store.setDuration(Number(this.end.value.replace(",", ".")) || 5) });
    this.marks = h("div", { id: "marks" });
    this.key = h("button", { id: "add-key", title: "Add a camera keyframe at this time (K)", onclick: () => this.keyCamera() }, "◆ Camera");
    root.replaceChildren(
      this.button,
      h("div", { className: "rail" }, this.marks, this.scrub),
      h("span", { className: "times" }, this.box, h("span", { className: "quiet" }, "/"), this.end, h("span", { className: "quiet" }, "s")),
      this.key,
    );
    /** The keyframes that the marks stand for, as text. */
    this.shown = "";
    this.last = performance.now();
    store.listen((changed) => {
      if (["time", "duration", "weather", "path", "follow", "playing", "all"].some((what) => changed.has(what))) this.refresh();
    });
    const tick = (/** @type {number} */ now) => {
      const seconds = Math.min(0.25, (now - this.last) / 1000);
      this.last = now;
      if (store.isPlaying) {
        const time = store.state.time + seconds;
        store.set({ time: time > store.duration ? 0 : Math.round(time * 1e4) / 1e4 });
      }
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
    this.refresh();
  }

  toggle() {
    this.store.play(!this.store.isPlaying);
  }

  /** @param {number} time */
  goTo(time) {
    const near = this.times().find((key) => Math.abs(key - time) < 0.004 * this.store.duration);
    if (time > this.store.duration) this.store.setDuration(time);
    this.store.set({ time: near ?? Math.max(0, time) });
  }

  /** Times of keyframes of the weather. */
  times() {
    return [...new Set(timesOf(this.store.state.weather))];
  }

  /** Sets a keyframe of the camera at the current time. */
  keyCamera() {
    const { camera, path, time } = this.store.state;
    const at = Math.round(time * 1000) / 1000;
    const key = { time: at, eye: camera.eye, rotation: camera.rotation, fov: camera.fov };
    const others = path.filter((other) => Math.abs(other.time - at) >= SAME);
    this.store.set({ path: [...others, key].sort((a, b) => a.time - b.time) });
  }

  refresh() {
    const { store } = this;
    const { time, path } = store.state;
    this.scrub.max = String(store.duration);
    this.scrub.value = String(time);
    if (document.activeElement !== this.box) this.box.value = time.toFixed(2);
    if (document.activeElement !== this.end) this.end.value = short(store.duration, 5);
    this.button.textContent = store.isPlaying ? "❚❚" : "▶";
    this.button.setAttribute("aria-label", store.isPlaying ? "Pause" : "Play");
    const mark = (/** @type {number} */ at, /** @type {string} */ kind, /** @type {string} */ title) => {
      const box = h("button", { className: `mark ${kind}`, title, ariaLabel: title, onclick: () => store.set({ time: at }) });
      box.style.left = `${(100 * Math.min(at, store.duration)) / store.duration}%`;
      return box;
    };
    const times = this.times().filter((at) => at >= 0);
    // Marks stay while they are the same: one of them may have the focus.
    const shown = JSON.stringify([times, path.map((key) => key.time), store.duration]);
    if (shown === this.shown) return;
    this.shown = shown;
    this.marks.replaceChildren(
      ...times.map((at) => mark(at, "weather", `Weather at ${short(at)} s`)),
      ...path.map((key) => mark(key.time, "camera", `Camera at ${short(key.time)} s`)),
    );
  }
}

