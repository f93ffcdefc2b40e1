// One work: its picture while it runs, its report when it has ended, and what a point of it knows.

import { done, factsOf, get, onChange, server, stop, whole } from "./api.js";
import { code, fill, h, save, say, table, wrongs } from "./dom.js";
import { bode, decibels, extent, shown, unitShown, wrapped } from "./numbers.js";
import { Plot, colour, legend } from "./plot.js";
import { pin, pinned } from "./compare.js";

export async function workPage([number]) {
  const work = server.works.get(Number(number)) ?? (await whole(Number(number)));
  const shownWork = live(Number(number), {});
  return {
    title: `${work.command} ${number}`,
    leave: shownWork.leave,
    element: h("div", {}, h("h1", {}, `${work.command} of ${work.subject.join(", ")}`),
      work.subject.length === 1 ? h("p", {}, h("a", { href: `#/open/${encodeURIComponent(work.subject[0])}` }, "To the model")) : null, shownWork.element),
  };
}

/** What a work shows, kept up to date; {element, leave}. `onband` is told a band drawn with the mouse. */
export function live(number, { onband = null, onagain = null }) {
  const head = h("div", { role: "status" });
  const body = h("div");
  const tail = h("div");
  let picture = null;
  let knob = null;
  let waits = 0;
  let units = {}; // of inputs and outputs by name, as far as they are known
  const subject = server.works.get(number)?.subject ?? [];
  if (subject.length === 1) {
    factsOf(subject[0]).then((facts) => {
      units = Object.fromEntries([...facts.inputs, ...facts.outputs, ...facts.states].map((v) => [v.name, v.unit ?? ""]));
    }, () => {}); // its failure is told where the work itself fails
  }
  const update = async () => {
    const work = server.works.get(number);
    if (!work) return;
    const running = work.state === "running" || work.state === "waiting";
    fill(head, h("div", { class: "row" },
      h("strong", { class: { failed: "bad", stopped: "watch" }[work.state] ?? "" }, work.state === "done" && !work.well ? "done, not all well" : work.state),
      h("span", {}, running ? [work.total ? `${work.done} of ${work.total}` : "", work.words ?? ""].join(" ") : work.seconds ? `${shown(work.seconds, 3)} s` : ""),
      running ? h("button", { type: "button", class: "quiet", onclick: () => stop(number) }, "Stop") : null,
      !running && onagain === null ? null : work.state === "stopped" && onagain ? h("button", { type: "button", class: "quiet", onclick: () => onagain({}) }, "Go on") : null),
      running ? h("progress", { max: work.total || 1, value: work.total ? work.done : null, "aria-label": work.command }) : null,
      work.failure?.message ? h("p", { class: "bad" }, `${work.failure.kind}: ${work.failure.message}`) : null);
    if (work.points.length && work.points.some((p) => p && "response" in p)) {
      picture ??= new Bode({ onband, number, onagain });
      if (!picture.element.isConnected) fill(body, picture.element);
      if (running) picture.show(ofPoints(work.points.filter(Boolean), { input: units[work.asked.input] ?? "", output: units[work.asked.output] ?? "" }));
    }
    if (running) fill(tail, code(work.line, "The same in a terminal"));
    else await finished();
  };
  const finished = async () => {
    const full = await whole(number);
    if (full.curves.length) {
      picture ??= new Bode({ onband, number, onagain });
      picture.show(full.curves, full);
      if (full.command === "loop" && full.record.linear) {
        knob ??= gainKnob(full, picture);
        fill(body, knob);
      } else if (!picture.element.isConnected) fill(body, picture.element);
    } else if (full.signals) {
      fill(body, histories(full.signals));
    }
    fill(tail, afterwards(full));
  };
  const end = onChange((work, event) => {
    if (work.number !== number) return;
    if (event.event === "state") update();
    else waits ||= requestAnimationFrame(() => { waits = 0; update(); });
  });
  update();
  return { element: h("div", {}, head, body, tail), leave: end };
}

