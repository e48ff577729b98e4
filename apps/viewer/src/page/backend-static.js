// The page's way to a renderer in the browser: a worker with the player in WebAssembly. An exported
// site has this file as backend.js. The interface is described in backend-server.js.
//
// A site is a folder on any static host: index.html, the page's files, player.js, player_bg.wasm,
// poster.jpg, video.mp4 (optional) and place/. Its policy (CSP, a meta element of index.html):
// default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self';
// img-src 'self' blob: data:; media-src 'self'; connect-src 'self'; base-uri 'none'; form-action
// 'none'
//
// A site in a single file, which also opens from file://: index.html changed by plain replacement
// of text:
//   1. `<link rel="stylesheet" href="./style.css">` becomes `<style>` with the text of style.css.
//   2. each `"./icon.svg"` becomes `"data:image/svg+xml;base64,..."`.
//   3. `<script type="module" src="./main.js"></script>` is taken away.
//   4. before `</body>` comes, for every file of the site other than index.html, style.css and
//      icon.svg,
//      `<script type="application/octet-stream;base64" data-name="place/scene.sog">BASE64</script>`,
//      names as in the folder (backend.js, main.js, player.js, player_bg.wasm, poster.jpg, ...),
//      then `<script>` with the text of single.js, which makes Blob URLs of the modules. Its
//      policy: default-src 'none'; script-src 'sha256-(of the text between <script> and </script>)'
//      blob: 'wasm-unsafe-eval'; worker-src blob:; style-src 'unsafe-inline'; img-src blob: data:;
//      media-src blob:; connect-src blob: data:; base-uri 'none'; form-action 'none'

import { ViewSender } from "./connection.js";

export const features = { align: false, lidar: false, video: false, isStatic: true };

/** Files of a single-file site, see single.js. @type {import("./single.js").Files | undefined} */
const inside = /** @type {any} */ (globalThis).WM_FILES;

/** A function that only an engine with SIMD accepts: (func (result v128) i32.const 0 i8x16.splat). */
const SIMD = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 8, 1, 6, 0, 65, 0, 253, 15, 11]);

/** @type {Worker | null} */
let worker = null;
let lastQuestion = 0;
/** @type {Map<number, {resolve: (answer: any) => void, reject: (why: Error) => void}>} */
const questions = new Map();

/** Asks the worker. @param {string} what @param {any} [body] @returns {Promise<any>} */
function ask(what, body) {
  return new Promise((resolve, reject) => {
    if (!worker) return reject(new Error("The renderer has stopped. Reload the page."));
    lastQuestion += 1;
    questions.set(lastQuestion, { resolve, reject });
    worker.postMessage({ type: "ask", id: lastQuestion, what, body });
  });
}

/** Address of a file of the site. @param {string} name */
function address(name) {
  return inside ? inside.url(name) : new URL(`./${name}`, document.baseURI).href;
}

/** The ability that this browser lacks, in a sentence; empty if it will do. */
function lack() {
  if (typeof WebAssembly !== "object" || !WebAssembly.validate(SIMD)) return "This browser has no WebAssembly SIMD, which the renderer needs. A current browser has it.";
  return typeof Worker === "function" ? "" : "This browser has no workers, which the renderer needs.";
}

export class Connection extends ViewSender {
  /** @param {import("./store.js").Store} store @param {import("./connection.js").Listener} on */
  constructor(store, on) {
    super(store);
    this.on = on;
    this.isReady = false;
    // The page's own parts are set up first.
    queueMicrotask(() => this.start());
  }

  start() {
    this.on.open(true);
    this.on.word({ type: "poster", url: address("poster.jpg") });
    const why = lack();
    if (why) return this.end(why);
    try {
      worker = new Worker(address("worker.js"));
    } catch (error) {
      return this.end(`The renderer cannot be started: ${error instanceof Error ? error.message : error}`);
    }
    worker.onmessage = (event) => this.hear(event.data);
    worker.onmessageerror = () => this.end("The renderer sent something that this page cannot read.");
    worker.onerror = (event) => {
      event.preventDefault();
      this.end(event.message ? `The renderer has stopped: ${event.message}` : "The renderer could not be loaded.");
    };
    const asked = new URLSearchParams(location.search).get("device") ?? "";
    const device = ["cpu", "gpu"].includes(asked) ? asked : "auto";
    worker.postMessage({ type: "open", device, base: inside ? null : new URL("./", document.baseURI).href });
  }

  /** The renderer is gone: the film or the poster stays. @param {string} text */
  end(text) {
    worker?.terminate();
    worker = null;
    this.isReady = false;
    for (const { reject } of questions.values()) reject(new Error(text));
    questions.clear();
    const hasFilm = inside ? inside.has("video.mp4") : true;
    this.on.word({ type: "failed", text, film: hasFilm ? address("video.mp4") : null });
  }

  /** @param {any} word */
  hear(word) {
    switch (word.type) {
      case "frame":
        return this.on.frame(word.head, new ImageData(new Uint8ClampedArray(word.pixels), word.head.width, word.head.height));
      case "answer": {
        const question = questions.get(word.id);
        questions.delete(word.id);
        return word.ok ? question?.resolve(word) : question?.reject(new Error(word.text));
      }
      case "fetch": {
        const bytes = inside?.bytes(word.name) ?? null;
        return worker?.postMessage({ type: "fetched", id: word.id, bytes }, bytes ? [bytes.buffer] : []);
      }
      case "failed":
        return this.end(word.text);
      case "ready":
        this.isReady = true;
    }
    this.on.word(word);
  }

  isOpen() {
    return this.isReady && worker !== null;
  }

  /** @param {any} message */
  say(message) {
    worker?.postMessage(message);
  }
}

export const parameters = async () => JSON.parse((await ask("parameters")).text);

/** @param {string} kind @param {import("./store.js").ViewState} state */
export async function file(kind, state) {
  const { name, kind: type, bytes } = await ask(`file/${kind}`, state);
  return { name, blob: new Blob([bytes], { type }) };
}

/** @param {string} text */
export const readWeather = async (text) => JSON.parse((await ask("weather", text)).text);

/** @param {string} name */
export const thumbnail = (name) => address(`place/thumbnails/${inside ? name : encodeURIComponent(name)}.jpg`);

/** @param {import("./store.js").ViewState} state */
export const linkOf = async (state) => (await ask("link", state)).text;

/** @param {string} text */
export const stateOf = async (text) => JSON.parse((await ask("unlink", text)).text);

const none = () => Promise.reject(new Error("This page cannot do that; `weather-magician view` can."));
export const [surface, facts, beginVideo, video, stopVideo] = /** @type {((what?: any) => Promise<any>)[]} */ ([none, none, none, none, none]);
export const videoFile = () => "";
