// A site in a single file: gives the files that the document holds, and starts its modules from
// Blob URLs. A classic script, as module files cannot be imported from file://. The scheme is
// described in backend-static.js.

/** @typedef {{has: (name: string) => boolean, bytes: (name: string) => Uint8Array | null, url: (name: string) => string}} Files */

(() => {
  /** @type {Map<string, Element>} */
  const elements = new Map();
  for (const element of document.querySelectorAll("script[data-name]")) elements.set(element.getAttribute("data-name") ?? "", element);
  /** @type {Map<string, string>} */
  const urls = new Map();
  /** @type {Record<string, string>} */
  const types = { js: "text/javascript", css: "text/css", jpg: "image/jpeg", mp4: "video/mp4", wasm: "application/wasm" };

  /** @param {string} name */
  function bytes(name) {
    const element = elements.get(name);
    if (!element) return null;
    const text = atob(element.textContent ?? "");
    const bytes = new Uint8Array(text.length);
    for (let at = 0; at < text.length; at += 1) bytes[at] = text.charCodeAt(at);
    return bytes;
  }

  /** The Blob URL of a file; of a module with those of its imports in it. @param {string} name @returns {string} */
  function url(name) {
    const known = urls.get(name);
    if (known) return known;
    const raw = bytes(name);
    if (!raw) return "";
    /** @type {any} */
    let part = raw;
    if (name.endsWith(".js")) {
      const text = new TextDecoder().decode(raw);
      part = text.replace(/(\bfrom\s+|\bawait import\()"\.\/([\w.-]+\.js)"/g, (all, start, other) => (elements.has(other) ? `${start}"${url(other)}"` : all));
    }
    const made = URL.createObjectURL(new Blob([part], { type: types[name.split(".").pop() ?? ""] ?? "application/octet-stream" }));
    urls.set(name, made);
    return made;
  }

  /** @type {Files} */
  const files = { has: (name) => elements.has(name), bytes, url };
  Object.defineProperty(globalThis, "WM_FILES", { value: files });
  const main = document.createElement("script");
  main.type = "module";
  main.src = url("main.js");
  document.head.append(main);
})();