/** Curves of the points that there are so far, one an amplitude. */
function ofPoints(points, units) {
  const curves = new Map();
  for (const p of points) {
    const label = `${shown(p.amplitude, 6)} ${unitShown(units.input)}`.trim();
    if (!curves.has(label)) curves.set(label, { label, kind: "measured", input_unit: units.input, output_unit: units.output, amplitude: p.amplitude, frequency_hz: [], re: [], im: [], error: [], status: [], stable: [], points: [] });
    const c = curves.get(label);
    c.frequency_hz.push(p.frequency);
    c.re.push(p.response?.[0] ?? null);
    c.im.push(p.response?.[1] ?? null);
    c.error.push(p.error);
    c.status.push(p.reason ? "failed" : p.averaged ? "averaged" : "settled");
    c.stable.push(p.stable);
    c.points.push(p);
  }
  return [...curves.values()].sort((a, b) => a.amplitude - b.amplitude);
}

const MARKS = { settled: "dot", averaged: "triangle", failed: "cross" };

/** Gain and phase over frequency, with a cursor through both, and all that can be asked of them. */
export class Bode {
  constructor({ onband = null, number = null, onagain = null, onpinned = null, title = "" }) {
    Object.assign(this, { onband, number, onagain, onpinned, own: [], settings: { unwrap: true, linear: false, radians: false } });
    const x = { label: "frequency [Hz]", log: true };
    const common = {
      x, onpick: (point, where) => this.pick(point, where), onband: (lo, hi) => this.banded(lo, hi),
    };
    this.gain = new Plot({ ...common, y: { label: "gain [dB]", log: false, least: 1 }, label: `${title} Bode picture, gain. Arrow keys go from point to point, Enter picks one, plus, minus and 0 zoom.`, height: 280, onmove: (v) => this.follow(this.phase, v) });
    this.phase = new Plot({ ...common, y: { label: "phase [deg]", log: false, least: 5 }, label: `${title} Bode picture, phase`, height: 220, onmove: (v) => this.follow(this.gain, v) });
    for (const [one, other] of [[this.gain, this.phase], [this.phase, this.gain]]) {
      one.onview = (view) => {
        other.view = view ? { x: view.x, y: other.view?.y ?? other.limits().y } : null;
        other.later();
      };
    }
    this.names = h("div");
    this.asked = h("section", { "aria-label": "The point", "aria-live": "polite" });
    const toggle = (label, name, title) => h("button", {
      type: "button", title, class: "quiet", "aria-pressed": "false", onclick: (event) => {
        this.settings[name] = !this.settings[name];
        event.currentTarget.setAttribute("aria-pressed", String(this.settings[name]));
        this.gain.view = this.phase.view = null;
        this.redraw();
      },
    }, label);
    const unwrap = toggle("Unwrap", "unwrap", "Draw the phase without jumps of 360 degrees");
    unwrap.setAttribute("aria-pressed", "true");
    const asked = number === null ? null : server.works.get(number);
    this.extras = [];
    this.tools = h("div", { class: "row", role: "toolbar", "aria-label": "Picture" },
      unwrap, toggle("Linear gain", "linear", "Show the gain as a ratio in place of decibels"), toggle("rad/s", "radians", "Show rad/s in place of Hz"),
      onband ? h("button", { type: "button", class: "quiet", "aria-pressed": "false", title: "Drag over the picture to choose the band that is measured next", onclick: (event) => this.banding(event.currentTarget) }, "Draw a band") : null,
      asked?.command === "nfr" || asked?.command === "branches" ? h("button", { type: "button", class: "quiet", title: "Lay the linearisation at the same operating point over the picture", onclick: (event) => this.linear(asked, event.currentTarget) }, "Linear model") : null,
      h("button", { type: "button", class: "quiet", title: "Show all of the curves again, after moving or zooming", onclick: () => [this.gain, this.phase].forEach((p) => p.whole()) }, "Whole"),
      onpinned ? null : h("button", { type: "button", class: "quiet", title: "Keep these curves in every picture, and under Compare", onclick: () => this.keep() }, "Pin"),
      h("button", { type: "button", class: "quiet", title: "Save gain and phase as a drawing", onclick: () => this.saveSvg() }, "SVG"),
      h("button", { type: "button", class: "quiet", title: "Save the gain as an image", onclick: async () => save(await this.gain.png(), "gain.png") }, "PNG"),
      h("button", { type: "button", class: "quiet", title: "Save the points as a table", onclick: () => save(csv(this.own), "curves.csv", "text/csv") }, "CSV"));
    this.element = h("div", {}, this.tools, this.names, this.gain.element, this.phase.element, this.asked);
  }

