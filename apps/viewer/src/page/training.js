// A training while it runs: asks once a second, draws curves.

import { $, count, h, shape, short } from "./dom.js";
import { enter } from "./login.js";

/** @typedef {{dataset: string, photo: string, step: number, steps: number, splats: number, seconds: number, loss: number[][],
 *   held_out: number[][], shown: number[][], camera: string, picture: number | null, end: string | null}} Told */

/** Size of a curve, in its own units. */
const [WIDTH, HEIGHT, LEFT, BELOW] = [290, 150, 38, 16];

/**
 * Curves over steps on common axes.
 * @param {Element} root @param {{name: string, points: number[][]}[]} curves @param {number} steps @param {boolean} isLog
 */
function draw(root, curves, steps, isLog) {
  const all = curves.flatMap((curve) => curve.points.map((point) => point[1])).filter(Number.isFinite);
  root.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  root.replaceChildren();
  if (all.length === 0) return;
  const scale = (/** @type {number} */ v) => (isLog ? Math.log(Math.max(v, 1e-9)) : v);
  let [least, most] = [Math.min(...all), Math.max(...all)].map(scale);
  if (most - least < 1e-6) [least, most] = [least - 0.5, most + 0.5];
  const x = (/** @type {number} */ step) => LEFT + ((WIDTH - LEFT - 4) * step) / Math.max(steps, 1);
  const y = (/** @type {number} */ value) => 6 + ((HEIGHT - BELOW - 12) * (most - scale(value))) / (most - least);
  for (let i = 0; i <= 3; i += 1) {
    const value = least + ((most - least) * i) / 3;
    const shown = isLog ? Math.exp(value) : value;
    root.append(
      shape("line", { x1: LEFT, x2: WIDTH - 4, y1: y(shown), y2: y(shown), class: "grid" }),
      shape("text", { x: LEFT - 5, y: y(shown) + 3.5, "text-anchor": "end" }, short(shown, 3)));
  }
  root.append(shape("text", { x: LEFT, y: HEIGHT - 3 }, "0"), shape("text", { x: WIDTH - 4, y: HEIGHT - 3, "text-anchor": "end" }, `${count(steps)} steps`));
  for (const { name, points } of curves) {
    const line = points.map(([step, value], index) => `${index ? "L" : "M"}${x(step).toFixed(1)} ${y(value).toFixed(1)}`).join("");
    if (line) root.append(shape("path", { d: line, class: `line ${name}` }));
    const last = points.at(-1);
    if (last) root.append(shape("circle", { cx: x(last[0]), cy: y(last[1]), r: 2.5, class: `dot ${name}` }));
  }
}

/** @param {number} seconds */
function clock(seconds) {
  const whole = Math.round(seconds);
  return whole >= 3600 ? `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min` : whole >= 60 ? `${Math.floor(whole / 60)} min ${whole % 60} s` : `${whole} s`;
}

/** @type {number | null} */
let picture = null;

/** @param {Told} told */
function show(told) {
  $("scene-name").textContent = told.dataset;
  $("scene-about").textContent = told.photo;
  $("training-progress").value = told.step / Math.max(told.steps, 1);
  const left = told.step > 0 ? (told.seconds * (told.steps - told.step)) / told.step : NaN;
  const figure = (/** @type {string} */ value, /** @type {string} */ name) => h("span", {}, h("b", {}, value), ` ${name}`);
  $("training-stats").replaceChildren(
    figure(`${count(told.step)} / ${count(told.steps)}`, "steps"), figure(count(told.splats), "splats"), figure(clock(told.seconds), "so far"),
    ...(Number.isFinite(left) && !told.end ? [figure(clock(left), "left")] : []));
  draw($("loss"), [{ name: "a", points: told.loss }], told.steps, true);
  draw($("psnr"), [{ name: "a", points: told.shown }, { name: "b", points: told.held_out }], told.steps, false);
  $("psnr-legend").replaceChildren("dB: ", h("i", { className: "a" }), `${told.photo} `, ...(told.held_out.length ? [h("i", { className: "b" }), "held-out photos, mean"] : []));
  for (const name of ["photo", "orbit"]) $(`camera-${name}`).setAttribute("aria-pressed", String(name === told.camera));
  document.title = `${Math.floor((100 * told.step) / Math.max(told.steps, 1))} % – ${told.dataset}`;
  const key = told.picture === null ? null : told.picture;
  if (key !== picture) {
    picture = key;
    $("training-picture").src = `./training/picture?step=${key}`;
    [$("training-picture").hidden, $("training-note").hidden] = [false, true];
  }
  if (told.end) ended(told.end);
}

/** @param {string} text */
function ended(text) {
  $("end")?.remove();
  $("stage").append(h("div", { id: "end", role: "status" }, text));
}

let isOver = false;

async function ask() {
  try {
    let response = await fetch("./training");
    if (response.status === 401) response = await enter().then(() => fetch("./training"));
    if (!response.ok) throw new Error(await response.text());
    const told = await response.json();
    show(told);
    isOver = told.end !== null;
  } catch {
    if (!isOver) ended("The program does not respond: the training has ended or was stopped.");
  }
  if (!isOver) setTimeout(ask, 1000);
}

for (const name of ["photo", "orbit"]) {
  $(`camera-${name}`).addEventListener("click", () => fetch("./training/camera", { method: "PUT", body: JSON.stringify(name) }));
}
enter().then(ask);
