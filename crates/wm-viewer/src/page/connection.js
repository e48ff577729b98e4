// The WebSocket: what is wanted goes out, pictures and words come in. It comes back by itself.

import { Store } from "./store.js";

/** How long nothing must change for the whole picture to be asked for, ms. */
const STILL = 160;
/** How long until the next try after the connection broke, ms. */
const AGAIN = 1000;

/**
 * @typedef {{seq: number, width: number, height: number, whole: boolean, time: number, draw_ms: number, encode_ms: number,
 *   splats: number, drops: number, mor: number | null, rain: number, snow: number, camera: import("./store.js").Pose,
 *   lidar: {error?: string, name: string, pulses: number, points: number, ms: number, classes: Object<string, number>} | null}} Head
 */

export class Connection {
  /**
   * @param {Store} store
   * @param {{frame: (head: Head, picture: ImageBitmap) => void, word: (word: any) => void, open: (open: boolean) => void}} on
   */
  constructor(store, on) {
    this.store = store;
    this.on = on;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.seq = 0;
    /** @type {any} What the program has of the weather. */
    this.sentWeather = null;
    this.wasMoving = false;
    this.dirty = false;
    this.shown = 0;
    this.connect();
    const tick = () => {
      this.send();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  connect() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      [this.socket, this.sentWeather, this.dirty] = [socket, null, true];
      this.on.open(true);
    };
    socket.onclose = () => {
      if (this.socket === socket) this.on.open(false);
      this.socket = null;
      setTimeout(() => this.connect(), AGAIN);
    };
    socket.onmessage = (event) => {
      if (typeof event.data === "string") this.on.word(JSON.parse(event.data));
      else this.receive(event.data);
    };
  }

  /** @param {ArrayBuffer} message */
  async receive(message) {
    const length = new DataView(message).getUint32(0, true);
    /** @type {Head} */
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

  /** Something changed. */
  touch() {
    this.dirty = true;
  }

  /** Whether something is to be told yet. */
  isDue() {
    return this.dirty || this.wasMoving;
  }

  /** Tells what is wanted, once a picture of the screen. */
  send() {
    if (!this.socket || !this.store.state) return;
    const isMoving = this.store.isPlaying || performance.now() - this.store.changedAt < STILL;
    if (!this.dirty && isMoving === this.wasMoving) return;
    // While it moves only changes are worth a message; when it stops one more is.
    if (!this.dirty && isMoving) return;
    const { weather, ...rest } = this.store.state;
    const state = weather === this.sentWeather ? rest : this.store.state;
    this.seq += 1;
    this.say({ type: "view", seq: this.seq, moving: isMoving, state });
    [this.sentWeather, this.wasMoving, this.dirty] = [weather, isMoving, false];
  }

  /** @param {any} message */
  say(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}