  show(curves, full = null) {
    this.full = full;
    this.own = full ? withPoints(curves, server.works.get(this.number)?.points ?? full.points) : curves;
    this.redraw();
  }

  all() {
    return [...this.own, ...this.extras, ...pinned().map((c) => ({ ...c, removable: true }))];
  }

  redraw() {
    const { radians, linear } = this.settings;
    const gains = [];
    const phases = [];
    this.gain.x.label = this.phase.x.label = radians ? "frequency [rad/s]" : "frequency [Hz]";
    this.gain.y.least = linear ? undefined : 1;
    const unit = this.own[0]?.output_unit && this.own[0]?.input_unit ? `${this.own[0].output_unit}/${this.own[0].input_unit}` : "1";
    this.gain.y.label = linear ? `gain [${unit}]` : "gain [dB]";
    const all = this.all();
    this.gain.x.range = this.phase.x.range = worth(all, radians ? 2 * Math.PI : 1);
    all.forEach((curve, i) => {
      const b = bode(curve, this.settings);
      const marks = curve.status ? b.index.map((k) => MARKS[curve.status[k]] ?? "") : null;
      const dashed = curve.kind === "branch" ? b.index.map((k) => curve.stable[k] === false || curve.stable[k] === 0) : null;
      const common = {
        label: curve.label, colour: curve.colour ?? colour(i), x: b.x, marks, dashed, width: curve.kind === "linear" || curve.removable ? 1.2 : 1.8, removable: curve.removable,
        dash: curve.removable && this.own.length ? [8, 4] : curve.kind === "linear" ? [3, 3] : [], points: b.index.map((k) => ({ curve, index: k })),
        says: curve.status ? b.index.map((k) => curve.status[k]) : null,
      };
      if (b.gain.every((g) => g === null || (linear && g === 0)) && !marks) common.label = `${curve.label} (zero)`;
      gains.push({ ...common, y: b.gain, low: b.low, high: b.high });
      phases.push({ ...common, y: b.phase, low: b.phase.map((p, k) => (p === null || b.swing[k] === null ? null : p - b.swing[k])), high: b.phase.map((p, k) => (p === null || b.swing[k] === null ? null : p + b.swing[k])) });
    });
    this.gain.set(gains);
    this.phase.set(phases, { lines: [{ axis: "y", value: -180 }] });
    fill(this.names, legend(gains, { onremove: (c) => { pinned.remove(c.label); this.redraw(); this.onpinned?.(); } }));
  }

  /** Lay the linear model at the same point over the picture. */
  async linear({ subject, asked }, button) {
    button.disabled = true;
    try {
      const same = Object.fromEntries(["at", "interface", "start_values", "bias"].filter((n) => asked[n] !== undefined).map((n) => [n, asked[n]]));
      const full = await done("lin", subject, { ...same, inputs: [asked.input], outputs: [asked.output] }, { aside: true });
      if (!full.curves.length) throw new Error(full.failure?.message ?? "there is no linear model");
      const seen = this.own.flatMap((c) => c.frequency_hz);
      const [low, high] = [Math.min(...seen), Math.max(...seen)];
      this.extras = full.curves.map((c) => ({ ...cut(c, low, high), colour: "--ink" }));
      this.redraw();
    } catch (error) {
      say(wrongs(error), true);
      button.disabled = false;
    }
  }

  follow(plot, value) {
    plot.cursor = value;
    plot.later();
  }

