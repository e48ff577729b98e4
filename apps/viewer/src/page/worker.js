// The renderer of an exported site, in a worker: a classic one without static imports, as Chromium
// starts no other from file://. It is told views and answers questions in the words of the viewer's
// WebSocket.
//
// In: {type: "open", device, base}, {type: "view", seq, moving, state}, {type: "pick", x, y},
// {type: "thumbnails"},
//      {type: "ask", id, what, body}, {type: "fetched", id, bytes}
// Out: {type: "frame", head, pixels}, {type: "answer", id, ok, text?, bytes?, name?, kind?}, {type:
// "fetch", id, name},
//      loading, ready, failed, status, error, picked, thumbnail

/** @type {any} The player; null until it is open. */
let player = null;
/** Address of the site; null if the page holds its files. @type {string | null} */
let base = null;
/** @type {any} The site file. */
let site = null;
/** True if a file was missing. */
let wasMissing = false;
/** The state of the last view; fields that a message leaves out keep their value. @type {any} */
let state = {};
/** The view that is drawn next. @type {{seq: number, moving: boolean} | null} */
let next = null;
/** Jobs to do before the next view: the player does one thing at a time. @type {(() => Promise<void>)[]} */
const jobs = [];
let isBusy = false;

/** @param {any} message @param {Transferable[]} [moved] */
const tell = (message, moved = []) => /** @type {any} */ (globalThis).postMessage(message, moved);

/** The words of an error, in a line. @param {any} error */
function words(error) {
  const text = error instanceof Error ? error.message : String(error);
  return text.split("\n")[0].slice(0, 500);
}

/** Lets messages in. */
const channel = new MessageChannel();
/** @type {(() => void)[]} */
const turns = [];
channel.port1.onmessage = () => turns.shift()?.();
const turn = () => new Promise((resolve) => {
  turns.push(() => resolve(undefined));
  channel.port2.postMessage(0);
});

// Files.

let lastFetch = 0;
/** @type {Map<number, (bytes: Uint8Array | null) => void>} */
const fetches = new Map();

/** A file of the site, with words of how far it is. @param {string} name @param {(done: number, total: number) => void} [progress] */
async function bytesOf(name, progress) {
  if (base === null) {
    const bytes = await new Promise((resolve) => {
      fetches.set((lastFetch += 1), resolve);
      tell({ type: "fetch", id: lastFetch, name });
    });
    if (!bytes) throw missing(`${name}: this page does not hold the file`);
    return /** @type {Uint8Array} */ (bytes);
  }
  const response = await fetch(new URL(name, base)).catch(() => null);
  if (!response) throw missing(`${name}: cannot be fetched`);
  if (!response.ok || !response.body) throw missing(`${name}: the host responded with status ${response.status}`);
  // The length of a packed response is not that of the file.
  const total = response.headers.get("content-encoding") ? 0 : Number(response.headers.get("content-length") ?? 0);
  const reader = response.body.getReader();
  /** @type {Uint8Array[]} */
  const parts = [];
  let done = 0;
  for (;;) {
    const { value } = await reader.read().catch(() => {
      throw missing(`${name}: the connection broke`);
    });
    if (!value) break;
    parts.push(value);
    done += value.length;
    progress?.(done, total);
  }
  if (parts.length === 1) return parts[0];
  const bytes = new Uint8Array(done);
  let at = 0;
  for (const part of parts.splice(0)) {
    bytes.set(part, at);
    at += part.length;
  }
  return bytes;
}

/** @param {string} text */
function missing(text) {
  wasMissing = true;
  return new Error(text);
}

let loaded = 0;

/** A file of the place, for the player. @param {string} name */
async function fetchFile(name) {
  // The player asks for what the site file lists; an address must not lead out of the place.
  if (!/^[\w.-]+(\/[\w.-]+)*$/.test(name) || name.split("/").includes("..")) throw missing(`${name}: is not a file of this site`);
  let told = 0;
  const isScene = !player && name !== "place.json" && !name.startsWith("assets/");
  const before = loaded;
  const progress = (/** @type {number} */ done, /** @type {number} */ total) => {
    if (performance.now() - told < 100 && done !== total) return;
    told = performance.now();
    // Of a scene in levels several files are read; how many is not known before.
    const isOne = site?.scene === name;
    tell({ type: "loading", text: "Loading the scene", done: isOne ? done : before + done, total: isOne ? total : 0 });
  };
  const bytes = await bytesOf(`place/${name}`, isScene ? progress : undefined);
  if (name === "place.json") site = JSON.parse(new TextDecoder().decode(bytes));
  if (isScene) {
    loaded += bytes.length;
    tell({ type: "loading", text: "Reading the scene" });
  }
  return bytes;
}

// The player.

