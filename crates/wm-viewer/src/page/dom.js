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

/** Says something for a while. @param {string} text @param {"note" | "bad"} [kind] */
export function toast(text, kind = "note") {
  let box = $("toasts");
  if (!box) document.body.append((box = h("div", { id: "toasts", role: "alert" })));
  if ([...box.children].some((child) => child.textContent === text)) return;
  const line = h("div", { className: kind }, text);
  line.addEventListener("click", () => line.remove());
  box.append(line);
  setTimeout(() => line.remove(), kind === "bad" ? 9000 : 3500);
}
