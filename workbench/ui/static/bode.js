// Gain and phase over frequency, of whatever curves there are, and what can be done with them.

import { done, server } from "./api.js";
import { fill, h, menu, save, say, wrongs } from "./dom.js";
import { between, bode, decibels, extent, shown, wrapped } from "./numbers.js";
import { onOverlays, overlaid } from "./overlays.js";
import { legend } from "./legend.js";
import { Plot, colour, dashOf, ramp } from "./plot.js";
import { pointOf } from "./point.js";

const FINE = 2; // pixels of a saved image for each of the page
const WORDED = 2; // so many marks have their words; of more the first and the last
const MARKS = { settled: "dot", averaged: "triangle", failed: "cross" };

/** Gain and phase over frequency, with a cursor through both, and all that can be asked of them. */
export class Bode {
  /** `tools` stand in the toolbar of whoever shows it, `exports` in its menu, see `bar`; `key`: whose overlay it is itself. */
  constructor({ onband = null, number = null, onagain = null, title = "", heights = [0.33, 0.26], key = number }) {
    Object.assign(this, { onband, number, key, onagain, own: [], extras: [], band: null, settings: { unwrap: true, linear: false, radians: false } });
    const x = { label: "frequency [Hz]", log: true };
    const common = {
      x, onpick: (point, where) => this.pick(point, where), onband: (lo, hi) => this.banded(lo, hi),
    };
    this.gain = new Plot({ ...common, y: { label: "gain [dB]", log: false, least: 1 }, label: `${title} Bode picture, gain. Arrow keys go from point to point, Enter picks one, plus, minus and 0 zoom.`, height: heights[0], onmove: (v) => this.follow(this.phase, v) });
    this.phase = new Plot({ ...common, y: { label: "phase [deg]", log: false, least: 5 }, label: `${title} Bode picture, phase`, height: heights[1], quiet: true, onmove: (v) => this.follow(this.gain, v) });
    for (const [one, other] of [[this.gain, this.phase], [this.phase, this.gain]]) {
      one.onview = (view) => {
        other.view = view ? { x: view.x, y: other.view?.y ?? other.limits().y } : null;
        other.later();
      };
    }
    this.names = h("div");
    this.asked = h("section", { class: "asked", "aria-label": "The point", "aria-live": "polite" });
    this.element = h("div", { class: "bode" }, h("div", {}, this.names, this.gain.element, this.phase.element), this.asked);
    this.make();
    this.leave = onOverlays(() => this.redraw());
  }

  /** Make what stands in the toolbar and in the menu. */
  make() {
    const asked = this.number === null ? null : server.works.get(this.number);
    const button = (label, title, onclick, more = {}) => h("button", { type: "button", class: "quiet", title, onclick, ...more }, label);
    const toggle = (label, name, title) => button(label, title, (event) => {
      this.settings[name] = !this.settings[name];
      event.currentTarget.setAttribute("aria-pressed", String(this.settings[name]));
      this.gain.view = this.phase.view = null;
      this.redraw();
    }, { "aria-pressed": String(this.settings[name]) });
    this.drawBand = this.onband ? button("Band", "Drag over the picture to choose the band that is measured next", () => this.banding(!this.gain.banding), { "aria-pressed": "false" }) : null;
    this.tools = [
      this.drawBand,
      asked?.command === "nfr" || asked?.command === "branches" ? button("Linear model", "Lay the linearisation at the same operating point over the picture", (event) => this.linear(asked, event.currentTarget)) : null,
      button("Whole", "Show all of the curves again, after moving or zooming", () => [this.gain, this.phase].forEach((p) => p.whole())),
      menu("View", [toggle("Unwrap", "unwrap", "Draw the phase without jumps of 360 degrees"), toggle("Linear gain", "linear", "Show the gain as a ratio in place of decibels"), toggle("rad/s", "radians", "Show rad/s in place of Hz")]),
    ].filter(Boolean);
    this.exports = [
      button("SVG", "Save gain and phase as a drawing", () => save(this.svg(), "bode.svg", "image/svg+xml")),
      button("PNG", "Save gain and phase as an image", async () => save(await this.png(), "bode.png")),
      button("CSV", "Save the points as a table", () => save(csv(this.own), "curves.csv", "text/csv")),
    ];
  }

  /** The toolbar by itself, where no run has one. */
  bar() {
    return h("div", { class: "bar", role: "toolbar", "aria-label": "Picture" }, this.tools, menu("Export", this.exports));
  }

  show(curves, full = null) {
    this.full = full;
    this.own = full ? withPoints(curves, server.works.get(this.number)?.points ?? full.points) : curves;
    this.redraw();
  }

