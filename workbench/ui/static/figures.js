// What a loop has come to, in numbers, beside what is wanted of it.

import { h } from "./dom.js";
import { shown } from "./numbers.js";

export const TONES = { stable: "good", unstable: "bad" };
const MET = 1e-4; // relative: by so much less than what is wanted is met, to the digits that are shown

/** Label, how to read it from a design {margins, step?, ends?}, its unit, and by which name it is wanted. */
const ROWS = [
  ["Gain margin", (d) => d.margins.gain_margin_db, "dB", "db"], ["Phase margin", (d) => d.margins.phase_margin_deg, "°", "deg"],
  ["Delay margin", (d) => (d.margins.delay_margin_s === null ? null : 1e3 * d.margins.delay_margin_s), "ms"],
  ["Crossover", (d) => d.margins.gain_crossovers.at(-1)?.frequency_hz ?? null, "Hz", "hz"], ["Overshoot", (d) => (d.step ? overshoot(d.step) : undefined), "%"],
];

/** Numbers of a design, below each those of `others` {label, margins, step}, in the tone of `least` {db, deg, hz}. */
export function figures(found, others, least) {
  return ROWS.map(([label, of, unit, key]) => {
    const cell = (d) => figure(d, of(d), least[key], key);
    const own = cell(found);
    return h("div", {}, h("span", { class: "dim" }, label), h("span", { class: `figure ${own.tone}` }, own.text, h("span", { class: "unit" }, ` ${unit}`)),
      others.filter((d) => of(d) !== undefined).map((d) => [d, cell(d)]).map(([d, { text, tone, title }]) => h("span", { class: "dim", title }, `${d.label} `, h("span", { class: tone }, text))));
  });
}

/** What is shown of a value of a design, and its tone: nothing that is wanted of an unstable loop is met. */
export function figure(design, value, wanted, key) {
  const { ends, margins: { closed_loop: word } } = design;
  if (value === null && ends) return unseen(ends, wanted, key);
  const enough = Math.abs(value) >= wanted * (1 - MET); // a phase margin with a minus is a lead, and as far
  const tone = !wanted || value === null ? "" : word === "unstable" || !enough ? "bad" : word === "stable" ? "good" : "";
  return { text: shown(value, 3), tone, title: "" };
}

/** The same of what a measurement has not found between the `ends` {hz, gain} of its band: a crossover is beyond one. */
function unseen([low, high], wanted, key) {
  const title = `Measured from ${shown(low.hz, 3)} to ${shown(high.hz, 3)} Hz`;
  const none = { text: "not known", tone: wanted ? "watch" : "", title };
  if (key !== "hz") return none;
  if (low.gain < 1) return { ...none, text: `below ${shown(low.hz, 3)} (not measured)`, tone: wanted >= low.hz ? "bad" : none.tone };
  return high.gain > 1 ? { ...none, text: `above ${shown(high.hz, 3)} (not measured)`, tone: wanted && wanted <= high.hz ? "good" : none.tone } : none;
}

/** The first and the last point of a measured loop that have a value, {hz, gain}; null: none has. */
export function endsOf(points) {
  const known = points.filter((p) => p.value).map((p) => ({ hz: p.frequency_hz, gain: Math.hypot(...p.value) })).sort((a, b) => a.hz - b.hz);
  return known.length ? [known[0], known.at(-1)] : null;
}

function overshoot({ time, value, left_s: left }) {
  if (left !== null || !time.length) return null;
  const end = value.at(-1);
  return end ? Math.max(0, 100 * (Math.max(...value.map((v) => v / end)) - 1)) : null;
}
