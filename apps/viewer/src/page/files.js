// Saving: pictures, weathers, cameras, commands, videos. And loading a weather.

import * as backend from "./backend.js";
import { h, short, toast } from "./dom.js";
import { Store } from "./store.js";

/** Sizes of pictures and videos beside that of the window, px. */
const SIZES = [[1280, 720], [1920, 1080], [2560, 1440], [3840, 2160]];

/** Gives a file to the browser. @param {Blob} blob @param {string} name */
function download(blob, name) {
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** The command that makes a file of a state; none without an answer. @param {string} kind @param {import("./store.js").ViewState} state */
export async function commandOf(kind, state) {
  try {
    const { blob } = await backend.file(kind, state);
    return (await blob.text()).trim();
  } catch {
    return "";
  }
}

/** Says what was wrong. @param {any} error */
const complain = (error) => toast(error.message, "bad");

/** Saves files of a state. @param {string[]} kinds @param {import("./store.js").ViewState} state */
export async function saveFiles(kinds, state) {
  for (const kind of kinds) {
    try {
      const { name, blob } = await backend.file(kind, state);
      download(blob, name);
      toast(`Saved ${name}`);
    } catch (error) {
      return complain(error);
    }
  }
}

export class FilesPanel {
  /** @param {HTMLElement} root @param {Store} store */
  constructor(root, store) {
    this.store = store;
    this.size = this.sizes("size-picture");
    this.filmSize = this.sizes("size-video");
    this.command = h("pre", { id: "command", tabIndex: 0, ariaLabel: "Command that renders the same picture" });
    this.file = h("input", { type: "file", accept: ".toml", hidden: true, onchange: () => this.load() });
    this.fps = h("input", { id: "fps", className: "number", value: "30", inputMode: "decimal", ariaLabel: "Frames a second" });
    this.seconds = h("input", { id: "seconds", className: "number", value: short(store.duration, 5), inputMode: "decimal", ariaLabel: "Seconds" });
    this.bar = h("progress", { id: "video-progress", max: 1, value: 0, hidden: true });
    this.note = h("p", { id: "video-note", className: "quiet" });
    this.begin = h("button", { id: "video-begin", className: "main", onclick: () => this.film() }, "Render video");
    this.stop = h("button", { id: "video-stop", hidden: true, onclick: () => this.end() }, "Stop");
    this.link = h("a", { id: "video-file", className: "button main", hidden: true }, "Download");
    const button = (/** @type {string} */ id, /** @type {string} */ text, /** @type {string} */ kind) =>
      h("button", { id, onclick: () => this.save([kind]) }, text);
    root.replaceChildren(
      h("h2", {}, "Picture"),
      h("div", { className: "param" }, h("label", { htmlFor: "size-picture" }, "Size"), this.size),
      h("div", { className: "buttons" },
        h("button", { id: "save-all", className: "main", title: "Save the picture, and the weather and camera files that the command below needs", onclick: () => this.save(["picture", "weather", "camera"]) }, "Save all"),
        button("save-picture", "PNG", "picture"), button("save-weather", "Weather", "weather"), button("save-camera", "Camera", "camera")),
      h("p", { className: "quiet" }, backend.features.isStatic
        ? "The command renders the same view of the scene that this page was made from, with the saved files. The page's copy of the scene and a browser's arithmetic are rounded otherwise, so the pictures differ a little."
        : "The command renders the same picture from the saved files, on the processor byte for byte."),
      this.command,
      h("div", { className: "buttons" }, h("button", { id: "copy-command", onclick: () => this.copy() }, "Copy command"), h("button", { onclick: () => this.file.click() }, "Load weather…"), this.file),
      ...(backend.features.video ? [
        h("h2", {}, "Video"),
        h("p", { className: "quiet", hidden: store.parameters.video }, "This build has no video encoder."),
        h("div", { className: "param" }, h("label", { htmlFor: "size-video" }, "Size"), this.filmSize),
        h("div", { className: "row" }, h("label", { htmlFor: "seconds" }, "Seconds"), this.seconds, h("label", { htmlFor: "fps" }, "Frames/s"), this.fps),
        h("p", { className: "quiet" }, "Starts at time 0; follows the camera path if “Look along the path” is on."),
        h("div", { className: "buttons" }, this.begin, this.stop, this.link),
        this.bar, this.note,
      ] : []),
    );
    this.timer = 0;
    store.listen((changed) => {
      if (changed.has("duration")) this.seconds.value = short(store.duration, 5);
      if ([...changed].some((what) => !["playing", "divider", "lidar"].includes(what))) this.soon();
    });
    this.soon();
  }

  /** @param {string} id */
  sizes(id) {
    return h("select", { id, ariaLabel: "Size", onchange: () => this.soon() }, h("option", { value: "" }, "as shown"), ...SIZES.map(([w, hgt]) => h("option", { value: `${w}x${hgt}` }, `${w} × ${hgt}`)));
  }

  /** The state with the size that is chosen; sides are even. @param {HTMLSelectElement} box */
  stateFor(box) {
    const size = box.value ? box.value.split("x").map(Number) : this.store.state.size;
    return { ...this.store.state, size: size.map((side) => side - (side % 2)) };
  }

  /** Asks for the command a little later: not for every step of a slider. */
  soon() {
    clearTimeout(this.timer);
    if (this.store.isPlaying) return;
    this.timer = window.setTimeout(async () => {
      const command = await commandOf("command", this.stateFor(this.size));
      if (command) this.command.textContent = command;
    }, 400);
  }

  /** @param {string[]} kinds */
  save(kinds) {
    return saveFiles(kinds, this.stateFor(this.size));
  }

  async copy() {
    try {
      await navigator.clipboard.writeText(this.command.textContent);
      toast("Copied");
    } catch {
      getSelection()?.selectAllChildren(this.command);
      toast("Press Ctrl+C to copy");
    }
  }

  async load() {
    const file = this.file.files?.[0];
    if (!file) return;
    try {
      this.store.set({ weather: await backend.readWeather(await file.text()) });
      toast(`Loaded ${file.name}`);
    } catch (error) {
      complain(error);
    }
    this.file.value = "";
  }

  async film() {
    const asked = { state: this.stateFor(this.filmSize), fps: Number(this.fps.value), seconds: Number(this.seconds.value) };
    try {
      this.id = (await backend.beginVideo(asked)).id;
    } catch (error) {
      return complain(error);
    }
    [this.begin.hidden, this.stop.hidden, this.link.hidden, this.bar.hidden] = [true, false, true, false];
    this.watch();
  }

  async watch() {
    /** @type {any} */
    const video = await backend.video(this.id).catch((error) => ({ state: "failed", error: error.message }));
    this.bar.value = video.frames ? video.done / video.frames : 0;
    this.note.textContent = video.state === "running" ? `${video.done} of ${video.frames} frames` : video.state === "done" ? `${video.frames} frames` : video.error;
    if (video.state === "running") return setTimeout(() => this.watch(), 400);
    [this.begin.hidden, this.stop.hidden, this.bar.hidden] = [false, true, true];
    if (video.state === "done") {
      [this.link.href, this.link.download, this.link.hidden] = [backend.videoFile(this.id), video.name, false];
    }
  }

  async end() {
    await backend.stopVideo(this.id).catch(complain);
  }
}
