// Pictures of curves: drawn on a canvas, or with the same strokes into an SVG file. Curves may fold back (branches).

import { placed } from "./labels.js";
import { extent, nearest, shown, ticks } from "./numbers.js";
import { h } from "./dom.js";
import { CanvasPen, SvgPen } from "./pens.js";

const LEFT = 68, RIGHT = 14, TOP = 10, BOTTOM = 40, BARE = 22, TOUCH = 28, GRIP = 12, LOWEST = 150;

/** Colours of curves, each legible on light and on dark ground: names of the style sheet. */
export function colour(number) {
  return `--curve-${number % 8}`;
}

/** Dash of curves: those beyond the eighth have the colours of the first again, dashed. */
export function dashOf(number) {
  return [[], [7, 3], [2, 3]][Math.floor(number / 8) % 3];
}

const RAMP = 8; // colours of the style sheet from low to high

/** Colour of one of `count` values in their order, as amplitudes are. */
export function ramp(rank, count) {
  return count < 2 ? colour(0) : `--ramp-${Math.round((rank * (RAMP - 1)) / (count - 1))}`;
}

const FAINT = "38"; // how much of a curve is left beside the one that stands out, as the end of its colour

const inks = new Map(); // colours of the theme by their names: asking the page for each stroke takes longer than to draw it

/** Draw all pictures again, in the colours of the theme. */
export function recolour() {
  inks.clear();
  for (const canvas of document.querySelectorAll("canvas.plot")) canvas.dispatchEvent(new Event("recolour"));
}

/**
 * One pair of axes with curves.
 *
 * A curve: {label, colour, x, y, low?, high?, dashed? (per point: the line to it is dashed), marks? (per point: "dot",
 * "triangle", "cross", "" none), line (false: marks alone), points (what a click on each gives)}. null in y: a gap.
 */
export class Plot {
  /**
   * `height` [pixel], or a share of the window's. `chosen`: a band that was drawn, which stays in sight; null: none.
   * `extra`: {areas, texts, notes} behind and beside the curves, see `panels_of`; a note {x, y, to?, text} marks a value.
   * `lit`: number of the curve that stands out; null: none. `handles`: [{x, y, mark, label}] that are
   * dragged: `ondrag(handle, x, y, last)`.
   */
  constructor({ x, y, label, height = 260, equal = false, onpick = null, onband = null, onmove = null, ondrag = null, quiet = false }) {
    Object.assign(this, { x, y, size: height, equal, onpick, onband, onmove, ondrag, curves: [], lines: [], extra: {}, handles: [] });
    this.view = null;
    this.cursor = null;
    this.banding = false;
    this.chosen = null;
    this.lit = null;
    this.hidden = new Set(); // labels of curves
    this.canvas = h("canvas", { tabIndex: 0, role: "img", "aria-label": label, class: "plot" });
    this.readout = h("p", { class: "readout", role: "status", "aria-live": "polite" });
    this.readout.hidden = quiet;
    this.element = h("div", { class: "plotted" }, this.canvas, this.readout);
    this.listen();
    this.observer = new ResizeObserver(() => this.later());
    this.observer.observe(this.element);
  }

  /** Pixels from top to bottom. */
  get height() {
    return this.size > 1 ? this.size : Math.max(LOWEST, Math.round(this.size * window.innerHeight));
  }

  /** Pixels below the axis: less where nothing is written there. */
  get foot() {
    return this.x.label ? BOTTOM : BARE;
  }

  set(curves, { keep = true, lines = [], extra = {} } = {}) {
    this.curves = curves;
    this.lines = lines;
    this.extra = extra;
    if (!keep) this.view = null;
    if (this.here) this.show(this.there(this.here) ? this.here : null);
    this.later();
  }

  /** Whether there is such a point (still). */
  there(where) {
    return where && where.index < (this.curves[where.curve]?.x.length ?? 0);
  }

