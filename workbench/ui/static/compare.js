// Curves of the runs that are ticked, and by how much two differ; the responses of a store.

import { get } from "./api.js";
import { Bode } from "./bode.js";
import { fill, h, table } from "./dom.js";
import { difference, shown } from "./numbers.js";
import { isOverlaid, onOverlays, overlaid, overlay } from "./overlays.js";
import { Plot, colour } from "./plot.js";

export async function comparePage([store]) {
  if (store) return storePage(store);
  let kept = [];
  const bode = new Bode({ title: "Ticked runs.", heights: [0.27, 0.22] });
  const none = h("p", { class: "dim" }, "Tick runs in the list: their curves meet here, and lie over every picture.");
  const place = h("div");
  const [first, second] = [h("select", { id: "first", onchange: differ }), h("select", { id: "second", onchange: differ })];
  function differ() {
    const [a, b] = [kept[Number(first.value)], kept[Number(second.value)]];
    if (!a || !b || a === b) {
      fill(place, h("p", { class: "dim" }, kept.length > 1 ? "Choose two different curves." : "Tick another run to see the difference."));
      return;
    }
    const found = difference(a, b);
    if (!found.length) {
      fill(place, h("p", {}, "They have no frequencies in common."));
      return;
    }
    const worst = (k) => found.reduce((m, d) => (Math.abs(d[k]) > Math.abs(m[k]) ? d : m));
    const plots = [["db", "difference of gain [dB]"], ["deg", "difference of phase [deg]"]].map(([k, label]) => {
      const plot = new Plot({ x: { label: "frequency [Hz]", log: true }, y: { label, log: false }, label, height: 0.2 });
      plot.set([{ label, colour: colour(0), x: found.map((d) => d.f), y: found.map((d) => d[k]), marks: found.map(() => "dot") }], { lines: [{ axis: "y", value: 0 }] });
      return plot.element;
    });
    fill(place, h("p", {}, `${b.label} compared with ${a.label}: at most ${shown(worst("db").db, 3)} dB at ${shown(worst("db").f, 4)} Hz and ${shown(worst("deg").deg, 3)} deg at ${shown(worst("deg").f, 4)} Hz.`), plots,
      table(["frequency [Hz]", "gain [dB]", "phase [deg]"], found.map((d) => [shown(d.f), shown(d.db, 4), shown(d.deg, 4)]), { caption: "Difference" }));
  }
  function choices() {
    kept = overlaid();
    inner.hidden = !kept.length;
    none.hidden = Boolean(kept.length);
    const [a, b] = [first.value, second.value];
    for (const select of [first, second]) fill(select, kept.map((c, i) => h("option", { value: i }, c.label)));
    if (kept.length > 1) [first.value, second.value] = a && b && a !== b && kept[a] && kept[b] ? [a, b] : ["0", "1"];
    differ();
  }
  const inner = h("div", {}, bode.bar(), bode.element, h("h2", {}, "Difference of two"), h("div", { class: "row" }, h("label", { for: "first" }, "From"), first, h("label", { for: "second" }, "to"), second), place);
  bode.show([]);
  choices();
  const end = onOverlays(choices);
  return {
    title: "Compare",
    leave: () => { end(); bode.leave(); },
    element: h("div", {}, h("h1", {}, "Compare"), none, inner),
  };
}

/** The responses that a store holds, as they were measured. */
async function storePage(name) {
  const { curves, notes } = await get(`/api/store?name=${encodeURIComponent(name)}`);
  const bode = new Bode({ title: `Store ${name}.`, key: name });
  bode.show(curves);
  const settings = new Map(curves.map((c) => [c.label.split(":")[0], c.settings]));
  const tick = h("input", { type: "checkbox", checked: isOverlaid(name), onchange: () => overlay(name, name, tick.checked ? curves : null) });
  return {
    title: name,
    leave: () => bode.leave(),
    element: h("div", {}, h("h1", {}, `Store ${name}`), h("p", { class: "dim" }, `${curves.length} responses, as they were measured.`), h("label", { class: "row" }, tick, "Lay them over other pictures"), notes.map((note) => h("p", { class: "watch" }, note)), bode.bar(), bode.element,
      [...settings].map(([label, s]) => h("details", {}, h("summary", {}, label), table(["setting", "value"], Object.entries(s).map(([k, v]) => [k, typeof v === "object" ? JSON.stringify(v) : String(v)]))))),
  };
}
