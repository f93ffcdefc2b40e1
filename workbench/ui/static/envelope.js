// The map of an envelope: its points over two parameters, in the colours of their margins.

import { fill, h, table } from "./dom.js";
import { shown, unitShown, withUnit } from "./numbers.js";
import { Plot, ramp } from "./plot.js";

const SHADES = 8; // of margins that are met

/** Points over the axes of the map, one picture a failure; a click on one says all that is known of it. */
export function envelopeMap({ axes, points, failures, parameters, unit, requirement }) {
  const [first, second] = axes;
  const label = (name) => `${name} [${unitShown(parameters.find((p) => p.name === name)?.unit) || "–"}]`;
  const place = h("div", { role: "status" }, h("p", { class: "dim" }, "Click a point."));
  const most = Math.max(0, ...points.map((p) => p.margin ?? 0));
  const shade = (p) => (p.passed === null ? null : p.margin === null ? (p.passed ? SHADES - 1 : -1) : p.margin < 0 ? -1 : Math.min(SHADES - 1, Math.floor((SHADES * p.margin) / (most || 1))));
  const maps = (failures.length ? failures : [null]).map((failure) => {
    const own = points.filter((p) => p.failure === failure);
    const plot = new Plot({ x: { label: label(first), log: false }, y: { label: second ? label(second) : `${requirement} [${unitShown(unit) || "–"}]`, log: false }, label: `Envelope${failure ? `, ${failure}` : ""}. Arrow keys go from point to point, Enter picks one.`, height: 0.4, onpick: (p) => p && say(p) });
    const group = (name, own, ink, mark) => ({ label: name, colour: ink, x: own.map((p) => p.values[first]), y: own.map((p) => (second ? p.values[second] : p.value)), line: false, marks: own.map(() => mark), points: own, says: own.map((p) => (p.margin === null ? p.reason || p.where : `margin ${withUnit(shown(p.margin, 4), unit)}`)), size: 6 });
    plot.set([
      group("not measured", own.filter((p) => shade(p) === null), "--dim", "cross"), group("violated", own.filter((p) => shade(p) === -1), "--bad", "square"),
      ...Array.from({ length: SHADES }, (_, k) => group("met", own.filter((p) => shade(p) === k), ramp(SHADES - 1 - k, SHADES), "dot")),
    ].filter((c) => c.x.length));
    return h("div", {}, failure ? h("h3", {}, failure) : null, plot.element);
  });
  // Much or little only a person can say: the ends of the colours are told as they are.
  const met = most ? [["met, margin 0", ramp(SHADES - 1, SHADES)], [`met, margin ${withUnit(shown(most, 3), unit)}`, ramp(0, SHADES)]] : [["met", ramp(0, SHADES)]];
  function say(p) {
    fill(place, h("h3", {}, p.failure ?? "Point"), p.passed === null ? h("p", { class: "bad" }, p.reason) : h("p", {}, h("strong", { class: p.passed ? "good" : "bad" }, p.passed ? "met" : "violated"), ` ${withUnit(shown(p.value), unit)} ${p.where}`),
      table(["parameter", "value"], Object.entries(p.values).map(([n, v]) => [n, shown(v)]), { caption: p.margin === null ? "" : `Margin ${withUnit(shown(p.margin, 4), unit)}` }));
  }
  return h("section", {}, h("ul", { class: "legend" }, [["violated", "--bad"], ...met, ["not measured", "--dim"]].map(([name, ink]) => h("li", {}, h("span", { class: "swatch", style: `--own: var(${ink})` }), name))),
    h("div", { class: "beside" }, h("div", {}, maps), place));
}
