// The page: puts its parts together.

import * as backend from "./backend.js";
import { Controls } from "./controls.js";
import { $, count, h, metres, short, toast } from "./dom.js";
import { FilesPanel } from "./files.js";
import { LidarPanel } from "./lidar.js";
import { WeatherPanel, titled } from "./panels.js";
import { Links } from "./share.js";
import { Store } from "./store.js";
import { tabs } from "./tabs.js";
import { Timeline } from "./timeline.js";

/** Longest side and most pixels of a picture that are asked for. */
const MOST_SIDE = 3840;
const MOST_PIXELS = 3840 * 2160;

const store = new Store();
const canvas = /** @type {HTMLCanvasElement} */ ($("picture"));
/** @type {{weather: WeatherPanel, timeline: Timeline, controls: Controls, lidar: LidarPanel | null} | null} */
let parts = null;

const { features } = backend;
$("align-switch").hidden = !features.align;
if (!features.lidar) for (const part of [$("tab-lidar"), $("of-lidar")]) part.remove();
/** The renderer in words, of a page that renders by itself; else empty. */
let renderer = "";

const connection = new backend.Connection(store, {
  frame: show,
  word: hear,
  open: (isOpen) => {
    document.body.dataset.live = isOpen ? "yes" : "no";
    if (!isOpen && !document.body.dataset.failed) veil(parts ? "" : "Connecting");
    $("offline")?.remove();
    if (!isOpen && parts) $("stage").append(h("div", { id: "offline", role: "alert" }, "The program does not respond. The page continues when it is back."));
  },
});

/** Covers the picture with words; none uncovers it. @param {string} text @param {boolean} [isBad] */
function veil(text, isBad = false) {
  $("veil").hidden = text === "";
  $("veil").classList.toggle("bad", isBad);
  $("veil-text").textContent = text;
}

/** Shows the progress of loading the scene. @param {{text?: string, done?: number, total?: number}} word */
function loading({ text, done, total }) {
  const mb = (/** @type {number} */ bytes) => (bytes / 1e6).toFixed(bytes < 1e7 ? 1 : 0);
  const far = done === undefined ? "" : total ? `: ${mb(done)} of ${mb(total)} MB` : `: ${mb(done)} MB`;
  veil(`${text ?? "Reading the scene"}${far}`);
  $("veil-progress").hidden = !total;
  if (total) $("veil-progress").value = (done ?? 0) / total;
}

/** A picture of the scene behind the veil, until there is a better one. @param {string} url */
function poster(url) {
  if (!url) return;
  const picture = h("img", { id: "poster", alt: "", src: url, onload: () => document.body.classList.add("has-poster"), onerror: () => picture.remove() });
  $("veil").before(picture);
}

/** A film of the scene where it cannot be rendered; the poster stays where there is none. @param {string} url */
function film(url) {
  const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const video = h("video", { id: "film", src: url, muted: true, loop: true, autoplay: !isStill, controls: true, playsInline: true, poster: $("poster")?.src ?? "", ariaLabel: "Video of the scene",
    onloadeddata: () => document.body.classList.add("has-poster"), onerror: () => video.remove() });
  $("film")?.remove();
  $("veil").before(video);
}

let statusTimer = 0;

/** Says what the program prepares; what is done at once is not said. @param {string} text */
function status(text) {
  clearTimeout(statusTimer);
  if (!text) return ($("status").hidden = true);
  statusTimer = window.setTimeout(() => {
    $("status").textContent = `${titled(text)} …`;
    $("status").hidden = false;
  }, 400);
}

/** @param {any} word */
async function hear(word) {
  switch (word.type) {
    case "loading":
      return loading(word);
    case "poster":
      return poster(word.url);
    case "failed":
      document.body.dataset.failed = "yes";
      status("");
      if (word.film) film(word.film);
      return veil(word.text, true);
    case "ready":
      renderer = word.device ?? "";
      return begin();
    case "status":
      return status(word.text);
    case "note":
      return console.warn(word.text);
    case "error":
      return toast(word.text, "bad");
    case "state":
      return store.set({ ...word.state, size: store.state.size });
    case "facts":
      return restate(word);
    case "picked":
      return word.point ? parts?.controls.focus(word.point) : toast("There is nothing at this point");
    case "thumbnail":
      return parts?.weather.thumbnail(word.name);
  }
}

