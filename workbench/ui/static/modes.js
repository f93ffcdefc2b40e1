// Modes of a linear model: its poles in the plane; the one that is clicked says which states take part.

import { fill, h, table } from "./dom.js";
import { locusRanges, shown } from "./numbers.js";
import { Plot, colour } from "./plot.js";

const REACH = 3; // times the least damped pole is what the map shows

/** A map of poles and the participation of the states in the one that is chosen; the least damped one at first. */
export function modesOf(modes) {
  const turning = modes.flatMap((m) => (m.im ? [m, { ...m, im: -m.im }] : [m]));
  const place = h("div", { role: "status" });
  const plot = new Plot({ x: { label: "real part [1/s]", log: false }, y: { label: "imaginary part [1/s]", log: false }, label: "Poles of the linear model. Arrow keys go from pole to pole, Enter picks one.", height: 0.36, onpick: (mode) => mode && show(mode) });
  const unstable = modes.some((m) => m.re > 0);
  const first = [...modes].sort((a, b) => a.damping - b.damping)[0];
  const size = REACH * Math.hypot(first.re, first.im);
  const beyond = modes.filter((m) => Math.hypot(m.re, m.im) > size).length;
  if (beyond && size) [plot.x.range, plot.y.range] = locusRanges({ re: modes.map((m) => m.re), im: modes.map((m) => m.im) }, size);
  plot.set([{ label: "pole", colour: colour(unstable ? 6 : 0), x: turning.map((m) => m.re), y: turning.map((m) => m.im), line: false, marks: turning.map(() => "cross"), points: turning, says: turning.map((m) => `${shown(m.hz, 4)} Hz, damping ${shown(m.damping, 3)}`) }], { lines: [{ axis: "x", value: 0 }] });
  function show(mode) {
    const pole = mode.im ? `${shown(mode.re, 4)} ± ${shown(Math.abs(mode.im), 4)}j` : shown(mode.re, 4);
    fill(place, h("h3", {}, `Mode at ${shown(mode.hz, 4)} Hz`), h("p", { class: "dim" }, `${pole} 1/s, damping ratio ${shown(mode.damping, 3)}`),
      table(["state", "share [%]"], mode.states.map(([name, share]) => [name, shown(100 * share, 3)]), { caption: "States that take part" }));
  }
  show(first);
  return h("section", {}, h("h2", {}, "Poles"), h("div", { class: "beside" }, h("div", {}, plot.element, beyond && size ? h("p", { class: "dim" }, `${beyond} faster ${beyond > 1 ? "poles lie" : "pole lies"} outside; the table has all.`) : null), place));
}