  banding(button) {
    const on = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(on));
    this.gain.banding = this.phase.banding = on;
  }

  banded(lo, hi) {
    const by = this.settings.radians ? 2 * Math.PI : 1;
    this.onband?.(lo / by, hi / by);
  }

  keep() {
    const of = server.works.get(this.number);
    const named = (curve) => (of ? `${of.subject.join(", ")}, ${of.command} ${of.number}: ${curve.label}` : curve.label);
    for (const curve of this.own) pin({ ...curve, label: named(curve), points: null });
    say(`${this.own.length} curves pinned; they stay in every picture, and under Compare.`);
    this.redraw();
  }

  saveSvg() {
    const [a, b] = [this.gain.svg({ legend: false }), this.phase.svg()];
    const [w, h1] = [this.gain.width, this.gain.height];
    const h2 = this.phase.height + 18 * this.phase.curves.length;
    const inner = (s) => s.replace(/^<svg[^>]*>/, "").replace(/<\/svg>$/, "");
    save(`<svg xmlns="http://www.w3.org/2000/svg" width="${w}" height="${h1 + h2}" font-family="sans-serif">${inner(a)}<g transform="translate(0 ${h1})">${inner(b).replaceAll('id="c', 'id="d').replaceAll("url(#c", "url(#d")}</g></svg>`, "bode.svg", "image/svg+xml");
  }

  pick(point, where) {
    for (const plot of [this.gain, this.phase]) {
      plot.picked = where;
      plot.later();
    }
    if (!point) {
      fill(this.asked);
      return;
    }
    fill(this.asked, pointOf(point, this));
  }
}

const DEPTH = 1e-4; // of the largest gain: below, a linear model's curve says nothing that a person would look for

/** Frequencies that a picture of curves begins and ends with; null: those of its points. */
function worth(curves, by) {
  const gains = curves.map((c) => c.re.map((re, i) => (re === null ? null : Math.hypot(re, c.im[i]))));
  const top = extent(gains)?.[1];
  if (!top) return null;
  const seen = extent(curves.map((c, k) => c.frequency_hz.filter((f, i) => f > 0 && (c.kind !== "linear" || gains[k][i] >= top * DEPTH))));
  return seen && seen[1] > seen[0] ? seen.map((f) => f * by) : null;
}

/** The part of a curve between two frequencies. */
function cut(curve, low, high) {
  const inside = curve.frequency_hz.map((f, i) => [f, i]).filter(([f]) => f >= low * 0.95 && f <= high * 1.05).map(([, i]) => i);
  return { ...curve, frequency_hz: inside.map((i) => curve.frequency_hz[i]), re: inside.map((i) => curve.re[i]), im: inside.map((i) => curve.im[i]) };
}

/** The points that were told, beside the curves of the record. */
function withPoints(curves, points) {
  const known = new Map(points.filter((p) => p && "response" in p).map((p) => [`${p.amplitude} ${p.frequency}`, p]));
  return curves.map((c) => ({ ...c, points: c.kind === "measured" ? c.frequency_hz.map((f) => known.get(`${c.amplitude} ${f}`) ?? null) : null }));
}

/** Everything that is known of a point: what it is worth, harmonics, multipliers, neighbours; and what can be asked. */
function pointOf({ curve, index }, picture) {
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
  if (told) rows.push(["periods run", shown(told.periods)], ["offset", `${shown(told.offset)} ${unit}`], ["why it failed", told.reason], ["remark", told.warning]);
  if (certificate) rows.push(["method", certificate.method], ["total harmonic distortion", certificate.thd === null ? null : `${shown(100 * certificate.thd, 3)} %`], ["distance to a fold", certificate.fold_distance === null ? null : shown(certificate.fold_distance, 3)], ["why it did not settle", certificate.why]);
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
    fill(place, h("p", { class: "dim" }, `The last of ${periods} periods of a run from the operating point.`), histories(cut),
      code(full.line, "The same run in a terminal"));
  } catch (error) {
    fill(place, h("p", { class: "bad" }, wrongs(error)));
  }
}