/** The scene is there. */
async function begin() {
  /** @type {import("./store.js").Parameters} */
  let parameters;
  try {
    parameters = await backend.parameters();
  } catch (error) {
    return veil(/** @type {Error} */ (error).message, true);
  }
  delete document.body.dataset.failed;
  document.body.classList.remove("waiting");
  const isOther = store.parameters?.scene.name !== parameters.scene.name;
  store.parameters = parameters;
  // After a new start of the program the page goes on with what it showed.
  if (isOther || !store.state) store.state = { ...parameters.state, size: shownSize() };
  if (parts && isOther) return location.reload();
  const links = parts ? null : build();
  const { scene } = parameters;
  $("scene-name").textContent = scene.name;
  about();
  document.title = `${scene.name} – Weather-Magician`;
  // The first picture is that of the link.
  await links?.open();
  if (!features.isStatic || canvas.dataset.seq) veil("");
  else loading({ text: "Rendering the first picture" });
  connection.sentWeather = null;
  connection.touch();
  connection.say({ type: "thumbnails" });
}

/** Says what is known of the scene. */
function about() {
  const { scene } = store.parameters;
  $("scene-about").textContent = `${count(scene.splats)} splats${scene.has_scale ? "" : ", scale unknown"}`;
}

/** Other facts of the scene: the picture is asked for again, level under the new up. @param {any} word */
function restate(word) {
  if (!parts) return;
  const { scene, state: start } = store.parameters;
  const isTurned = word.facts.up.some((/** @type {number} */ v, /** @type {number} */ k) => Math.abs(v - scene.up[k]) > 1e-6);
  Object.assign(scene, word.facts);
  start.camera = word.start;
  about();
  store.tell(["camera"]);
  if (isTurned && store.state.follow === "camera") parts.controls.level();
  connection.say({ type: "thumbnails" });
}

/** The tool that sets up, the ground and the scale; it is fetched when it is first opened. */
function alignment() {
  /** @type {Promise<import("./align.js").AlignTool> | null} */
  let tool = null;
  const load = async () => {
    document.head.append(h("link", { rel: "stylesheet", href: "./align.css" }));
    const { AlignTool } = await import("./align.js");
    return new AlignTool(canvas, store);
  };
  $("align-switch").addEventListener("click", async () => {
    try {
      (await (tool ??= load())).toggle();
    } catch {
      tool = null;
      toast("The program does not respond", "bad");
    }
  });
}

/** Makes the page's parts. */
function build() {
  const pick = (/** @type {number} */ x, /** @type {number} */ y) => connection.say({ type: "pick", x, y });
  const controls = new Controls(canvas, store, pick);
  parts = {
    weather: new WeatherPanel($("tab-weather"), store),
    timeline: new Timeline($("timeline"), store),
    controls,
    lidar: features.lidar ? new LidarPanel($("tab-lidar"), store, (pose) => controls.flyTo(pose)) : null,
  };
  new FilesPanel($("tab-save"), store);
  cameraPanel(parts.controls);
  outputs();
  compare();
  if (features.align) alignment();
  store.listen((changed) => {
    if ([...changed].every((what) => what === "playing" || what === "duration")) return;
    canvas.dataset.settled = "false";
    connection.touch();
  });
  new ResizeObserver(() => store.set({ size: shownSize() })).observe($("stage"));
  keys(parts.controls, parts.timeline);
  help();
  tabs();
  return new Links(store);
}

