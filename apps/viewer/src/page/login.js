// The token that lets this page into the program. It comes from the fragment of the address, which
// reaches no server and no log, or is typed into a form; the program answers with a cookie that no
// script can read.

import { h } from "./dom.js";

/** The token in a fragment or an address; empty if there is none. @param {string} text */
const tokenOf = (text) => /(?:^|[#&?])token=([^&\s]+)/.exec(text)?.[1] ?? "";

/** Takes the token out of the address; the rest of the fragment, a link to a view, stays. */
function takeToken() {
  const fragment = location.hash.slice(1);
  const token = tokenOf(fragment);
  if (token) {
    const rest = fragment.split("&").filter((part) => !part.startsWith("token=")).join("&");
    history.replaceState(history.state, "", location.pathname + location.search + (rest ? `#${rest}` : ""));
  }
  return token;
}

/** Shows a token to the program; returns why it was refused, or an empty text. @param {string} token */
async function logIn(token) {
  const response = await fetch("./login", { method: "POST", body: token }).catch(() => null);
  if (!response) return "The program does not respond";
  return response.ok ? "" : (await response.text()).trim();
}

/** Ends the form, while it is shown. @type {(() => void) | null} */
let endForm = null;

/** Asks for the token until it is right. @returns {Promise<void>} */
function askForToken() {
  return new Promise((done) => {
    const said = h("p", { id: "login-said", role: "alert" });
    const field = h("input", { id: "token", type: "password", autocomplete: "off", required: true });
    const submit = async (/** @type {Event} */ event) => {
      event.preventDefault();
      const text = field.value.trim();
      said.textContent = await logIn(tokenOf(text) || text);
      if (said.textContent === "") endForm?.();
      else field.select();
    };
    const dialog = h("dialog", {
      id: "login", "aria-labelledby": "login-title",
      onkeydown: (/** @type {Event} */ event) => event.stopPropagation(),
      oncancel: (/** @type {Event} */ event) => event.preventDefault(),
      // Browsers close it at the second Escape all the same.
      onclose: () => endForm && dialog.showModal(),
    },
    h("form", { onsubmit: submit },
      h("h2", { id: "login-title" }, "This page needs a token"),
      h("p", { className: "quiet" }, "Open the address that the program printed, or paste it here."),
      h("div", { className: "row" }, h("label", { htmlFor: "token" }, "Token"), field, h("button", { className: "main" }, "Open")),
      said));
    endForm = () => {
      endForm = null;
      dialog.remove();
      done();
    };
    document.body.append(dialog);
    dialog.showModal();
  });
}

async function logInOrAsk() {
  const token = takeToken();
  if (token && (await logIn(token)) === "") return;
  // A program that is not there is for the caller to notice.
  const isIn = await fetch("./login").then((response) => response.json()).catch(() => true);
  if (isIn === false) await askForToken();
}

/** @type {Promise<void> | null} */
let entering = null;

/** Lets this page in; done once the program answers it, or cannot be reached. */
export function enter() {
  return (entering ??= logInOrAsk().finally(() => (entering = null)));
}

// The printed address, opened in a tab that shows this page already, changes the fragment alone.
addEventListener("hashchange", async (event) => {
  const token = takeToken();
  if (!token) return;
  if (!location.hash) event.stopImmediatePropagation();
  if ((await logIn(token)) === "") endForm?.();
});
