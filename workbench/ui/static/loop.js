// A loop whose gain is dragged: margins, Bode, Nyquist, Nichols, root locus and step response.

import { get } from "./api.js";
import { DEPTH } from "./bode.js";
import { fill, h, table, told } from "./dom.js";
import { bode, locusRanges, shown } from "./numbers.js";
import { Plot, colour, legend } from "./plot.js";

const NEAR = 4; // times the crossover are the poles away that the root locus shows

/** The loop at another gain, in the pictures; `bodes` shows what was measured, too. */
export function gainKnob(full, bodes) {
  const number = h("input", { type: "text", inputMode: "decimal", value: "1", "aria-label": "factor of the loop gain" });
  const slider = h("input", { type: "range", min: -60, max: 60, step: 0.25, value: 0, "aria-label": "loop gain, slider in dB" });
  const facts = h("div", { role: "status" }, h("p", { class: "dim" }, "Margins are being computed …"));
  const unit = new Plot({ x: { label: "Re L", log: false, range: [-3, 2] }, y: { label: "Im L", log: false, range: [-2, 2] }, label: "Nyquist picture", height: 300, equal: true });
  const nichols = new Plot({ x: { label: "phase of L [deg]", log: false }, y: { label: "gain of L [dB]", log: false }, label: "Nichols picture", height: 300 });
  const locus = new Plot({ x: { label: "Re of the poles [rad/s]", log: false }, y: { label: "Im [rad/s]", log: false }, label: "Root locus: poles of the closed loop", height: 300 });
  const step = new Plot({ x: { label: "time [s]", log: false }, y: { label: "step response of T", log: false }, label: "Step response of the closed loop", height: 260 });
  const measured = full.curves.filter((c) => c.kind === "measured").map((c) => ({ ...c, label: `${c.label}, × 1` }));
  const locusNames = h("div");
  const stepSays = h("p", { class: "bad", role: "status" });
  let size = null; // of the root locus at first: the poles that matter for the crossover
  let locusOf = { re: [], im: [] };
  let asked = 0;
  const update = async () => {
    const gain = Number(number.value);
    const mine = (asked += 1);
    let found;
    try {
      found = await get(`/api/works/${full.number}/loop?gain=${gain}${locusOf.re.length ? "" : "&locus=1"}`);
    } catch (error) {
      fill(facts, h("p", { class: "bad" }, error.message));
      return;
    }
    if (mine !== asked) return;
    locusOf = found.locus ?? locusOf;
    fill(facts, told(found.verdict), h("div", { class: "cards" }, found.tables.map((t) => table(t.headings, t.rows, { caption: t.title }))));
    const open = bode(found.open);
    const at = (hz) => `at ${shown(hz, 4)} Hz`;
    unit.set([{ label: "L", colour: colour(0), x: found.open.re, y: found.open.im, says: found.open.frequency_hz.map(at) }, { label: "−1", colour: colour(1), x: [-1], y: [0], marks: ["cross"], line: false }, circle()]);
    const top = Math.max(...open.gain.filter((g) => g !== null));
    const seen = open.gain.map((g, i) => [g, open.phase[i], at(open.x[i])]).filter(([g]) => g !== null && g >= top + 20 * Math.log10(DEPTH));
    nichols.set([{ label: "L", colour: colour(0), x: seen.map(([, p]) => p), y: seen.map(([g]) => g), says: seen.map(([, , where]) => where) }, { label: "−1", colour: colour(1), x: [-180], y: [0], marks: ["cross"], line: false }]);
    const crossing = found.margins.gain_crossovers.at(-1) ?? found.margins.phase_crossovers.at(-1);
    size ??= crossing?.frequency_hz ? NEAR * 2 * Math.PI * crossing.frequency_hz : 1.5 * Math.max(1e-6, ...found.poles.re.map((re, i) => Math.hypot(re, found.poles.im[i])));
    [locus.x.range, locus.y.range] = locusRanges(found.poles, size);
    const poles = (label, { re, im }, number, mark) => ({ label, colour: colour(number), x: re, y: im, line: false, marks: re.map(() => mark) });
    locus.set([poles("at other gains", locusOf, 2, "dot"), poles("open loop (×)", found.open_poles, 0, "cross"), poles("closed loop (□)", found.poles, 1, "square")], { lines: [{ axis: "x", value: 0 }] });
    fill(locusNames, legend(locus.curves));
    const { left_s: left } = found.step;
    fill(stepSays, left === null ? (found.margins.closed_loop === "unstable" ? "Unstable, by a motion that the step does not excite: T does not show it." : "") : `Unstable: the response is more than 10 away from the step after ${shown(left, 3)} s; shown until then.`);
    step.set([{ label: "T", colour: colour(0), x: found.step.time, y: found.step.value }], { lines: [{ axis: "y", value: 1 }] });
    bodes.show([found.open, found.closed, ...measured], full);
  };
  slider.oninput = () => {
    number.value = shown(10 ** (Number(slider.value) / 20), 5);
    update();
  };
  number.onchange = () => {
    const gain = Number(number.value);
    if (gain > 0) slider.value = 20 * Math.log10(gain);
    update();
  };
  update();
  return h("section", {}, h("h2", {}, "Margins at another gain"), h("div", { class: "knob" }, h("span", {}, "Loop gain ×"), slider, number, h("span", { class: "dim" }, "")),
    facts, bodes.element, h("h3", {}, "Nyquist"), unit.element, h("h3", {}, "Nichols"), nichols.element, h("h3", {}, "Root locus"), locusNames, locus.element, h("h3", {}, "Step"), stepSays, step.element);
}

function circle() {
  const angles = Array.from({ length: 91 }, (_, k) => (k * Math.PI) / 45);
  return { label: "unit circle", colour: colour(3), x: angles.map(Math.cos), y: angles.map(Math.sin), dash: [2, 4], width: 1 };
}