/** @param {{device: string, base: string | null}} message */
async function open(message) {
  base = message.base;
  tell({ type: "loading", text: "Loading the renderer" });
  try {
    // In a single-file site only a Blob URL of the worker itself can be imported by it.
    const address = base === null ? URL.createObjectURL(new Blob([await bytesOf("player.js")], { type: "text/javascript" })) : new URL("player.js", base).href;
    const module = await import(address);
    const source = base === null ? await bytesOf("player_bg.wasm") : new URL("player_bg.wasm", base);
    await module.default({ module_or_path: source });
    const say = (/** @type {string} */ text) => {
      const word = JSON.parse(text);
      // What the page does at these is begun here.
      if (word.type !== "ready" && word.type !== "failed") tell(word);
    };
    let opened;
    try {
      opened = await module.Player.open(fetchFile, say, message.device);
    } catch (error) {
      // A GPU that cannot hold the scene; the processor may.
      if (message.device === "cpu" || wasMissing || !("gpu" in navigator) || error instanceof WebAssembly.RuntimeError) throw error;
      opened = await module.Player.open(fetchFile, say, "cpu");
    }
    player = opened;
    tell({ type: "ready", device: player.device() });
  } catch (error) {
    tell({ type: "failed", text: `The scene cannot be shown: ${words(error)}` });
  }
  work();
}

/** Does what is to be done, one after another. */
async function work() {
  if (isBusy || !player) return;
  isBusy = true;
  while (player && (jobs.length > 0 || next)) {
    try {
      await (jobs.shift() ?? draw)();
    } catch (error) {
      // After a trap the player's memory is not to be trusted.
      if (error instanceof WebAssembly.RuntimeError || error instanceof RangeError) {
        player = null;
        tell({ type: "failed", text: `The renderer has stopped: ${words(error)}. Reload the page.` });
        break;
      }
      tell({ type: "status", text: "" });
      tell({ type: "error", text: words(error) });
    }
    await turn();
  }
  isBusy = false;
}

/** Frames in a row that may lack something before newer views wait for it. */
const PATIENCE = 4;
let lacked = 0;

/** Draws the latest view; where something lacked, gets it and draws again, unless there is a newer view. */
async function draw() {
  const view = /** @type {{seq: number, moving: boolean}} */ (next);
  next = null;
  const frame = await player.render(view.seq, view.moving, JSON.stringify(state));
  const head = { ...JSON.parse(frame.head), width: frame.width, height: frame.height };
  const { more } = frame;
  const pixels = alone(frame.pixels);
  frame.free?.();
  tell({ type: "frame", head, pixels: pixels.buffer }, [pixels.buffer]);
  lacked = more ? lacked + 1 : 0;
  if (!more) return;
  await turn();
  // A film brings a newer view each time; what it lacks is to come all the same.
  if ((next || jobs.length > 0) && lacked < PATIENCE) return void (next ??= view);
  lacked = 0;
  await player.prepare();
  next ??= view;
}

/** Bytes in a buffer of their own. @param {Uint8Array} bytes */
const alone = (bytes) => (bytes.byteLength === bytes.buffer.byteLength ? bytes : bytes.slice());

/** @param {{id: number, what: string, body: any}} question */
async function answer({ id, what, body }) {
  const [head, kind] = what.split("/");
  /** @type {Record<string, () => any>} */
  const ways = {
    parameters: () => ({ text: player.parameters() }),
    weather: () => ({ text: player.weather(body) }),
    link: () => ({ text: player.link(JSON.stringify(body)) }),
    unlink: () => ({ text: player.unlink(body) }),
    file: async () => {
      const saved = await player.file(kind, JSON.stringify(body));
      const told = { name: saved.name, kind: saved.kind, bytes: alone(saved.bytes) };
      saved.free?.();
      return told;
    },
  };
  try {
    const told = await ways[head]();
    tell({ type: "answer", id, ok: true, ...told }, told.bytes ? [told.bytes.buffer] : []);
  } catch (error) {
    tell({ type: "answer", id, ok: false, text: words(error) });
    if (error instanceof WebAssembly.RuntimeError) throw error;
  }
}

globalThis.onmessage = (event) => {
  const message = event.data;
  switch (message.type) {
    case "open":
      return void open(message);
    case "fetched":
      fetches.get(message.id)?.(message.bytes);
      return void fetches.delete(message.id);
    case "view":
      state = { ...state, ...message.state };
      next = { seq: message.seq, moving: message.moving };
      break;
    case "pick":
      jobs.push(async () => tell({ type: "picked", point: JSON.parse(await player.pick(message.x, message.y)) }));
      break;
    case "ask":
      jobs.push(() => answer(message));
      break;
    case "thumbnails":
      for (const name of site?.thumbnails ?? []) tell({ type: "thumbnail", name });
  }
  work();
};
