// Gain and phase over frequency, of whatever curves there are, and what can be done with them.

import { done, server } from "./api.js";
import { fill, h, save, say, wrongs } from "./dom.js";
import { bode, decibels, extent, wrapped } from "./numbers.js";
import { pin, pinned, pinsShown, showPins, unpin } from "./pins.js";
import { Plot, colour, legend } from "./plot.js";
import { pointOf } from "./point.js";

const FINE = 2; // pixels of a saved image for each of the page
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
    this.band = null; // drawn last [Hz]
    this.drawBand = onband ? h("button", { type: "button", class: "quiet", "aria-pressed": "false", title: "Drag over the picture to choose the band that is measured next", onclick: () => this.banding(!this.gain.banding) }, "Draw a band") : null;
    this.withPins = onpinned ? null : h("button", { type: "button", class: "quiet", hidden: true, title: "Show the pinned curves, also those of other models, or leave them out", onclick: () => { showPins(!pinsShown()); this.redraw(); } }, "Pinned curves");
    this.tools = h("div", { class: "row", role: "toolbar", "aria-label": "Picture" },
      unwrap, toggle("Linear gain", "linear", "Show the gain as a ratio in place of decibels"), toggle("rad/s", "radians", "Show rad/s in place of Hz"),
      this.drawBand,
      asked?.command === "nfr" || asked?.command === "branches" ? h("button", { type: "button", class: "quiet", title: "Lay the linearisation at the same operating point over the picture", onclick: (event) => this.linear(asked, event.currentTarget) }, "Linear model") : null,
      h("button", { type: "button", class: "quiet", title: "Show all of the curves again, after moving or zooming", onclick: () => [this.gain, this.phase].forEach((p) => p.whole()) }, "Whole"),
      onpinned ? null : h("button", { type: "button", class: "quiet", title: "Keep these curves in every picture, and under Compare", onclick: () => { showPins(true); this.keep(); } }, "Pin"), this.withPins,
      h("button", { type: "button", class: "quiet", title: "Save gain and phase as a drawing", onclick: () => save(this.svg(), "bode.svg", "image/svg+xml") }, "SVG"),
      h("button", { type: "button", class: "quiet", title: "Save gain and phase as an image", onclick: async () => save(await this.png(), "bode.png") }, "PNG"),
      h("button", { type: "button", class: "quiet", title: "Save the points as a table", onclick: () => save(csv(this.own), "curves.csv", "text/csv") }, "CSV"));
    this.element = h("div", {}, this.tools, this.names, this.gain.element, this.phase.element, this.asked);
  }

  show(curves, full = null) {
    this.full = full;
    this.own = full ? withPoints(curves, server.works.get(this.number)?.points ?? full.points) : curves;
    this.redraw();
  }

  all() {
    const pins = this.onpinned || pinsShown() ? pinned() : [];
    return [...this.own, ...this.extras, ...pins.map((c) => ({ ...c, removable: true }))];
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
    const by = radians ? 2 * Math.PI : 1;
    this.gain.chosen = this.phase.chosen = this.band?.map((f) => f * by) ?? null;
    if (this.withPins) {
      this.withPins.hidden = !pinned().length;
      this.withPins.setAttribute("aria-pressed", String(pinsShown()));
    }
    fill(this.names, legend(gains, { onremove: (c) => { unpin(c.label); this.redraw(); this.onpinned?.(); } }));
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

  banding(on) {
    this.drawBand.setAttribute("aria-pressed", String(on));
    this.gain.banding = this.phase.banding = on;
  }

  banded(lo, hi) {
    if (!this.onband) return;
    const by = this.settings.radians ? 2 * Math.PI : 1;
    this.band = [lo / by, hi / by];
    this.banding(false);
    this.redraw();
    this.onband(...this.band);
  }

  keep() {
    const of = server.works.get(this.number);
    const named = (curve) => (of ? `${of.subject.join(", ")}, ${of.command} ${of.number}: ${curve.label}` : curve.label);
    for (const curve of this.own) pin({ ...curve, label: named(curve), points: null });
    say(`${this.own.length} curves pinned; they stay in every picture, and under Compare.`);
    this.redraw();
  }

  /** Both pictures as a drawing, with what their curves are. */
  svg() {
    const [a, b] = [this.gain.svg({ legend: false }), this.phase.svg()];
    const [w, h1] = [this.gain.width, this.gain.height];
    const h2 = this.phase.height + 18 * this.phase.curves.length;
    const inner = (s) => s.replace(/^<svg[^>]*>/, "").replace(/<\/svg>$/, "");
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${w}" height="${h1 + h2}" font-family="sans-serif">${inner(a)}<g transform="translate(0 ${h1})">${inner(b).replaceAll('id="c', 'id="d').replaceAll("url(#c", "url(#d")}</g></svg>`;
  }

  /** The same as an image. */
  async png() {
    const image = new Image();
    image.src = URL.createObjectURL(new Blob([this.svg()], { type: "image/svg+xml" }));
    await image.decode();
    const canvas = h("canvas", { width: FINE * image.width, height: FINE * image.height });
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    URL.revokeObjectURL(image.src);
    return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
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

export const DEPTH = 1e-4; // of the largest gain: below, a linear model's curve says nothing that a person would look for

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
