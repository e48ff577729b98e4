// Elements and numbers.

/**
 * An element with attributes, listeners (`onclick`, ...) and children.
 * @param {string} tag @param {Object<string, any>} [attributes] @param {...(Node | string | null | undefined)} children
 * @returns {any}
 */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key in element && key !== "list") /** @type {any} */ (element)[key] = value;
    else element.setAttribute(key, value === true ? "" : String(value));
  }
  element.append(...children.filter((child) => child !== null && child !== undefined).map((child) => /** @type {Node} */ (child)));
  return element;
}

/** A shape of SVG. @param {string} tag @param {Object<string, string | number>} attributes @param {string} [text] @returns {SVGElement} */
export function shape(tag, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  if (text) element.textContent = text;
  return element;
}

/** The element of an id, which is there. @param {string} id @returns {any} */
export function $(id) {
  return /** @type {any} */ (document.getElementById(id));
}

/** A number with at most `digits` that count. @param {number} value @param {number} [digits] */
export function short(value, digits = 3) {
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "–";
  if (value !== 0 && Math.abs(value) < 1e-4) return value.toExponential(1);
  return String(Number(value.toPrecision(digits)));
}

/** A count as people read it. @param {number} value */
export function count(value) {
  if (value >= 1e6) return `${short(value / 1e6)} M`;
  return value >= 1e4 ? `${Math.round(value / 1e3)} k` : String(value);
}

/** A length. @param {number | null} metres */
export function metres(metres) {
  if (metres === null || !Number.isFinite(metres)) return "∞";
  return metres >= 1000 ? `${short(metres / 1000, 2)} km` : `${short(metres, 3)} m`;
}

/** Most lines that are said at once, and their longest, characters. */
const [LINES, LONGEST] = [4, 300];

/**
 * Says something for a while. A line about something replaces the last one about it.
 * @param {string} text @param {"note" | "bad"} [kind] @param {string} [about]
 */
export function toast(text, kind = "note", about) {
  let box = $("toasts");
  if (!box) document.body.append((box = h("div", { id: "toasts", role: "status" })));
  const words = text.length > LONGEST ? `${text.slice(0, LONGEST)} …` : text;
  const lines = /** @type {HTMLElement[]} */ ([...box.children]);
  if (about) lines.filter((line) => line.dataset.about === about && line.textContent !== words).forEach((line) => line.remove());
  if (lines.some((line) => line.isConnected && line.textContent === words)) return;
  while (box.children.length >= LINES) box.firstElementChild.remove();
  const line = h("div", { className: kind, "data-about": about }, words);
  line.addEventListener("click", () => line.remove());
  box.append(line);
  setTimeout(() => line.remove(), kind === "bad" ? 9000 : 3500);
}

/**
 * Makes one stop of the Tab key of some controls; the arrows, Home and End go among them.
 * @param {HTMLElement} root @param {() => HTMLElement[]} controls @param {(control: HTMLElement) => void} [onGo]
 * @returns {(control: HTMLElement) => void} Sets the control that the Tab key reaches.
 */
export function roving(root, controls, onGo) {
  const stop = (/** @type {HTMLElement} */ control) => controls().forEach((other) => (other.tabIndex = other === control ? 0 : -1));
  root.addEventListener("keydown", (event) => {
    const all = controls();
    const at = all.indexOf(/** @type {HTMLElement} */ (event.target));
    if (at < 0 || event.ctrlKey || event.altKey || event.metaKey) return;
    const top = all[0].offsetTop;
    const columns = Math.max(1, all.filter((control) => control.offsetTop === top).length);
    const isGrid = columns < all.length;
    /** @type {Record<string, number>} */
    const ways = { ArrowRight: at + 1, ArrowLeft: at - 1, ArrowDown: isGrid ? at + columns : at + 1, ArrowUp: isGrid ? at - columns : at - 1, Home: 0, End: all.length - 1 };
    const to = ways[event.key];
    if (to === undefined) return;
    event.preventDefault();
    // Up and down end at the edge of a grid; a row goes round.
    const control = isGrid ? all[to] : all[(to + all.length) % all.length];
    if (!control) return;
    stop(control);
    control.focus();
    onGo?.(control);
  });
  root.addEventListener("focusin", (event) => controls().includes(/** @type {HTMLElement} */ (event.target)) && stop(/** @type {HTMLElement} */ (event.target)));
  const first = controls()[0];
  if (first) stop(first);
  return stop;
}
