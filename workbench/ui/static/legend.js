// What the lines of pictures mean.

import { h } from "./dom.js";

/**
 * What the lines mean: a button each, which hides its curve; a pointer over it lets the curve stand out. Where the cursor
 * is, `values` of the element, called with texts by label, stand beside.
 */
export function legend(curves, plots, onchange = () => {}) {
  const places = new Map();
  const list = h("ul", { class: "legend" }, curves.map((c, i) => {
    const value = h("span", { class: "value" });
    places.set(c.label, value);
    const light = (on) => () => { for (const p of plots) { p.lit = on ? i : null; p.later(); } };
    const hide = (event) => {
      const away = !plots[0].hidden.has(c.label);
      for (const p of plots) {
        p.hidden[away ? "add" : "delete"](c.label);
        p.later();
      }
      event.currentTarget.setAttribute("aria-pressed", String(!away));
      onchange();
    };
    return h("li", {}, h("button", {
      type: "button", class: "bare", "aria-pressed": String(!plots[0].hidden.has(c.label)), title: "Hide or show this curve", onclick: hide,
      onpointerenter: light(true), onpointerleave: light(false), onfocus: light(true), onblur: light(false),
    }, h("span", { class: c.dash?.length ? "swatch dashed" : "swatch", style: `--own: var(${c.colour})` }), c.label), value);
  }));
  list.values = (texts) => { for (const [label, place] of places) place.textContent = texts?.get(label) ?? ""; };
  return list;
}
