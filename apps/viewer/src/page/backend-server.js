// The page's way to the program: a WebSocket for pictures and words, requests for the rest. The
// server serves this file as backend.js.
//
// The interface, which backend-static.js has too; every promise is rejected with an Error of one
// line: features what can be done here class Connection ViewSender with `say`; pictures and words
// go to its listener parameters() effects, presets and facts of the scene file(kind, state) {name,
// blob} of picture, weather, camera, command (points, scan) readWeather(text) a weather file as
// JSON thumbnail(name) address of a preset's picture linkOf(state), stateOf(text) fragment of an
// address, and the state that it opens surface(question), facts(change) with features.align
// beginVideo(asked), video(id), stopVideo(id), videoFile(id) with features.video

import { ViewSender } from "./connection.js";
import { enter } from "./login.js";

await enter();

/** Time until the next try after the connection broke, ms. */
const AGAIN = 1000;

/** Abilities of this page. `isStatic`: the page renders by itself. */
export const features = { align: true, lidar: true, video: true, isStatic: false };

export class Connection extends ViewSender {
  /** @param {import("./store.js").Store} store @param {import("./connection.js").Listener} on */
  constructor(store, on) {
    super(store);
    this.on = on;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.shown = 0;
    this.connect();
  }

  connect() {
    const address = new URL("./ws", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    address.search = address.hash = "";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      [this.socket, this.sentWeather, this.dirty] = [socket, null, true];
      this.on.open(true);
    };
    socket.onclose = () => {
      if (this.socket === socket) this.on.open(false);
      this.socket = null;
      // A program that was started anew may want another token.
      setTimeout(() => enter().then(() => this.connect()), AGAIN);
    };
    socket.onmessage = (event) => {
      if (typeof event.data === "string") this.on.word(JSON.parse(event.data));
      else this.receive(event.data);
    };
  }

  /** @param {ArrayBuffer} message */
  async receive(message) {
    const length = new DataView(message).getUint32(0, true);
    /** @type {import("./connection.js").Head} */
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length)));
    const blob = new Blob([new Uint8Array(message, 4 + length)], { type: "image/jpeg" });
    const picture = await createImageBitmap(blob);
    this.say({ type: "seen", seq: head.seq });
    // Pictures are decoded side by side; an older one must not replace a newer.
    if (head.seq >= this.shown) {
      this.shown = head.seq;
      this.on.frame(head, picture);
    }
    picture.close();
  }

  isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** @param {any} message */
  say(message) {
    if (this.isOpen()) this.socket?.send(JSON.stringify(message));
  }
}

/**
 * The answer to a request; its words where it is refused.
 * @param {string} path @param {string} [method] @param {string} [body] @returns {Promise<Response>}
 */
async function ask(path, method = "GET", body) {
  const response = await fetch(path, { method, body }).catch(() => null);
  if (!response) throw new Error("The program does not respond");
  if (response.ok) return response;
  const text = (await response.text()).trim();
  throw new Error(text.split("\n")[0] || `The program responded with status ${response.status}`);
}

/** @param {string} path @param {any} body */
const askJson = async (path, body) => (await ask(path, "POST", JSON.stringify(body))).json();

export const parameters = async () => (await ask("./parameters")).json();

/** @param {string} kind @param {import("./store.js").ViewState} state */
export async function file(kind, state) {
  const response = await ask(`./files/${kind}`, "POST", JSON.stringify(state));
  const name = /filename="([^"]+)"/.exec(response.headers.get("content-disposition") ?? "")?.[1] ?? kind;
  return { name, blob: await response.blob() };
}

/** @param {string} text */
export const readWeather = async (text) => (await ask("./weather", "POST", text)).json();

/** @param {string} name */
export const thumbnail = (name) => `./thumbnails/${encodeURIComponent(name)}?${Date.now()}`;

/** @param {import("./store.js").ViewState} state */
export const linkOf = async (state) => (await (await ask("./link", "POST", JSON.stringify(state))).text()).trim();

/** @param {string} text */
export const stateOf = async (text) => (await ask("./unlink", "POST", text)).json();

/** The point of the nearest surface at a point of a picture. @param {{state: any, x: number, y: number}} question */
export const surface = (question) => askJson("./surface", question);

/** Changes facts of the scene. @param {any} change */
export const facts = (change) => askJson("./facts", change);

/** @param {{state: any, fps: number, seconds: number}} asked */
export const beginVideo = (asked) => askJson("./videos", asked);

/** @param {number} id */
export const video = async (id) => (await ask(`./videos/${id}`)).json();

/** @param {number} id */
export const stopVideo = (id) => ask(`./videos/${id}`, "DELETE");

/** @param {number} id */
export const videoFile = (id) => `./videos/${id}/file`;
