// What is looked at, and who wants to know when it changes.

/**
 * A camera's place: centre, camera_from_world as wxyz (OpenCV axes), vertical field of view in degrees.
 * @typedef {{eye: number[], rotation: number[], fov: number}} Pose
 *
 * A value of a parameter: a number, a word, a colour, or keyframes.
 * @typedef {number | string | number[] | {keys: Array<[number, any] | [number, any, string]>}} Track
 *
 * @typedef {{name: string, kind: string, words: string[], default: any, least: number | string,
 *   greatest: number | string, unit: string, meaning: string}} Param
 * @typedef {{name: string, about: string, role: string, params: Param[]}} Effect
 * @typedef {{name: string, about: string, weather: Object<string, any>}} Preset
 * @typedef {{name: string, splats: number, up: number[], center: number[], radius: number, ground: number,
 *   metres_per_unit: number, has_scale: boolean, up_confidence: string, unsaved: boolean, renderer: string, views: {name: string, camera: Pose}[]}} Scene
 * @typedef {{program: string, scene: Scene, state: ViewState, outputs: string[], easings: string[],
 *   effects: Effect[], presets: Preset[], panoramas: string[], video: boolean, lidars: {name: string, about: string}[], returns: string[]}} Parameters
 *
 * A lidar: a preset, and where it stands, at the camera if null.
 * @typedef {{model: string, at: {eye: number[], target: number[]} | null, sub_rays: number, returns: string, colors: string}} LidarState
 *
 * The same as in the program and over HTTP.
 * @typedef {{camera: Pose, path: (Pose & {time: number})[], follow: "camera" | "path",
 *   weather: Object<string, any>, time: number, output: string, size: number[], quality: number,
 *   divider: number | null, lidar: LidarState | null}} ViewState
 */

export class Store {
  constructor() {
    /** @type {Parameters} */
    this.parameters = /** @type {any} */ (null);
    /** @type {ViewState} */
    this.state = /** @type {any} */ (null);
    /** Length of the timeline, seconds. */
    this.duration = 5;
    /** @type {Set<(changed: Set<string>) => void>} */
    this.listeners = new Set();
    /** When something last changed. */
    this.changedAt = 0;
    /** True while it goes on changing by itself. */
    this.isPlaying = false;
  }

  /** @param {(changed: Set<string>) => void} listener */
  listen(listener) {
    this.listeners.add(listener);
  }

  /**
   * Changes fields of the state; `weather` must be a new object where it is another.
   * @param {Partial<ViewState>} patch
   */
  set(patch) {
    const changed = new Set(Object.keys(patch).filter((key) => /** @type {any} */ (this.state)[key] !== /** @type {any} */ (patch)[key]));
    if (changed.size === 0) return;
    this.state = { ...this.state, ...patch };
    this.changedAt = performance.now();
    this.tell(changed);
  }

  /** @param {Iterable<string>} changed */
  tell(changed) {
    const all = new Set(changed);
    for (const listener of this.listeners) listener(all);
  }

  /** @param {number} seconds */
  setDuration(seconds) {
    this.duration = Math.min(Math.max(seconds, 0.1), 3600);
    this.tell(["duration"]);
  }

  /** @param {boolean} playing */
  play(playing) {
    this.isPlaying = playing;
    this.changedAt = performance.now();
    this.tell(["playing"]);
  }

  /**
   * Sets a parameter, which turns its effect on.
   * @param {string} effect @param {string} param @param {Track | undefined} track
   */
  setParam(effect, param, track) {
    const values = { ...(this.state.weather[effect] ?? {}) };
    if (track === undefined) delete values[param];
    else values[param] = track;
    this.setWeather({ ...this.state.weather, [effect]: values });
  }

  /** @param {string} effect @param {boolean} on */
  turn(effect, on) {
    const { [effect]: old, ...others } = this.state.weather;
    if (on === (old !== undefined)) return;
    this.setWeather(on ? { ...others, [effect]: {} } : others);
  }

  /** A weather that was changed is no preset any more. @param {Object<string, any>} weather */
  setWeather(weather) {
    const isPreset = this.parameters.presets.some((preset) => preset.name === weather.name);
    const named = isPreset ? { ...weather, name: `my-${weather.name}`, about: "" } : { ...weather };
    if (named.name === "my-clear") named.name = "mine";
    if (!named.about) delete named.about;
    this.set({ weather: named });
  }
}