  all() {
    return [...this.own, ...this.extras, ...overlaid(this.key).map((c) => ({ ...c, overlaid: true }))];
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
    const amplitudes = [...new Set(this.own.filter((c) => c.kind === "measured" && c.amplitude !== undefined).map((c) => c.amplitude))].sort((a, b) => a - b);
    const rank = (curve) => (this.own.includes(curve) && curve.kind === "measured" ? amplitudes.indexOf(curve.amplitude) : -1);
    const [above, below] = [[], []];
    all.forEach((curve, i) => {
      const b = bode(curve, this.settings);
      const marks = curve.status ? b.index.map((k) => MARKS[curve.status[k]] ?? "") : null;
      const dashed = curve.kind === "branch" ? b.index.map((k) => curve.stable[k] === false || curve.stable[k] === 0) : null;
      const common = {
        label: curve.label, colour: curve.colour ?? (rank(curve) >= 0 ? ramp(rank(curve), amplitudes.length) : colour(i)), x: b.x, marks, dashed, width: curve.kind === "linear" || curve.overlaid ? 1.2 : 1.8, overlaid: curve.overlaid,
        dash: curve.overlaid && this.own.length ? [8, 4] : curve.kind === "linear" && all.some((c) => c.kind !== "linear") ? [3, 3] : rank(curve) >= 0 ? [] : dashOf(i), points: b.index.map((k) => ({ curve, index: k })),
        says: curve.status ? b.index.map((k) => curve.status[k]) : null,
      };
      if (b.gain.every((g) => g === null || (linear && g === 0)) && !marks) common.label = `${curve.label} (zero)`;
      gains.push({ ...common, y: b.gain, low: b.low, high: b.high });
      phases.push({ ...common, y: b.phase, low: b.phase.map((p, k) => (p === null || b.swing[k] === null ? null : p - b.swing[k])), high: b.phase.map((p, k) => (p === null || b.swing[k] === null ? null : p + b.swing[k])) });
      this.noted(curve, common, b, above, below);
    });
    if (above.length > WORDED) above.forEach((note, k) => { if (k && k < above.length - 1) note.text = ""; });
    this.gain.set(gains, { lines: above.some((n) => n.to === 0) ? [{ axis: "y", value: 0 }] : [], extra: { notes: above } });
    this.phase.set(phases, { lines: [{ axis: "y", value: -180 }], extra: { notes: below } });
    const by = radians ? 2 * Math.PI : 1;
    this.gain.chosen = this.phase.chosen = this.band?.map((f) => f * by) ?? null;
    this.legend = legend(gains, [this.gain, this.phase]);
    fill(this.names, this.legend);
    this.values(this.gain.cursor);
  }

  /** Add what is marked of a curve: a resonance, a bandwidth, folds, margins. */
  noted(curve, { colour: own }, b, above, below) {
    const { radians, linear } = this.settings;
    for (const mark of curve.marks ?? []) {
      const x = radians ? 2 * Math.PI * mark.hz : mark.hz;
      if (mark.on === "phase") {
        const y = between(b.x, b.phase, x);
        if (y !== null) below.push({ x, y, to: y - mark.deg, text: mark.text, colour: own });
      } else above.push({ x, y: linear ? 10 ** (mark.db / 20) : mark.db, to: mark.on === "gain" ? (linear ? 1 : 0) : undefined, text: mark.text, colour: own });
    }
  }

  /** What every curve is where the cursor stands, beside its name. */
  values(at) {
    if (this.phase.curves.length !== this.gain.curves.length) return; // one of the two is drawn anew
    if (at === null || !this.gain.curves.length) {
      this.legend?.values(null);
      return;
    }
    const texts = new Map();
    this.gain.curves.forEach((c, i) => {
      const sorted = c.x.every((v, k) => !k || v >= c.x[k - 1]); // a branch folds back: it has no one value
      const [g, p] = sorted ? [between(c.x, c.y, at), between(c.x, this.phase.curves[i].y, at)] : [null, null];
      if (g !== null && p !== null) texts.set(c.label, `${shown(g, 4)}${this.settings.linear ? "" : " dB"}, ${shown(p, 4)}°`);
    });
    this.legend.values(texts);
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
    this.values(value);
    if (plot === this.gain && value !== null) this.gain.readout.textContent = this.phase.readout.textContent;
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
    fill(this.asked, pointOf(point, this), h("button", { type: "button", class: "quiet close", "aria-label": "Close the point", onclick: () => this.pick(null, null) }, "×"));
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