/** Signals over time, one picture for each unit. */
function histories({ time, signals, units }) {
  const groups = new Map();
  for (const n of Object.keys(signals)) groups.set(units[n] ?? "", [...(groups.get(units[n] ?? "") ?? []), n]);
  return h("div", {}, [...groups].slice(0, 8).map(([unit, names]) => {
    const plot = new Plot({ x: { label: "time [s]", log: false }, y: { label: `${names.length === 1 ? names[0] : "signals"} [${unit || "–"}]`, log: false }, label: `${names.join(", ")} over time`, height: 240 });
    const curves = names.slice(0, 12).map((n, i) => ({ label: n, colour: colour(i), x: time, y: signals[n] }));
    plot.set(curves);
    return h("div", {}, legend(curves), plot.element);
  }));
}

/** Curves as a table: one line a point. */
function csv(curves) {
  const cell = (v) => (v === null || v === undefined ? "" : typeof v === "string" ? `"${(/^[=@+\-\t]/.test(v) ? `'${v}` : v).replaceAll('"', '""')}"` : v);
  const lines = [["curve", "frequency_hz", "gain", "gain_db", "phase_deg", "error", "status", "stable"].join(",")];
  for (const c of curves) {
    c.frequency_hz.forEach((f, i) => {
      const [re, im] = [c.re[i], c.im[i]];
      const none = re === null;
      lines.push([c.label, f, none ? null : Math.hypot(re, im), none ? null : decibels(re, im), none ? null : wrapped([{ re, im }])[0], c.error?.[i], c.status?.[i], c.stable?.[i]].map(cell).join(","));
    });
  }
  return `${lines.join("\n")}\n`;
}

const PICTURED = new Set(["nfr", "branches", "loop", "simulate"]); // whose pictures say it; of others the report does

/** What a work that has ended gives: remarks, files, report, the command and the Python. */
function afterwards(full) {
  const at = `/api/works/${full.number}`;
  const reported = () => {
    const waits = h("p", { class: "dim" }, "The report is being written …");
    return [waits, h("iframe", { src: `${at}/report.html`, title: "Report", onload: () => waits.remove() })];
  };
  const report = h("div", {}, full.has_record && !PICTURED.has(full.command) ? reported() : null);
  return [
    full.remarks.length ? h("section", {}, h("h2", {}, "Remarks"), h("ul", {}, full.remarks.map((n) => h("li", {}, n)))) : null,
    full.has_record ? h("div", { class: "row" },
      h("button", { type: "button", onclick: () => fill(report, reported()) }, "Report"),
      h("a", { class: "button", href: `${at}/report.html`, download: `${full.command}-${full.number}.html` }, "Save the report"),
      h("a", { class: "button", href: `${at}/picture.svg`, download: `${full.command}-${full.number}.svg` }, "Picture"),
      h("a", { class: "button", href: `${at}/data.csv`, download: `${full.command}-${full.number}.csv` }, "CSV"),
      h("a", { class: "button", href: `${at}/data.json`, download: `${full.command}-${full.number}.json` }, "JSON")) : null,
    code(full.line, "The same in a terminal"), full.call ? code(full.call, "in Python") : null, report,
  ];
}

// -- a loop whose gain is dragged ---------------------------------------------------------------------------

const NEAR = 4; // times the crossover are the poles away that the root locus shows

/** The loop at another gain, in the pictures; `bodes` shows what was measured, too. */
function gainKnob(full, bodes) {
  const number = h("input", { type: "text", inputMode: "decimal", value: "1", "aria-label": "factor of the loop gain" });
  const slider = h("input", { type: "range", min: -60, max: 60, step: 0.25, value: 0, "aria-label": "loop gain, slider in dB" });
  const facts = h("div", { role: "status" });
  const unit = new Plot({ x: { label: "Re L", log: false, range: [-3, 2] }, y: { label: "Im L", log: false, range: [-2, 2] }, label: "Nyquist picture", height: 300, equal: true });
  const nichols = new Plot({ x: { label: "phase of L [deg]", log: false }, y: { label: "gain of L [dB]", log: false }, label: "Nichols picture", height: 300 });
  const locus = new Plot({ x: { label: "Re of the poles [rad/s]", log: false }, y: { label: "Im [rad/s]", log: false }, label: "Root locus: poles of the closed loop", height: 300 });
  const step = new Plot({ x: { label: "time [s]", log: false }, y: { label: "step response of T", log: false }, label: "Step response of the closed loop", height: 260 });
  const measured = full.curves.filter((c) => c.kind === "measured").map((c) => ({ ...c, label: `${c.label}, × 1` }));
  const locusNames = h("div");
  let locusOf = { re: [], im: [] };
  let asked = 0;
  const update = async () => {
    const gain = Number(number.value);
    if (!Number.isFinite(gain)) return;
    const mine = (asked += 1);
    const found = await get(`/api/works/${full.number}/loop?gain=${gain}${locusOf.re.length ? "" : "&locus=1"}`);
    if (mine !== asked) return;
    locusOf = found.locus ?? locusOf;
    const m = found.margins;
    fill(facts, h("p", { class: found.stable ? "good" : "bad" }, found.stable ? "The closed loop is stable." : "The closed loop is unstable."),
      h("p", {}, `Gain margin ${margin(m.gain_margin_db, "dB")}, phase margin ${margin(m.phase_margin_deg, "deg")}, delay margin ${margin(m.delay_margin_s === null ? null : 1e3 * m.delay_margin_s, "ms")}; ${m.gain_crossover_hz === null ? "no crossover of 0 dB" : `crossover at ${shown(m.gain_crossover_hz, 4)} Hz`}.`));
    const open = bode(found.open);
    const at = (hz) => `at ${shown(hz, 4)} Hz`;
    unit.set([{ label: "L", colour: colour(0), x: found.open.re, y: found.open.im, says: found.open.frequency_hz.map(at) }, { label: "−1", colour: colour(1), x: [-1], y: [0], marks: ["cross"], line: false }, circle()]);
    const top = Math.max(...open.gain.filter((g) => g !== null));
    const seen = open.gain.map((g, i) => [g, open.phase[i], at(open.x[i])]).filter(([g]) => g !== null && g >= top + 20 * Math.log10(DEPTH));
    nichols.set([{ label: "L", colour: colour(0), x: seen.map(([, p]) => p), y: seen.map(([g]) => g), says: seen.map(([, , where]) => where) }, { label: "−1", colour: colour(1), x: [-180], y: [0], marks: ["cross"], line: false }]);
    const crossing = m.gain_crossover_hz ?? m.phase_crossover_hz;
    if (!locus.x.range) { // the poles that matter for the crossover
      const size = crossing ? NEAR * 2 * Math.PI * crossing : 1.5 * Math.max(1e-6, ...found.poles.re.map((re, i) => Math.hypot(re, found.poles.im[i])));
      [locus.x.range, locus.y.range] = [[-size, size / 4], [-size, size]];
    }
    const poles = (label, { re, im }, number, mark) => ({ label, colour: colour(number), x: re, y: im, line: false, marks: re.map(() => mark) });
    locus.set([poles("at other gains", locusOf, 2, "dot"), poles("open loop (×)", found.open_poles, 0, "cross"), poles("closed loop (□)", found.poles, 1, "square")], { lines: [{ axis: "x", value: 0 }] });
    fill(locusNames, legend(locus.curves));
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
    facts, bodes.element, h("h3", {}, "Nyquist"), unit.element, h("h3", {}, "Nichols"), nichols.element, h("h3", {}, "Root locus"), locusNames, locus.element, h("h3", {}, "Step"), step.element);
}

/** A margin in words; null: nothing brings the loop to its limit. */
function margin(value, unit) {
  return value === null ? "infinite" : `${shown(value, 4)} ${unit}`;
}

function circle() {
  const angles = Array.from({ length: 91 }, (_, k) => (k * Math.PI) / 45);
  return { label: "unit circle", colour: colour(3), x: angles.map(Math.cos), y: angles.map(Math.sin), dash: [2, 4], width: 1 };
}
