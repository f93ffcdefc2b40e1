// What a point of a frequency response knows, and signals over time.

import { done, server, whole } from "./api.js";
import { code, fill, h, table, wrongs } from "./dom.js";
import { decibels, shown, unitShown, wrapped } from "./numbers.js";
import { histories } from "./panels.js";

/** Everything that is known of a point: what it is worth, harmonics, multipliers, neighbours; and what can be asked. */
export function pointOf({ curve, index }, picture) {
  const f = curve.frequency_hz[index];
  const [re, im] = [curve.re[index], curve.im[index]];
  const told = curve.points?.[index];
  const unit = unitShown(curve.output_unit);
  const ratio = curve.output_unit && curve.input_unit && curve.output_unit !== curve.input_unit ? ` ${unit}/${unitShown(curve.input_unit)}` : "";
  const rows = [
    ["frequency", `${shown(f)} Hz`], ["curve", curve.label], ["gain", re === null ? "–" : `${shown(decibels(re, im))} dB, ${shown(Math.hypot(re, im))}${ratio}`],
    ["phase", re === null ? "–" : `${shown(wrapped([{ re, im }])[0])} deg`], ["error, 95 %", curve.error?.[index] === undefined ? null : curve.error[index] === null ? "not known" : `${shown(100 * curve.error[index], 3)} %`],
    ["stable", curve.stable ? shown(curve.stable[index] === null ? null : Boolean(curve.stable[index])) : null], ["status", curve.status?.[index]],
  ];
  const certificate = told?.certificate;
  if (told) rows.push(["periods run", shown(told.periods)], ["offset", curve.offset ? `${curve.offset[index]} ${unit}` : null], ["why it failed", told.reason], ["remark", told.warning]);
  if (certificate) rows.push(["method", certificate.method], ["total harmonic distortion", certificate.thd === null ? null : `${shown(100 * certificate.thd, 3)} %`], ["distance to a fold", certificate.fold_distance === null ? null : shown(certificate.fold_distance, 3)], ["gain of another periodic response", certificate.other_gain === null ? null : shown(certificate.other_gain, 4)], ["why it did not settle", certificate.why]);
  const beside = neighbours(curve, index);
  const run = h("div");
  return h("div", {},
    h("h2", {}, `Point at ${shown(f)} Hz`),
    h("div", { class: "cards" },
      h("dl", {}, rows.filter(([, v]) => v !== null && v !== undefined && v !== "").flatMap(([k, v]) => [h("dt", {}, k), h("dd", {}, v)])),
      certificate?.harmonics?.some((x) => x !== null) ? table(["harmonic", "of the fundamental [%]"], certificate.harmonics.map((x, i) => [String(i + 2), x === null ? "–" : shown(100 * x, 3)]), { caption: "Harmonics of the output" }) : null,
      certificate?.multipliers?.length ? table(["multiplier", "magnitude"], certificate.multipliers.map(([a, b]) => [`${shown(a, 4)}${b ? ` ${b < 0 ? "−" : "+"} ${shown(Math.abs(b), 4)}j` : ""}`, shown(Math.hypot(a, b), 4)]), { caption: "Floquet multipliers" }) : null,
      beside.length ? table(["neighbour [Hz]", "gain, relative [dB]", "phase, relative [deg]"], beside, { caption: "Neighbours" }) : null),
    picture.number && curve.kind === "measured" && curve.amplitude !== undefined ? h("div", { class: "row" },
      h("button", { type: "button", onclick: () => lastPeriod(picture.number, curve.amplitude, f, told?.periods, run) }, "Input and output over a period"),
      picture.onagain ? h("button", { type: "button", class: "quiet", onclick: () => picture.onagain({ band: "", frequencies: String(f), amplitudes: String(curve.amplitude), errcrit: "0.001", max_periods: "200" }) }, "Measure again, more exactly") : null,
      picture.onagain ? h("button", { type: "button", class: "quiet", onclick: () => picture.onagain({ band: "", frequencies: String(f), amplitudes: String(curve.amplitude) }, false) }, "Measure again with other settings") : null) : null,
    run);
}

function neighbours(curve, index) {
  const order = curve.frequency_hz.map((f, i) => [f, i]).filter(([, i]) => curve.re[i] !== null).sort((a, b) => a[0] - b[0]).map(([, i]) => i);
  const at = order.indexOf(index);
  if (at < 0) return [];
  return [order[at - 1], order[at + 1]].filter((i) => i !== undefined).map((i) => {
    const [a, b, c, d] = [curve.re[i], curve.im[i], curve.re[index], curve.im[index]];
    const ratio = [(a * c + b * d) / (c * c + d * d), (b * c - a * d) / (c * c + d * d)];
    return [shown(curve.frequency_hz[i]), shown(decibels(...ratio), 3), shown(wrapped([{ re: ratio[0], im: ratio[1] }])[0], 3)];
  });
}

const PERIODS = 12; // at least so many are run before the one that is shown

/** Run the model with the sine of a point, about where the input stood, and show its last period. */
async function lastPeriod(number, amplitude, f, ran, place) {
  const { asked, subject } = server.works.get(number);
  const { input, output } = asked;
  fill(place, h("p", { class: "dim" }, "Running …"));
  try {
    const { record } = await whole(number);
    const held = record?.operating_point?.u?.[input];
    if (held === undefined) throw new Error("where the input stood is known when the measurement has ended");
    const kept = Object.fromEntries(["interface", "solver", "tolerance", "at", "start_values"].filter((n) => asked[n] !== undefined).map((n) => [n, asked[n]]));
    const bias = [asked.bias ?? []].flat().filter((b) => !b.startsWith(`${input}=`)); // its own is in `held`
    const periods = Math.max(PERIODS, Math.ceil(ran ?? 0));
    const rounded = (value) => Number(value.toPrecision(10));
    const full = await done("simulate", subject, {
      ...kept, bias, inputs: [`${input}=sine:amplitude=${amplitude},frequency=${rounded(f)},offset=${held}`], outputs: [input, output],
      stop: rounded(periods / f), step: rounded(1 / (200 * f)),
    }, { aside: true });
    if (!full.signals) throw new Error(full.failure?.message ?? "there is no time history");
    const { time, signals, units } = full.signals;
    const last = time.findIndex((t) => t >= (periods - 1.0025) / f); // half a step early, as what was asked is rounded
    const cut = { time: time.slice(last), units, signals: Object.fromEntries(Object.entries(signals).map(([n, v]) => [n, v.slice(last)])) };
    fill(place, h("p", { class: "dim" }, `The last of ${periods} periods of a run from the operating point.`), histories(cut, 180),
      code(full.line, "The same run in a terminal"));
  } catch (error) {
    fill(place, h("p", { class: "bad" }, wrongs(error)));
  }
}
