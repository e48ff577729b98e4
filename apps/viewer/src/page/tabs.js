// The tabs of the panel; on a phone they open it as a sheet.

import { $, roving } from "./dom.js";

export function tabs() {
  const list = /** @type {HTMLElement} */ (document.querySelector("[role=tablist]"));
  const all = () => /** @type {HTMLElement[]} */ ([...list.querySelectorAll("[role=tab]")]);
  const isPhone = matchMedia("(max-width: 760px)");
  /** @param {HTMLElement} tab @param {boolean} isSheet */
  const select = (tab, isSheet) => {
    for (const other of all()) {
      other.setAttribute("aria-selected", String(other === tab));
      $(`tab-${other.dataset.tab}`).hidden = other !== tab;
    }
    document.body.classList.toggle("sheet", isSheet);
    stop(tab);
    tell();
  };
  // On a phone it is to be heard, too, that a tab opens something.
  const tell = () => {
    for (const tab of all()) {
      if (isPhone.matches) tab.setAttribute("aria-expanded", String(tab.getAttribute("aria-selected") === "true" && document.body.classList.contains("sheet")));
      else tab.removeAttribute("aria-expanded");
    }
  };
  const stop = roving(list, all, (tab) => select(tab, true));
  for (const tab of all()) {
    // A second touch puts the sheet away.
    tab.addEventListener("click", () => select(tab, !(tab.getAttribute("aria-selected") === "true" && document.body.classList.contains("sheet"))));
  }
  isPhone.addEventListener("change", tell);
  tell();
  addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || event.defaultPrevented || $("help").open || !isPhone.matches || !document.body.classList.contains("sheet")) return;
    document.body.classList.remove("sheet");
    tell();
    all().find((tab) => tab.getAttribute("aria-selected") === "true")?.focus();
  });
}