/** The picture's size in the pixels of the screen: even, and not too large. */
function shownSize() {
  const box = $("stage").getBoundingClientRect();
  const ratio = Math.min(devicePixelRatio || 1, 2);
  let [width, height] = [box.width * ratio, box.height * ratio];
  const fits = Math.min(1, MOST_SIDE / Math.max(width, height), Math.sqrt(MOST_PIXELS / (width * height)));
  return [width, height].map((side) => Math.max(2, 2 * Math.round((side * fits) / 2)));
}

const rate = { frames: 0, since: performance.now(), shown: 0 };

/** @param {import("./connection.js").Head} head @param {ImageBitmap | ImageData} picture */
function show(head, picture) {
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    [canvas.width, canvas.height] = [picture.width, picture.height];
  }
  // A GPU may have been given up.
  renderer = head.device ?? renderer;
  const context = canvas.getContext("2d");
  if (picture instanceof ImageData) context?.putImageData(picture, 0, 0);
  else context?.drawImage(picture, 0, 0);
  if (features.isStatic && !canvas.dataset.seq) {
    veil("");
    $("poster")?.remove();
  }
  Object.assign(canvas.dataset, { seq: head.seq, whole: head.whole, settled: head.seq === connection.seq && !connection.isDue(), time: head.time, camera: JSON.stringify(head.camera) });
  // On a path the camera is the program's; from there the next drag goes on.
  if (store.state.follow === "path") store.state.camera = head.camera;
  rate.frames += 1;
  const now = performance.now();
  if (now - rate.since > 700) {
    rate.shown = (rate.frames * 1000) / (now - rate.since);
    [rate.frames, rate.since] = [0, now];
  }
  stats(head);
  parts?.lidar?.report(head);
}

/** @param {import("./connection.js").Head} head */
function stats(head) {
  const figure = (/** @type {string} */ name, /** @type {string} */ value, /** @type {string} */ title) =>
    h("span", { title, "data-stat": name }, h("b", {}, value), ` ${name}`);
  const isStill = head.whole || (!store.isPlaying && performance.now() - store.changedAt > 1000);
  $("stats").replaceChildren(
    isStill ? h("span", { title: "Frames are rendered when something changes" }, h("b", {}, head.whole ? "still" : "draft")) : figure("fps", short(rate.shown, 2), "Pictures a second that this page shows"),
    figure("ms", String(Math.round(head.draw_ms + head.encode_ms)), `Drawing ${short(head.draw_ms)} ms${features.isStatic ? "" : `, JPEG ${short(head.encode_ms)} ms`}`),
    figure("px", `${head.width}×${head.height}`, "Size of the picture: smaller while something moves"),
    figure("splats", count(head.splats), "Splats in view"),
    ...(head.drops ? [figure("drops", count(head.drops), "Drops or flakes in the picture")] : []),
    figure("MOR", metres(head.mor), "Meteorological optical range at the camera: where 5 % of the light is left"),
    ...(head.rain ? [figure("mm/h rain", short(head.rain), "Rain")] : []),
    ...(head.snow ? [figure("mm/h snow", short(head.snow), "Snowfall, as water")] : []),
    ...(renderer ? [rendererFigure()] : []),
  );
}

/** The figure that names the renderer, and says why if it is the processor. */
function rendererFigure() {
  const [name] = renderer.split(",");
  const isGpu = name.trim().toLowerCase() === "gpu";
  const why = isGpu ? "The graphics card of this device renders the pictures" : "navigator" in globalThis && "gpu" in navigator
    ? "The processor renders the pictures: this browser's WebGPU has no graphics card that will do. Pictures come more slowly and smaller while something moves"
    : "The processor renders the pictures, as this browser has no WebGPU. Pictures come more slowly; they are the same";
  return h("span", { "data-stat": "device", title: `${why} (${renderer})` }, "on ", h("b", {}, isGpu ? "GPU" : "CPU"));
}

