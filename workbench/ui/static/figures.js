// What a loop has come to, in numbers, beside what is wanted of it.

import { h } from "./dom.js";
import { shown } from "./numbers.js";

export const TONES = { stable: "good", unstable: "bad" };
const MET = 1e-4; // relative: by so much less than what is wanted is met, to the digits that are shown

/** Label, how to read it from a design {margins, step}, its unit, and by which name it is wanted. */
const ROWS = [
  ["Gain margin", (d) => d.margins.gain_margin_db, "dB", "db"], ["Phase margin", (d) => d.margins.phase_margin_deg, "°", "deg"],
  ["Delay margin", (d) => (d.margins.delay_margin_s === null ? null : 1e3 * d.margins.delay_margin_s), "ms"],
  ["Crossover", (d) => d.margins.gain_crossovers.at(-1)?.frequency_hz ?? null, "Hz", "hz"], ["Overshoot", (d) => (d.step ? overshoot(d.step) : undefined), "%"],
];

/** Numbers of a design, below each those of `others` {label, margins, step}, in the tone of `least` {db, deg, hz}. */
export function figures(found, others, least) {
  const tone = (value, wanted) => (!wanted || value === null ? "" : Math.abs(value) >= wanted * (1 - MET) ? "good" : "bad"); // a phase margin with a minus is a lead, and as far
  return ROWS.map(([label, of, unit, key]) => h("div", {}, h("span", { class: "dim" }, label), h("span", { class: `figure ${tone(of(found), least[key])}` }, shown(of(found), 3), h("span", { class: "unit" }, ` ${unit}`)),
    others.map((d) => (of(d) === undefined ? null : h("span", { class: "dim", title: of(d) === null ? "Not in the band that was looked at" : "" }, `${d.label} `, h("span", { class: tone(of(d), least[key]) }, shown(of(d), 3)))))));
}

function overshoot({ time, value, left_s: left }) {
  if (left !== null || !time.length) return null;
  const end = value.at(-1);
  return end ? Math.max(0, 100 * (Math.max(...value.map((v) => v / end)) - 1)) : null;
}
