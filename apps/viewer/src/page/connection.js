// When a view is told: once a picture of the screen while something changes, and once more when it
// stops.

import { Store } from "./store.js";

/** Time without changes after which the whole picture is asked for, ms. */
const STILL = 160;

/**
 * @typedef {{seq: number, width: number, height: number, whole: boolean, time: number, draw_ms: number, encode_ms: number,
 *   splats: number, drops: number, mor: number | null, rain: number, snow: number, camera: import("./store.js").Pose,
 *   lidar: {error?: string, name: string, pulses: number, points: number, ms: number, classes: Object<string, number>} | null}} Head
 *
 * @typedef {{frame: (head: Head, picture: ImageBitmap | ImageData) => void, word: (word: any) => void, open: (open: boolean) => void}} Listener
 */

/** Sends views; what carries them is a subclass in backend.js. */
export class ViewSender {
  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    this.seq = 0;
    /** @type {any} What the renderer has of the weather. */
    this.sentWeather = null;
    this.wasMoving = false;
    this.dirty = false;
    const tick = () => {
      this.send();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  /** True if messages are received. */
  isOpen() {
    return false;
  }

  /** Sends a message. @param {any} _message */
  say(_message) {}

  /** Something changed. */
  touch() {
    this.dirty = true;
  }

  /** True if something is to be told yet. */
  isDue() {
    return this.dirty || this.wasMoving;
  }

  /** Tells what is wanted, once a picture of the screen. */
  send() {
    if (!this.isOpen() || !this.store.state) return;
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
}