function outputs() {
  const names = { rgb: "Colour", depth: "Depth", normal: "Normals", alpha: "Coverage" };
  const buttons = store.parameters.outputs.map((output, index) =>
    h("button", { "data-output": output, title: `${titled(output)} (${index + 1})`, onclick: () => store.set({ output }) }, /** @type {any} */ (names)[output] ?? output));
  $("outputs").replaceChildren(...buttons);
  const refresh = () => buttons.forEach((button) => button.setAttribute("aria-pressed", String(button.dataset.output === store.state.output)));
  store.listen(refresh);
  refresh();
}

/** Before and after, with a line between that can be dragged. */
function compare() {
  const line = $("divider");
  const refresh = () => {
    const { divider, weather } = store.state;
    line.hidden = divider === null;
    $("divider-switch").setAttribute("aria-pressed", String(divider !== null));
    if (divider === null) return;
    line.style.left = `${100 * divider}%`;
    line.setAttribute("aria-valuenow", String(Math.round(100 * divider)));
    $("divider-right").textContent = weather.name ?? "weather";
  };
  $("divider-switch").addEventListener("click", () => store.set({ divider: store.state.divider === null ? 0.5 : null }));
  line.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => line.setPointerCapture(event.pointerId));
  line.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
    if (!event.buttons) return;
    const box = canvas.getBoundingClientRect();
    store.set({ divider: Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) });
  });
  line.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    const at = store.state.divider ?? 0.5;
    const step = event.shiftKey ? 0.1 : 0.01;
    /** @type {Record<string, number>} */
    const ways = { ArrowLeft: at - step, ArrowDown: at - step, ArrowRight: at + step, ArrowUp: at + step, Home: 0, End: 1 };
    const to = ways[event.key];
    if (to === undefined) return;
    event.preventDefault();
    store.set({ divider: Math.round(1000 * Math.min(1, Math.max(0, to))) / 1000 });
  });
  store.listen(refresh);
  refresh();
}

