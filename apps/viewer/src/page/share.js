// Links: the state in the fragment of the address. Opening one, and sharing what is shown.

import * as backend from "./backend.js";
import { $, h, toast } from "./dom.js";
import { Store } from "./store.js";
import { timesOf } from "./tracks.js";

/** Longest fragment that is looked at, characters. */
const LONGEST = 65536;

/** Gives a text to the clipboard; false where the browser does not let us. @param {string} text */
export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Pages without TLS and files have no clipboard but this.
    const box = h("textarea", { value: text, readOnly: true, ariaHidden: "true", className: "unseen" });
    const focused = /** @type {HTMLElement | null} */ (document.activeElement);
    ($("help").open ? $("help") : document.body).append(box);
    box.select();
    const isCopied = document.execCommand("copy");
    box.remove();
    focused?.focus();
    return isCopied;
  }
}

export class Links {
  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    /** @type {string | null} The fragment that is opened next. */
    this.next = null;
    this.isBusy = false;
    $("share").addEventListener("click", () => this.share());
    addEventListener("hashchange", () => this.open());
  }

  /** Makes the link of what is shown. */
  async share() {
    try {
      const fragment = await backend.linkOf(this.store.state);
      const link = `${location.href.split(/[?#]/)[0]}#${fragment}`;
      history.replaceState(null, "", link);
      toast((await copy(link)) ? "Link copied" : "The link is in the address bar", "note", "link");
    } catch (error) {
      toast(/** @type {Error} */ (error).message, "bad", "link");
    }
  }

  /** Opens the fragment of the address; of many only the last. */
  async open() {
    this.next = location.hash.slice(1);
    if (this.isBusy) return;
    this.isBusy = true;
    while (this.next !== null) {
      const fragment = this.next;
      this.next = null;
      if (fragment === "") continue;
      try {
        if (fragment.length > LONGEST) throw new Error(`the link has ${fragment.length} characters; at most ${LONGEST} are read`);
        this.show(await backend.stateOf(fragment));
      } catch (error) {
        toast(`This link cannot be opened: ${/** @type {Error} */ (error).message}`, "bad", "link");
      }
    }
    this.isBusy = false;
  }

  /** Shows a state; the picture's size and quality stay those of this page. @param {import("./store.js").ViewState} state */
  show(state) {
    const { store } = this;
    const before = store.state;
    store.play(false);
    try {
      store.set({ ...state, size: before.size, quality: before.quality });
    } catch (error) {
      // What this page cannot show must not stay.
      store.set(before);
      throw error;
    }
    const times = [state.time, ...state.path.map((key) => key.time), ...timesOf(state.weather)];
    const end = Math.max(...times.filter(Number.isFinite));
    if (end > store.duration) store.setDuration(end);
  }
}