  later() {
    if (this.asked) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      this.draw();
    });
  }

  /** Limits of both axes: those that were chosen, or all that there is. */
  limits() {
    if (this.view?.x && this.view.y) return { x: this.view.x, y: this.view.y };
    const natural = {};
    const [from, to] = this.x.range ?? [-Infinity, Infinity];
    const seen = (c) => (this.x.range ? c.y.filter((_, i) => c.x[i] >= from && c.x[i] <= to) : c.y);
    const all = this.curves.filter((c) => !this.hidden.has(c.label));
    for (const [axis, lists] of [["x", this.x.range ? [this.x.range] : all.map((c) => c.x)], ["y", this.y.range ? [this.y.range] : all.map(seen)]]) {
      let [low, high] = extent(lists) ?? (this[axis].log ? [0.1, 10] : [-1, 1]);
      if (this[axis].log && low > 0) {
        const more = Math.max(1.05, (high / low) ** 0.03);
        [low, high] = [low / more, high * more];
      } else {
        const more = Math.max((high - low) * 0.06, this[axis].least ?? Math.abs(high) * 1e-3, 1e-12);
        [low, high] = [low - more, high + more];
      }
      natural[axis] = [low, high];
    }
    const found = { x: this.view?.x ?? natural.x, y: this.view?.y ?? natural.y };
    if (this.equal && !this.view) {
      const [w, hgt] = [this.width - LEFT - RIGHT, this.height - TOP - this.foot];
      const unit = Math.max((found.x[1] - found.x[0]) / w, (found.y[1] - found.y[0]) / hgt);
      for (const [axis, pixels] of [["x", w], ["y", hgt]]) {
        const middle = (found[axis][0] + found[axis][1]) / 2;
        found[axis] = [middle - (unit * pixels) / 2, middle + (unit * pixels) / 2];
      }
    }
    return found;
  }

  scales() {
    const { x, y } = this.limits();
    const make = (log, [low, high], from, to) => {
      const [f, back] = log ? [Math.log, Math.exp] : [(v) => v, (v) => v];
      const slope = (to - from) / (f(high) - f(low));
      return { at: (v) => from + (f(v) - f(low)) * slope, of: (p) => back(f(low) + (p - from) / slope) };
    };
    return {
      x: make(this.x.log, x, LEFT, this.width - RIGHT), y: make(this.y.log, y, this.height - this.foot, TOP), limits: { x, y },
    };
  }

  draw() {
    this.width = Math.max(240, this.element.clientWidth);
    const ratio = window.devicePixelRatio || 1;
    const [w, hgt] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (this.canvas.width !== w || this.canvas.height !== hgt) {
      this.canvas.width = w;
      this.canvas.height = hgt;
    }
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    this.strokes(new CanvasPen(context), true);
  }

  svg({ legend = true } = {}) {
    const pen = new SvgPen(this.width, this.height + (legend ? 18 * this.curves.length : 0));
    const ground = getComputedStyle(document.body).backgroundColor;
    pen.path([["M", 0, 0], ["L", this.width, 0], ["L", this.width, pen.size[1]], ["L", 0, pen.size[1]], ["Z"]], { fill: ground });
    this.strokes(pen, false);
    if (legend) {
      this.curves.forEach((c, i) => {
        const y = this.height + 9 + 18 * i;
        pen.path([["M", LEFT, y], ["L", LEFT + 24, y]], { stroke: this.ink(c.colour), width: 2 });
        pen.text(c.label, LEFT + 32, y, { colour: this.ink(), align: "left" });
      });
    }
    return pen.toString();
  }

  ink(name = "--ink") {
    if (!inks.has(name)) inks.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
    return inks.get(name);
  }

  strokes(pen, live) {
    const scale = this.scales();
    const { limits } = scale;
    const [ink, grid, dim] = [this.ink(), this.ink("--grid"), this.ink("--dim")];
    const [bottom, right] = [this.height - this.foot, this.width - RIGHT];
    const none = !this.curves.some((c) => c.x.length);
    const place = { x: (v) => [["M", v, TOP], ["L", v, bottom]], y: (v) => [["M", LEFT, v], ["L", right, v]] };
    for (const axis of ["x", "y"]) {
      for (const tick of none ? [] : ticks(...limits[axis], this[axis].log, axis === "x" ? this.width / 90 : this.height / 42)) {
        const at = scale[axis].at(tick.value);
        pen.path(place[axis](at), { stroke: grid, width: tick.minor ? 0.5 : 1 });
        if (!tick.label) continue;
        if (axis === "x") pen.text(tick.label, at, bottom + 14, { colour: ink });
        else pen.text(tick.label, LEFT - 7, at, { colour: ink, align: "right" });
      }
    }
    if (none) pen.text("nothing yet", (LEFT + right) / 2, (TOP + bottom) / 2, { colour: dim });
    for (const { axis, value } of none ? [] : this.lines) pen.path(place[axis](scale[axis].at(value)), { stroke: dim, width: 1, dash: [6, 4] });
    pen.path([["M", LEFT, TOP], ["L", LEFT, bottom], ["L", right, bottom], ["L", right, TOP], ["Z"]], { stroke: dim, width: 1 });
    pen.text(this.x.label, (LEFT + right) / 2, this.height - 9, { colour: ink });
    pen.text(this.y.label, 14, (TOP + bottom) / 2, { colour: ink, turned: true });
    pen.clip(LEFT, TOP, right - LEFT, bottom - TOP, () => {
      for (const area of this.extra.areas ?? []) this.area(pen, area, scale);
      const lit = this.curves[this.lit];
      const order = [...this.curves].sort((a, b) => (a === lit) - (b === lit) || Boolean(b.overlaid) - Boolean(a.overlaid));
      for (const curve of order) { // overlaid curves do not hide the others
        if (!this.hidden.has(curve.label)) this.curve(pen, curve, scale, lit && curve !== lit ? FAINT : "");
      }
      this.notes(pen, scale);
      this.grips(pen, scale);
      const band = this.band ?? this.chosen?.map(scale.x.at);
      if (live && band) {
        const [a, b] = band;
        pen.path([["M", a, TOP], ["L", b, TOP], ["L", b, bottom], ["L", a, bottom], ["Z"]], { fill: this.ink("--band") });
      }
    });
    if (live && this.cursor !== null) {
      const at = scale.x.at(this.cursor);
      if (at >= LEFT && at <= right) pen.path([["M", at, TOP], ["L", at, bottom]], { stroke: dim, width: 1, dash: [2, 3] });
    }
    if (live && this.picked) {
      const p = this.spot(this.picked, scale);
      if (p) pen.path([["O", p.x, p.y, 8]], { stroke: ink, width: 2 });
    }
  }

  /** What stands behind the curves: a region, or a band over all of the other axis. */
  area(pen, { x, y, colour: name, spans, fill }, scale) {
    const [bottom, right] = [this.height - this.foot, this.width - RIGHT];
    const px = x.map((v, i) => (spans === "x" ? LEFT + v * (right - LEFT) : scale.x.at(x[i])));
    const py = y.map((v, i) => (spans === "y" ? bottom - v * (bottom - TOP) : scale.y.at(y[i])));
    const ink = name === null ? this.ink("--dim") : this.ink(colour(name));
    pen.path([...px.map((v, i) => [i ? "L" : "M", v, py[i]]), ["Z"]], fill ? { fill: `${ink}26` } : { stroke: ink, width: 1 });
  }

  /** Values that are marked: a ring, a bar to another value, and in words what it is. */
  notes(pen, scale) {
    const [right, bottom] = [this.width - RIGHT, this.height - this.foot];
    const at = ({ x, y }) => ({ x: scale.x.at(x), y: scale.y.at(y) });
    const seen = (this.extra.notes ?? []).map((n) => ({ ...n, at: at(n) })).filter((n) => n.at.x >= LEFT && n.at.x <= right && Number.isFinite(n.at.y));
    for (const { at: p, to, colour: name } of seen) {
      const ink = this.ink(name ?? "--ink");
      if (to !== undefined) pen.path([["M", p.x, p.y], ["L", p.x, scale.y.at(to)]], { stroke: ink, width: 3 });
      pen.path([["O", p.x, p.y, 4]], { stroke: ink, width: 1.5, fill: this.ink("--ground") });
    }
    const worded = [...seen.filter((n) => n.text).map((n) => ({ ...n.at, text: n.text, ink: "--ink" })), ...(this.extra.texts ?? []).map((t) => ({ ...at(t), text: t.text, ink: "--dim" }))];
    if (!worded.length) return;
    const lines = this.curves.filter((c) => !this.hidden.has(c.label)).flatMap((c) => this.pixels(c, scale));
    for (const n of seen) if (n.to !== undefined) lines.push([[n.at.x, n.at.y], [n.at.x, scale.y.at(n.to)]]);
    for (const { axis, value } of this.lines) lines.push(axis === "y" ? [[LEFT, scale.y.at(value)], [right, scale.y.at(value)]] : [[scale.x.at(value), TOP], [scale.x.at(value), bottom]]);
    const places = placed(worded, lines, { left: LEFT + 2, right: right - 2, top: TOP + 2, bottom: bottom - 2 });
    worded.forEach((n, i) => {
      const { x, y, align, leads } = places[i];
      if (leads) pen.path([["M", n.x, n.y + 5 * Math.sign(y - n.y)], ["L", x, y - 7 * Math.sign(y - n.y)]], { stroke: this.ink("--dim"), width: 1 });
      pen.text(n.text, x, y, { colour: this.ink(n.ink), align, ground: this.ink("--ground") });
    });
  }

  /** What can be dragged: poles are crosses, zeros rings. */
  grips(pen, scale) {
    for (const { x, y, mark } of this.handles) {
      const [px, py] = [scale.x.at(x), scale.y.at(y)];
      const own = { stroke: this.ink("--accent"), width: 2.5 };
      if (mark === "ring") pen.path([["O", px, py, 6]], { ...own, fill: this.ink("--ground") });
      else if (mark === "cross") pen.path([["M", px - 5, py - 5], ["L", px + 5, py + 5], ["M", px + 5, py - 5], ["L", px - 5, py + 5]], own);
    }
  }

  /** The handle under a place; null: none. */
  grip(px, py) {
    const { x, y } = this.scales();
    const found = nearest(this.handles.map((g) => ({ x: x.at(g.x), y: y.at(g.y) })), px, py, GRIP);
    return found === null ? null : this.handles[found];
  }

  /** A curve as lines of pixels without gaps; of marks alone each by itself. */
  pixels({ x, y, line }, scale) {
    const points = x.map((v, i) => [scale.x.at(v), y[i] === null ? NaN : scale.y.at(y[i])]).filter((p) => p.every(Number.isFinite));
    return line === false ? points.map((p) => [p, p]) : [points];
  }

  curve(pen, curve, scale, faint) {
    const colour = this.ink(curve.colour) + faint;
    const xs = curve.x.map((v) => scale.x.at(v));
    const ys = curve.y.map((v) => (v === null || !Number.isFinite(v) ? null : scale.y.at(v)));
    if (curve.line !== false) {
      for (const dashed of curve.dashed ? [false, true] : [false]) {
        const steps = [];
        let last = null; // point before, and the one that the line has come to
        let at = null;
        ys.forEach((y, i) => {
          if (y === null) return;
          const mine = Boolean(curve.dashed?.[i]) || Boolean(last !== null && curve.dashed?.[last]);
          if (last !== null && mine === dashed) {
            if (at !== last) steps.push(["M", xs[last], ys[last]]);
            steps.push(["L", xs[i], y]);
            at = i;
          }
          last = i;
        });
        if (steps.length) pen.path(steps, { stroke: colour, width: curve.width ?? 1.8, dash: dashed ? [6, 4] : curve.dash ?? [] });
      }
    }
    if (curve.low && curve.high) {
      const bars = [];
      ys.forEach((y, i) => {
        if (y === null || curve.low[i] === null || curve.high[i] === null) return;
        const [a, b] = [scale.y.at(curve.low[i]), scale.y.at(curve.high[i])];
        if (Math.abs(a - b) > 3) bars.push(["M", xs[i], a], ["L", xs[i], b], ["M", xs[i] - 3, a], ["L", xs[i] + 3, a], ["M", xs[i] - 3, b], ["L", xs[i] + 3, b]);
      });
      if (bars.length) pen.path(bars, { stroke: colour, width: 1 });
    }
    if (!curve.marks) return;
    const shapes = { dot: [], triangle: [], cross: [], square: [] };
    const many = ys.length > 400;
    const size = curve.size ?? (many ? 2 : 3.5);
    let [lastX, lastY] = [-1, -1];
    ys.forEach((y, i) => {
      const kind = curve.marks[i];
      const at = y ?? (kind === "cross" ? this.height - this.foot - 8 : null);
      if (!kind || at === null) return;
      const x = xs[i];
      if (many && kind === "dot") { // one beside another cannot be told from it
        if (Math.abs(x - lastX) < 1.5 && Math.abs(at - lastY) < 1.5) return;
        [lastX, lastY] = [x, at];
      }
      if (kind === "dot") shapes.dot.push(["O", x, at, size]);
      else if (kind === "triangle") shapes.triangle.push(["M", x, at - size - 1], ["L", x + size + 1, at + size], ["L", x - size - 1, at + size], ["Z"]);
      else if (kind === "square") shapes.square.push(["M", x - size, at - size], ["L", x + size, at - size], ["L", x + size, at + size], ["L", x - size, at + size], ["Z"]);
      else shapes.cross.push(["M", x - 4, at - 4], ["L", x + 4, at + 4], ["M", x + 4, at - 4], ["L", x - 4, at + 4]);
    });
    if (shapes.dot.length) pen.path(shapes.dot, { fill: colour });
    if (shapes.triangle.length) pen.path(shapes.triangle, { fill: this.ink("--ground"), stroke: colour });
    if (shapes.square.length) pen.path(shapes.square, { fill: this.ink("--ground"), stroke: colour });
    if (shapes.cross.length) pen.path(shapes.cross, { stroke: colour, width: 2 });
  }

  spot({ curve, index }, scale = this.scales()) {
    const c = this.curves[curve];
    if (!c || index >= c.x.length) return null;
    const y = c.y[index];
    const at = y === null || !Number.isFinite(y) ? (c.marks?.[index] === "cross" ? this.height - this.foot - 8 : null) : scale.y.at(y);
    return at === null ? null : { x: scale.x.at(c.x[index]), y: at };
  }

  near(px, py, most) {
    const scale = this.scales();
    const all = this.curves.flatMap((c, curve) => (this.hidden.has(c.label) ? [] : c.x.map((_, index) => ({ curve, index }))));
    const found = nearest(all.map((a) => this.spot(a, scale)), px, py, most);
    return found === null ? null : all[found];
  }

  show(where) {
    if (!where) {
      this.cursor = null;
      this.readout.textContent = "";
    } else {
      const c = this.curves[where.curve];
      this.cursor = c.x[where.index];
      this.readout.textContent = `${c.label}: ${said(this.x.label, c.x[where.index])}, ${said(this.y.label, c.y[where.index])}` +
        `${c.says?.[where.index] ? `, ${c.says[where.index]}` : ""}`;
    }
    this.here = where;
    this.onmove?.(this.cursor);
    this.later();
  }

  zoom(factor, px, py, axes = ["x", "y"]) {
    const { limits, ...scale } = this.scales();
    const view = { ...limits };
    for (const axis of axes) {
      const about = scale[axis].of(axis === "x" ? px : py);
      view[axis] = limits[axis].map((v) => (this[axis].log ? about * (v / about) ** factor : about + (v - about) * factor));
    }
    this.view = view;
    this.later();
    this.onview?.(this.view);
  }

  pan(dx, dy) {
    const { limits, x, y } = this.scales();
    const shift = (scale, [low, high], d) => [scale.of(scale.at(low) - d), scale.of(scale.at(high) - d)];
    this.view = { x: shift(x, limits.x, dx), y: shift(y, limits.y, dy) };
    this.later();
    this.onview?.(this.view);
  }

  whole() {
    this.view = null;
    this.later();
    this.onview?.(null);
  }

  listen() {
    const canvas = this.canvas;
    let held = null;
    canvas.addEventListener("recolour", () => this.later());
    canvas.addEventListener("pointerdown", (event) => {
      held = { x: event.offsetX, y: event.offsetY, from: event.offsetX, moved: false, grip: this.ondrag && this.grip(event.offsetX, event.offsetY) };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const [x, y] = [event.offsetX, event.offsetY];
      if (!held) {
        this.show(this.near(x, y, 60));
        if (this.ondrag) canvas.style.cursor = this.grip(x, y) ? "grab" : "";
        return;
      }
      if (held.grip) {
        held.moved = true;
        this.drag(held.grip, x, y, false);
        return;
      }
      if (Math.abs(x - held.from) + Math.abs(y - held.y) > 3) held.moved = true;
      if (this.banding || event.shiftKey) this.band = [held.from, x].sort((a, b) => a - b);
      else if (held.moved) this.pan(x - held.x, y - held.y);
      [held.x, held.y] = this.banding ? [held.x, held.y] : [x, y];
      this.later();
    });
    canvas.addEventListener("pointerup", (event) => {
      const band = this.band;
      const { moved, grip } = held ?? {};
      [held, this.band] = [null, null];
      if (grip && moved) this.drag(grip, event.offsetX, event.offsetY, true);
      else if (band && band[1] - band[0] > 4) {
        const { x } = this.scales();
        this.onband?.(x.of(band[0]), x.of(band[1]));
      } else if (!moved) this.pick(this.near(event.offsetX, event.offsetY, TOUCH));
      this.later();
    });
    canvas.addEventListener("pointercancel", () => {
      [held, this.band] = [null, null];
      this.later();
    });
    canvas.addEventListener("pointerleave", () => !held && this.show(this.there(this.picked) ? this.picked : null));
    canvas.addEventListener("dblclick", () => this.whole());
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return; // the page scrolls, until the picture is chosen
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * 0.0015), event.offsetX, event.offsetY, event.shiftKey ? ["x"] : ["x", "y"]);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const middle = [(LEFT + this.width - RIGHT) / 2, (TOP + this.height - this.foot) / 2];
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      const curve = { ArrowUp: -1, ArrowDown: 1 }[event.key];
      if (step) this.show(this.beside(step));
      else if (curve) this.show(this.other(curve));
      else if (event.key === "Enter" && this.here) this.pick(this.here);
      else if (event.key === "+") this.zoom(0.8, ...middle);
      else if (event.key === "-") this.zoom(1.25, ...middle);
      else if (event.key === "0") this.whole();
      else return;
      event.preventDefault();
    });
  }

  drag(grip, px, py, last) {
    const { x, y } = this.scales();
    this.ondrag(grip, x.of(px), y.of(py), last);
  }

  beside(step) {
    const { curve = 0, index = step > 0 ? -1 : this.curves[0]?.x.length ?? 0 } = this.here ?? {};
    const c = this.curves[curve];
    if (!c) return null;
    return { curve, index: Math.max(0, Math.min(c.x.length - 1, index + step)) };
  }

  other(step) {
    const count = this.curves.length;
    if (!count) return null;
    const curve = ((this.here?.curve ?? 0) + step + count) % count;
    return { curve, index: Math.min(this.here?.index ?? 0, this.curves[curve].x.length - 1) };
  }

  pick(where) {
    this.picked = where;
    this.later();
    this.onpick?.(where ? this.curves[where.curve].points?.[where.index] ?? null : null, where);
  }
}

/** A value with the name and the unit of its axis: "gain [dB]", 1 → "gain 1 dB". */
function said(label, value) {
  const [, name, unit] = label.match(/^(.*?) *(?:\[(.*)\])?$/);
  return `${name} ${shown(value)}${unit && unit !== "1" && unit !== "–" ? ` ${unit}` : ""}`;
}