/** @param {Controls} controls */
function cameraPanel(controls) {
  const { scene, state: start } = store.parameters;
  const slider = (/** @type {string} */ label, /** @type {string} */ unit, /** @type {any} */ range, /** @type {() => number} */ get, /** @type {(v: number) => void} */ set, /** @type {(v: number) => string} */ text = (v) => short(v)) => {
    const box = h("output", { className: "number" });
    const input = h("input", { type: "range", ...range, ariaLabel: label, oninput: () => { set(Number(input.value)); refresh(); } });
    const refresh = () => {
      input.value = String(get());
      box.textContent = text(get());
    };
    store.listen(refresh);
    refresh();
    return h("div", { className: "param" }, h("label", {}, label), h("div", { className: "slide" }, input, box, h("span", { className: "unit quiet" }, unit)));
  };
  const where = h("p", { id: "where", className: "quiet" });
  const keys = h("div", { id: "camera-keys" });
  const goTo = (/** @type {number} */ index) => {
    const { time, eye, rotation, fov } = store.state.path[index];
    controls.flyTo({ eye, rotation, fov });
    store.set({ time });
  };
  const remove = (/** @type {number} */ index) => {
    const { path } = store.state;
    store.set({ path: path.filter((_, other) => other !== index), ...(path.length === 1 ? { follow: "camera" } : {}) });
    // The focus goes to the next one, or to what adds one.
    /** @type {HTMLElement} */ (keys.children[Math.min(index, keys.children.length - 1)]?.lastElementChild ?? $("add-key")).focus();
  };
  const follow = h("button", { id: "follow", onclick: () => {
    if (store.state.path.length === 0) return toast("Set keyframes of the camera first: ◆ Camera beside the time");
    store.set({ follow: store.state.follow === "path" ? "camera" : "path" });
  } }, "Look along the path");
  const photos = scene.views.length === 0 ? (features.isStatic ? [] : [h("h2", {}, "Photos"), h("p", { className: "quiet" }, "This scene has no photos' cameras. Load them with --views.")]) : [
    h("h2", {}, "Photos"),
    h("div", { className: "row" },
      h("button", { id: "photo-before", ariaLabel: "Previous photo", onclick: () => photo(-1) }, "‹"),
      h("select", { id: "photo", ariaLabel: "Photo", onchange: () => photo(0) }, ...scene.views.map((view, index) => h("option", { value: String(index) }, view.name.split(/[/\\]/).pop() ?? ""))),
      h("button", { id: "photo-after", ariaLabel: "Next photo", onclick: () => photo(1) }, "›")),
    h("button", { id: "photo-path", onclick: () => {
      const step = Math.max(1, Math.ceil(scene.views.length / 60));
      const views = scene.views.filter((_, index) => index % step === 0);
      const time = (/** @type {number} */ index) => (views.length > 1 ? (store.duration * index) / (views.length - 1) : 0);
      store.set({ path: views.map((view, index) => ({ time: time(index), ...view.camera })), follow: "path" });
    } }, "Move along the photos"),
  ];
  const photo = (/** @type {number} */ by) => {
    const box = $("photo");
    box.selectedIndex = (box.selectedIndex + by + scene.views.length) % scene.views.length;
    controls.flyTo({ ...scene.views[box.selectedIndex].camera });
  };
  $("tab-camera").replaceChildren(
    where,
    slider("Field of view", "°", { min: "10", max: "110", step: "1" }, () => store.state.camera.fov, (fov) => controls.set({ ...store.state.camera, fov })),
    slider("Walking speed", "×", { min: "-2", max: "2", step: "0.1" }, () => Math.log10(controls.speed), (s) => (controls.speed = 10 ** s), (s) => short(10 ** s, 2)),
    h("div", { className: "buttons" }, h("button", { id: "home", title: "Return to the initial view (R)", onclick: () => controls.flyTo(start.camera) }, "Start view")),
    h("h2", {}, "Path"),
    h("p", { className: "quiet" }, "◆ Camera beside the time keeps the camera of this instant. Two and more make a path."),
    keys,
    h("div", { className: "buttons" }, follow, h("button", { id: "path-clear", onclick: () => store.set({ path: [], follow: "camera" }) }, "Clear")),
    ...photos,
  );
  let listed = "";
  const refresh = () => {
    const { camera, path, follow: way } = store.state;
    where.textContent = `Eye ${camera.eye.map((v) => short(v)).join(", ")}, ${scene.has_scale ? `1 unit is ${short(scene.metres_per_unit)} m` : "scene units"}`;
    follow.setAttribute("aria-pressed", String(way === "path"));
    const shown = JSON.stringify(path.map((key) => key.time));
    if (shown === listed) return;
    listed = shown;
    keys.replaceChildren(...path.slice(0, 100).map((key, index) => h("div", { className: "row" },
      h("button", { className: "grow", onclick: () => goTo(index) }, `◆ ${short(key.time)} s`),
      h("button", { className: "icon-button", title: "Remove this keyframe", ariaLabel: `Remove the keyframe at ${short(key.time)} s`, onclick: () => remove(index) }, "×"))));
  };
  store.listen((changed) => {
    if (["camera", "path", "follow"].some((what) => changed.has(what))) refresh();
  });
  refresh();
  for (const mode of /** @type {const} */ (["orbit", "fly"])) $(`mode-${mode}`).addEventListener("click", () => controls.setMode(mode));
}

/** @type {[string, string][]} */
const KEYS = [
  ["Drag", "orbit around the centre (Orbit), look around (Fly)"],
  ["Shift or right drag, two fingers", "shift"],
  ["Wheel, pinch", "move closer or away"],
  ["Double click", "orbit around the point"],
  ["W A S D, Q E", "walk, down and up; Shift is faster"],
  ["Arrows", "look around"],
  ["F", "Orbit or Fly"],
  ["R", "return to the initial view"],
  ["Space", "play and pause"],
  [", .", "previous and next frame"],
  ["K", "keyframe of the camera"],
  ["P", "look along the path"],
  ["Tab", "next control; the arrows go among tabs and presets, and move the line of Compare and the sun"],
  ["1 2 3 4", "colour, depth, normals, coverage"],
  ["B", "before and after"],
  ["Ctrl S", "save the picture"],
  ["L", "light or dark"],
  ["Escape", features.align ? "close this list, Align, the panel of a phone" : "close this list, the panel of a phone"],
  ["?", "this list"],
];

/** @param {Controls} controls @param {Timeline} timeline */
function keys(controls, timeline) {
  const isTyping = (/** @type {Event} */ event) => /** @type {HTMLElement} */ (event.target).matches?.("input[type=text], input:not([type]), input.number, select, textarea, pre");
  addEventListener("keydown", (event) => {
    if (event.key === "s" && (event.ctrlKey || event.metaKey)) {
      event.preventDefault();
      return $("save-picture").click();
    }
    // What a control or a dialog does with a key is its own.
    if (event.defaultPrevented || isTyping(event) || event.ctrlKey || event.metaKey || event.altKey) return;
    if ($("help").open && event.key !== "?") return;
    // Space presses what has the focus.
    const isPressed = /** @type {HTMLElement} */ (event.target).matches?.("button, summary, a, input[type=checkbox]");
    if (event.key === " " && isPressed) return;
    const isSlider = /** @type {HTMLElement} */ (event.target).matches?.("input[type=range]");
    if (Controls.moves(event.code) && !(isSlider && event.code.startsWith("Arrow"))) {
      event.preventDefault();
      controls.flight = null;
      return controls.keys.add(event.code);
    }
    controls.keys.add(event.code);
    /** @type {Object<string, () => void>} */
    const act = {
      f: () => controls.setMode(controls.mode === "orbit" ? "fly" : "orbit"),
      r: () => controls.flyTo(store.parameters.state.camera),
      " ": () => timeline.toggle(),
      ",": () => timeline.goTo(store.state.time - 1 / 30),
      ".": () => timeline.goTo(store.state.time + 1 / 30),
      k: () => timeline.keyCamera(),
      p: () => $("follow").click(),
      b: () => $("divider-switch").click(),
      l: () => $("theme").click(),
      "?": () => $("help-switch").click(),
    };
    const output = store.parameters.outputs[Number(event.key) - 1];
    const run = output ? () => store.set({ output }) : act[event.key.toLowerCase()];
    if (!run) return;
    event.preventDefault();
    run();
  });
  addEventListener("keyup", (event) => controls.keys.delete(event.code));
}

function help() {
  const dialog = $("help");
  dialog.replaceChildren(
    h("h2", { id: "help-title", tabIndex: -1, autofocus: true }, "Keys and gestures"),
    h("dl", {}, ...KEYS.flatMap(([key, what]) => [h("dt", {}, ...key.split(", ").flatMap((part, index) => [index ? ", " : "", h("kbd", {}, part)])), h("dd", {}, what)])),
    h("p", { className: "quiet" }, `${store.parameters.program}, ${store.parameters.scene.renderer}`),
    h("form", { method: "dialog" }, h("button", { className: "main" }, "Close")),
  );
  $("help-switch").addEventListener("click", () => (dialog.open ? dialog.close() : dialog.showModal()));
  dialog.addEventListener("click", (/** @type {Event} */ event) => event.target === dialog && dialog.close());
}

/** Light or dark: as the system has it, until it is chosen. */
function theme() {
  // Some browsers keep nothing for files and in private windows.
  const keep = (/** @type {string} */ next) => {
    try {
      localStorage.setItem("theme", next);
    } catch {}
  };
  let kept = null;
  try {
    kept = localStorage.getItem("theme");
  } catch {}
  if (kept) document.documentElement.dataset.theme = kept;
  $("theme").addEventListener("click", () => {
    const isDark = document.documentElement.dataset.theme ? document.documentElement.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    const next = isDark ? "light" : "dark";
    document.documentElement.dataset.theme = next;
    keep(next);
  });
}

theme();
