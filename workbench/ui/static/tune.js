// A loop that is tuned: every parameter of its blocks at a slider, Bode, Nyquist or Nichols, root locus and step beside.

import { beginDraft, ended, factsOf, forget, get, lookAgain, post, server } from "./api.js";
import { DEPTH } from "./bode.js";
import { fill, h, say, wrongs } from "./dom.js";
import { TONES, endsOf, figures } from "./figures.js";
import { finding, moveWanted } from "./find.js";
import { sourcesInLoops } from "./form.js";
import { closedHandles, handlesOf } from "./handles.js";
import { write } from "./keep.js";
import { bandAround, circle, marginsIn, masksIn, notesOf, numberOf, stepRegions } from "./limits.js";
import { head } from "./model.js";
import { bode, exact, locusRanges, shown, unitShown } from "./numbers.js";
import { Plot, colour, ramp } from "./plot.js";

const NEAR = 4; // times the crossover are the poles away that the root locus shows
const REACH = 1.5; // decades to both sides of where a slider starts
const RESTS = 1200; // after so long a value counts as chosen, and the loop is measured with it [ms]
const GAIN = "loop gain";
const carried = new Map(); // system → what was wanted of it when it was written, which stays
const BELOW = 0.995; // of a crossover, so that its three digits are met
const LOWEST = -60; // of the gain picture [dB]
const SAME = 1e-6; // relative: two loops are one
// Parameters that scale a block as a whole.
const SCALES = { gain: ["gain"], lead_lag: ["gain"], integrator: ["gain"], pi: ["proportional", "integral"], pid: ["proportional", "integral", "derivative"] };
const CYCLING = new Set(["saturation", "dead_band", "relay", "backlash", "rate_limiter", "quantiser", "friction", "lookup"]); // kinds that limit cycles come from

export async function tunePage([name, place = ""]) {
  const known = await factsOf(name);
  const places = sourcesInLoops(known.connections ?? []);
  if (!places.length) throw new Error(`${known.model} has no loop; connect one in the diagram first`);
  const open = place || places[0];
  const { parameters, why } = await post("/api/tune", { name, open });
  return new Workspace(name, known, places, open, parameters, why).page();
}

class Workspace {
  constructor(name, known, places, open, parameters, why) {
    Object.assign(this, { name, known, places, open, why });
    this.parameters = [{ name: GAIN, component: "loop", kind: "factor on all of it", value: 1, unit: "", least: 0, quick: true, help: "Factor on the loop transfer." }, ...parameters.filter((p) => !why || p.quick)];
    this.values = {}; // those that are not as in the file
    this.past = []; // values before each change, for undo
    this.kept = null; // {values, told}: the design that is compared
    this.measured = this.loud = [];
    this.asked = this.running = null;
    this.pictures();
  }

  pictures() {
    const hz = { label: "", log: true };
    const tile = (label, x, y, height, more = {}) => new Plot({ x: { log: false, ...x }, y: { log: false, ...y }, label, height, quiet: true, ...more });
    this.gain = tile("Gain of the open loop", hz, { label: "|L| [dB]", least: 1 }, 0.19);
    this.phase = tile("Phase of the open loop", { label: "frequency [Hz]", log: true }, { label: "arg L [deg]", least: 5 }, 0.185);
    this.nyquist = tile("Nyquist picture", { label: "Re L", range: [-3, 1.5] }, { label: "Im L", range: [-2, 2] }, 0.375, { equal: true });
    this.nichols = tile("Nichols picture", { label: "arg L [deg]" }, { label: "|L| [dB]", least: 1 }, 0.375);
    this.locus = tile("Root locus. Poles of the closed loop are dragged along it, poles and zeros of blocks to where they shall be; a click on it chooses the loop gain.", { label: "real part [1/s]" }, { label: "imaginary part [1/s]" }, 0.32, { onpick: (factor) => factor && this.chosen(factor), ondrag: (handle, x, y, last) => this.dragged(handle, x, y, last) });
    this.step = tile("Step response of the closed loop", { label: "time [s]" }, { label: "step of T" }, 0.32);
    for (const [one, other] of [[this.gain, this.phase], [this.phase, this.gain]]) {
      one.onview = (view) => {
        other.view = view ? { x: view.x, y: other.view?.y ?? other.limits().y } : null;
        other.later();
      };
      one.onmove = (v) => {
        other.cursor = v;
        other.later();
      };
    }
    this.verdict = h("div", { class: "verdict", role: "status" });
    this.numbers = h("div", { class: "numbers" });
    this.stepSays = h("p", { class: "bad note", role: "status" });
    this.wrong = h("p", { class: "bad", role: "alert" });
  }

  page() {
    const { name, known, places, open } = this;
    const at = (where) => `#/tune/${encodeURIComponent(name)}/${encodeURIComponent(where)}`;
    const choose = h("select", { id: "place", onchange: () => { location.hash = at(choose.value); } }, places.map((p) => h("option", { value: p, selected: p === open }, p)));
    this.undoing = h("button", { type: "button", class: "quiet", disabled: true, title: "Take the last change back (Ctrl+Z)", onclick: () => this.undo() }, "Undo");
    this.comparing = h("button", { type: "button", class: "quiet", "aria-pressed": "false", title: "Keep this design in the pictures, beside what is changed from here on", onclick: () => this.compare() }, "Compare");
    this.writing = h("button", { type: "button", onclick: () => this.write() }, "Write into the system");
    this.file = h("input", { type: "text", id: "file", value: name.includes(":") ? `${name.split(":")[1]}.toml` : name, spellcheck: false });
    const wanted = (id, label, value) => h("input", { type: "text", id, "aria-label": label, inputMode: "decimal", value, onchange: () => this.draw() });
    const { db = "6", deg = "45", hz = null } = carried.get(name) ?? {};
    this.crossing = hz;
    this.wanted = { db: wanted("wanted-db", "wanted gain margin, dB", db), deg: wanted("wanted-deg", "wanted phase margin, degrees", deg), hz: wanted("wanted-hz", "wanted crossover, Hz", hz ?? "") };
    this.finder = this.parameters.length > 1 ? finding({
      name, open, study: () => this.required?.name ?? null, values: () => this.measurable(), found: (values) => this.take(values),
      wanted: () => this.least(),
      free: () => this.parameters.filter((p) => this.ticks.get(p.name)?.checked).map((p) => `${p.name}=${reach(p).join(":")}`),
    }) : null;
    this.amplitude = h("input", { type: "text", id: "amplitude", inputMode: "decimal", placeholder: "e.g. 1, 10", spellcheck: false, onchange: () => this.rest(0) });
    this.measuring = h("span", { class: "dim", role: "status" });
    this.cycling = h("p", { class: "help", role: "status" });
    const blocks = [...new Set(this.parameters.filter((p) => CYCLING.has(p.kind)).map((p) => p.component))];
    this.block = blocks.length ? h("select", { id: "block", onchange: () => this.rest(0) }, h("option", { value: "" }, "–"), blocks.map((b) => h("option", {}, b))) : null;
    this.study = h("select", { id: "study", onchange: () => this.require() }, h("option", { value: "" }, "–"), server.files.filter((f) => f.kind === "study").map((f) => h("option", {}, f.name)));
    this.feeding = h("button", { type: "button", class: "quiet", disabled: true, title: "Put the wanted margins into the requirements of the study", onclick: () => this.feed() }, "Into the study");
    this.ticks = new Map();
    this.knobs = new Map(this.parameters.map((p) => [p.name, this.knob(p)]));
    const groups = new Map();
    for (const p of this.parameters) groups.set(p.component, [...(groups.get(p.component) ?? []), p]);
    const second = h("div", {}, this.nyquist.element);
    const other = h("button", { type: "button", class: "bare", "aria-pressed": "false", onclick: () => {
      const on = other.getAttribute("aria-pressed") !== "true";
      other.setAttribute("aria-pressed", String(on));
      other.textContent = on ? "Nichols ⇄" : "Nyquist ⇄";
      fill(second, (on ? this.nichols : this.nyquist).element);
    } }, "Nyquist ⇄");
    const keys = (event) => {
      if (!(event.ctrlKey || event.metaKey) || event.key !== "z" || /^(text|textarea)$/.test(event.target.type ?? "")) return;
      event.preventDefault();
      this.undo();
    };
    addEventListener("keydown", keys);
    this.update();
    return {
      title: `Tune ${known.model}`,
      leave: () => {
        removeEventListener("keydown", keys);
        clearTimeout(this.waits);
        if (this.running) post(`/api/works/${this.running}/stop`).catch(() => {});
      },
      element: h("div", {}, head(name, known, "tune"),
        h("div", { class: "tuning" },
          h("div", { class: "sliders" },
            h("div", { class: "go" }, this.writing), h("div", { class: "row" }, this.undoing, this.comparing),
            h("div", { class: "field" }, h("label", { for: "place" }, "Loop opened at"), choose),
            this.wrong, this.why ? h("p", { class: "watch" }, `Only the gain of the whole loop can be dragged: ${this.why}`) : null,
            [...groups].map(([component, own]) => h("section", {}, h("h2", {}, component, " ", h("span", { class: "dim" }, own[0].kind)), own.map((p) => this.knobs.get(p.name).element))),
            h("div", { class: "field" }, h("label", { for: "amplitude" }, "Measure at amplitudes", h("span", { class: "unit" }, `of ${open}`)), this.amplitude, h("p", { class: "help" }, "The loop with its nonlinear parts, measured in the background whenever a value rests."), this.measuring),
            this.block ? h("div", { class: "field" }, h("label", { for: "block" }, "Limit cycles by the block"), this.block, this.cycling) : null,
            h("div", { class: "field" }, h("label", { for: "wanted-db" }, "Wanted", h("span", { class: "unit" }, "dB, ° and at least Hz")), h("div", { class: "three" }, this.wanted.db, this.wanted.deg, this.wanted.hz), h("p", { class: "help" }, "Margins and crossover. Find it chooses the ticked parameters: as fast as the margins allow."), this.finder),
            h("div", { class: "field" }, h("label", { for: "study" }, "Requirements of"), this.study, h("p", { class: "help" }, "Its margins are wanted, its masks and limits of steps are drawn."), this.feeding),
            h("div", { class: "field" }, h("label", { for: "file" }, "File"), this.file)),
          h("div", {}, h("div", { class: "told" }, this.verdict, this.numbers),
            h("div", { class: "tiles" },
              h("section", { "aria-label": "Bode" }, h("h2", {}, "Bode"), this.gain.element, this.phase.element),
              h("section", { "aria-label": "Nyquist or Nichols" }, h("h2", {}, other), second),
              h("section", { "aria-label": "Root locus" }, h("h2", {}, "Root locus"), this.locus.element),
              h("section", { "aria-label": "Step" }, h("h2", {}, "Step", this.stepSays), this.step.element))))),
    };
  }

  /** A parameter: its name, a number, and a slider that begins where the file has it. */
  knob(p) {
    const id = `tune-${p.name}`;
    const number = h("input", { id, type: "text", inputMode: "decimal", value: exact(p.value), "aria-describedby": p.help ? `${id}-help` : null });
    const log = p.value !== 0;
    const slider = h("input", { type: "range", min: log ? -REACH : -1, max: log ? REACH : 1, step: log ? 0.01 : 0.01, value: 0, "aria-label": `${p.name}, slider` });
    const of = (x) => (log ? p.value * 10 ** x : x);
    const show = (value) => {
      number.value = exact(value);
      number.removeAttribute("aria-invalid");
      slider.value = log ? Math.log10(Math.max(1e-12, value / p.value)) : value;
    };
    let moving = false; // from the first step to where it is let go
    slider.addEventListener("change", () => {
      moving = this.moving = false;
      this.update();
    });
    slider.addEventListener("input", () => {
      if (!moving) this.remember();
      moving = this.moving = true;
      number.value = shown(of(Number(slider.value)), 5);
      this.set(p.name, Number(number.value));
    });
    number.addEventListener("change", () => {
      const value = Number(number.value);
      const good = number.value.trim() !== "" && Number.isFinite(value);
      number.setAttribute("aria-invalid", String(!good));
      if (!good) return;
      this.remember();
      show(value);
      this.set(p.name, value);
    });
    const tick = p.name === GAIN ? null : h("input", { type: "checkbox", checked: p.kind in SCALES && log, "aria-label": `${p.name}: find it`, title: "Find it may change this" });
    this.ticks.set(p.name, tick);
    const label = p.name === GAIN ? "loop gain ×" : p.name.slice(p.component.length + 1);
    return { show, element: h("div", { class: "knob", title: p.help }, h("span", {}, tick, " ", h("label", { for: id }, label)), slider, number, h("span", { class: "unit" }, unitShown(p.unit))) };
  }

  remember() {
    this.past.push({ ...this.values });
    this.undoing.disabled = false;
  }

  set(name, value) {
    const own = this.parameters.find((p) => p.name === name).value;
    if (value === own) delete this.values[name];
    else this.values[name] = value;
    this.update();
  }

  /** A point of the root locus was clicked: this is the factor on the loop there. */
  chosen(factor) {
    this.remember();
    const rounded = Number(factor.toPrecision(5));
    this.knobs.get(GAIN).show(rounded);
    this.set(GAIN, rounded);
  }

  /** A pole or a zero is dragged: its parameters follow. */
  dragged(handle, x, y, last) {
    if (!this.moving) this.remember();
    this.moving = !last;
    for (const [name, value] of Object.entries(handle.to(x, y) ?? {})) {
      const exact = Number(value.toPrecision(5));
      this.knobs.get(name)?.show(exact);
      this.values[name] = exact;
    }
    this.update();
  }

  undo() {
    if (!this.past.length) return;
    this.values = this.past.pop();
    this.undoing.disabled = !this.past.length;
    this.showValues();
  }

  /** Show the values at their sliders, and what the loop is with them. */
  showValues() {
    for (const p of this.parameters) this.knobs.get(p.name).show(this.values[p.name] ?? p.value);
    this.update();
  }

  /** Keep what there is beside what comes, or let it go. */
  compare() {
    this.kept = this.kept ? null : { values: { ...this.values }, told: this.told };
    this.comparing.setAttribute("aria-pressed", String(Boolean(this.kept)));
    this.draw();
  }

  /** Ask what the loop is now: the next value goes when the last answer is there, so that the picture keeps up. */
  async update() {
    this.rest();
    if (this.asking) {
      this.again = true;
      return;
    }
    this.asking = true;
    const values = { ...this.values };
    const begun = performance.now();
    // A locus is the same whatever the loop gain; of other parameters it comes when they rest.
    const shape = JSON.stringify({ ...values, [GAIN]: 1 });
    const locus = shape !== this.shape && !this.moving;
    try {
      this.told = await post("/api/tune", { name: this.name, open: this.open, values, locus });
      if (locus) [this.locusOf, this.shape] = [{ ...this.told.locus, at: values[GAIN] ?? 1 }, shape];
      fill(this.wrong, "");
      this.draw();
      requestAnimationFrame(() => { this.verdict.dataset.ms = String(Math.round(performance.now() - begun)); });
    } catch (error) {
      fill(this.wrong, wrongs(error));
    } finally {
      this.asking = false;
      if (this.again) {
        this.again = false;
        this.update();
      }
    }
  }

  /** Measure the loop at real amplitudes when nothing has changed for a while. */
  rest(after = RESTS) {
    clearTimeout(this.waits);
    this.measured = this.loud = [];
    const cycles = this.block?.value;
    if (!this.amplitude.value.trim()) this.measuring.textContent = "";
    if (!cycles && this.block) this.cycling.textContent = "";
    if (!this.amplitude.value.trim() && !cycles) return;
    this.waits = setTimeout(async () => {
      if (this.amplitude.value.trim()) await this.measure();
      if (cycles) await this.cycles(cycles);
    }, after);
  }

  /** The values as a file can have them. */
  async measurable() {
    const values = await this.folded();
    if (!values) throw new Error("no block carries the whole loop: set the loop gain to 1, and change parameters instead");
    return values;
  }

  /** Values that were found; they are one change. */
  take(values) {
    this.remember();
    this.values = { ...this.values, ...values };
    delete this.values[GAIN]; // it is in them
    this.size = null; // the locus is shown as wide as it is now
    this.showValues();
  }

  /** What is asked of the loop with the values that rest; null: they have changed since. */
  async background(asked) {
    const before = JSON.stringify(this.values);
    const values = await this.measurable();
    if (this.running) await post(`/api/works/${this.running}/stop`).catch(() => {});
    const work = await beginDraft({ name: this.name, open: this.open, values, measure: asked });
    this.running = work.number;
    const full = await ended(work.number);
    if (this.running === work.number) this.running = null;
    if (before !== JSON.stringify(this.values)) return null;
    if (!full.record) throw new Error(full.failure?.message ?? full.state);
    return full;
  }

  /** Look for limit cycles by describing functions, of one block. */
  async cycles(block) {
    this.cycling.textContent = "Looking for limit cycles …";
    try {
      const full = await this.background({ block, methods: "describing function" });
      if (!full) return;
      const found = full.record.limit_cycles;
      fill(this.cycling, found.length ? found.map((c) => h("span", { class: c.stable ? "bad" : "watch" }, `${shown(c.frequency_hz, 3)} Hz, amplitude ${shown(c.amplitude, 3)}, ${c.stable === null ? "stability not known" : c.stable ? "stable: it oscillates" : "unstable: a larger motion grows"}. `)) : "None is predicted.");
    } catch (error) {
      fill(this.cycling, h("span", { class: "bad" }, wrongs(error)));
    }
  }

  /** Take the requirements of a study: its margins are wanted, its masks and steps are drawn. */
  async require() {
    this.required = null;
    const name = this.study.value;
    try {
      if (name) {
        const { text } = await get(`/api/text?name=${encodeURIComponent(name)}`);
        const told = await post("/api/study", { name, text });
        if (told.mistakes.length) throw new Error(told.mistakes[0].message);
        this.required = { ...told, name, text };
        const margins = marginsIn(told.requirements);
        for (const key of ["db", "deg"]) if (margins[key] !== null) this.wanted[key].value = String(margins[key]);
      }
    } catch (error) {
      say(wrongs(error), true);
    }
    this.feeding.disabled = !this.required || name.includes(":");
    this.draw();
  }

  /** Write the wanted margins into the requirements of the study. */
  async feed() {
    const { name, text: was } = this.required;
    let text = was;
    try {
      for (const [kind, field] of [["gain margin", this.wanted.db], ["phase margin", this.wanted.deg]]) {
        const number = numberOf(this.required.requirements, kind);
        const value = Number(field.value);
        if (number === null || !(value > 0)) continue;
        ({ text } = await post("/api/study", { name, text, change: { number, key: "min", value } }));
      }
      if (text === was) say("The study asks for these margins already, or for none.");
      else if (await write(name, text, was)) await this.require();
    } catch (error) {
      say(wrongs(error), true);
    }
  }

  /**
   * The values with the factor on the whole loop taken into a block that carries all of it: there the loop is the same,
   * which is looked at, not believed. Null: there is no such block.
   */
  async folded() {
    const { [GAIN]: factor = 1, ...values } = this.values;
    if (factor === 1) return values;
    for (const component of new Set(this.parameters.map((p) => p.component))) {
      const scaled = this.parameters.filter((p) => p.component === component && (SCALES[p.kind] ?? []).includes(p.name.slice(component.length + 1)));
      if (!scaled.length) continue;
      const tried = { ...values, ...Object.fromEntries(scaled.map((p) => [p.name, factor * (values[p.name] ?? p.value)])) };
      const { open } = await post("/api/tune", { name: this.name, open: this.open, values: tried });
      const own = this.told.open;
      if (open.re.every((re, i) => Math.hypot(re - own.re[i], open.im[i] - own.im[i]) <= SAME * Math.hypot(re, open.im[i]))) return tried;
    }
    return null;
  }

  async measure() {
    try {
      this.measuring.textContent = "Measuring …";
      const crossing = this.told.margins.gain_crossovers.at(-1)?.frequency_hz;
      const full = await this.background({ open: this.open, amplitudes: this.amplitude.value, ...(crossing ? bandAround(crossing) : {}) });
      if (!full) return;
      this.measured = full.curves.filter((c) => c.kind === "measured");
      this.loud = full.record.measured.map((m) => ({ label: `at ${shown(m.amplitude, 4)} ${unitShown(full.record.unit)}`, margins: m.margins, ends: endsOf(m.points) }));
      const texts = full.verdicts.filter((v) => !v.text.startsWith("linear")).map((v) => v.text);
      fill(this.measuring, this.loud.map(({ label, margins: { closed_loop: word } }, i) => h("span", { class: TONES[word] ?? "watch", title: texts[i] ?? "" }, `${word} ${label}. `)));
      this.draw();
    } catch (error) {
      fill(this.measuring, h("span", { class: "bad" }, wrongs(error)));
    }
  }

  async write() {
    try {
      const values = await this.measurable();
      const changed = Object.entries(values); // all digits: a margin may be met by less than a rounded one would leave
      if (!changed.length) return say("Nothing is changed.");
      const { text: was } = await get(`/api/text?name=${encodeURIComponent(this.name)}`);
      let text = was;
      for (const [n, v] of changed) ({ text } = await post("/api/diagram", { name: this.name, text, change: ["set", n, Number.isInteger(v) ? `${v}.0` : String(v)] }));
      if (!(await write(this.file.value, text, this.file.value === this.name ? was : null))) return;
      carried.set(this.file.value, Object.fromEntries(Object.entries(this.wanted).map(([key, { value }]) => [key, value])));
      await moveWanted(this.name, this.file.value);
      forget(this.file.value);
      await lookAgain();
      if (this.file.value !== this.name) location.hash = `#/tune/${encodeURIComponent(this.file.value)}/${encodeURIComponent(this.open)}`;
      else {
        for (const [n, v] of changed) this.parameters.find((p) => p.name === n).value = v;
        await post("/api/tune", { name: this.name, open: this.open }); // it reads the file again
        this.values = {};
        this.past = [];
        this.undoing.disabled = true;
        for (const p of this.parameters) this.knobs.get(p.name).show(p.value);
        this.update();
      }
    } catch (error) {
      say(wrongs(error), true);
    }
  }

  // -- pictures -------------------------------------------------------------------------------------

  draw() {
    const found = this.told;
    if (!found) return;
    this.crossing ??= this.wanted.hz.value = shown(BELOW * (found.margins.gain_crossovers.at(-1)?.frequency_hz ?? NaN), 3).replace(/–|NaN/, ""); // as fast as it is
    const kept = this.kept?.told;
    const designs = [[found, colour(0), "now", []], ...(kept ? [[kept, colour(1), "kept", [6, 4]]] : [])];
    this.say(found, kept);
    const curves = designs.map(([d, own, label, dash]) => ({ b: bode(d.open), own, label, dash, d }));
    const measured = this.measured.map((c, i) => ({ b: bode(c), own: ramp(i, Math.max(2, this.measured.length)), label: c.label, dash: [], d: { open: c }, marks: c.status.map((s) => (s === "failed" ? "cross" : "dot")) }));
    const all = [...curves, ...measured];
    const line = (c, x, y) => ({ label: c.label, colour: c.own, x, y, dash: c.dash, marks: c.marks ?? null, says: c.d.open.frequency_hz.map((f) => `at ${shown(f, 4)} Hz`) });
    const gains = curves.flatMap((c) => c.b.gain.filter((g) => g !== null));
    this.gain.y.range = [Math.max(Math.min(...gains), LOWEST), Math.max(...gains, 6)];
    this.gain.x.range = this.phase.x.range = [curves[0].b.x[0], curves[0].b.x.at(-1)];
    this.gain.set(all.map((c) => line(c, c.b.x, c.b.gain)), { lines: [{ axis: "y", value: 0 }], extra: { notes: notesOf(found, "gain", curves[0].b), areas: this.masks("gain") } });
    this.phase.set(all.map((c) => line(c, c.b.x, c.b.phase)), { lines: [{ axis: "y", value: -180 }], extra: { notes: notesOf(found, "phase", curves[0].b), areas: this.masks("phase") } });
    const point = (x, y) => ({ label: "−1", colour: colour(6), x: [x], y: [y], marks: ["cross"], line: false });
    this.nyquist.set([...all.map((c) => line(c, c.d.open.re, c.d.open.im)), point(-1, 0), circle()], { lines: [{ axis: "x", value: 0 }, { axis: "y", value: 0 }] });
    this.nichols.set([...all.map((c) => {
      const top = Math.max(...c.b.gain.filter((g) => g !== null));
      const seen = c.b.gain.map((g, i) => [g, c.b.phase[i]]).filter(([g]) => g !== null && g >= top + 20 * Math.log10(DEPTH));
      return line(c, seen.map(([, p]) => p), seen.map(([g]) => g));
    }), point(-180, 0)], { lines: [{ axis: "y", value: 0 }], extra: { areas: this.region() } });
    this.drawLocus(designs);
    this.drawStep(designs);
  }

  /** What is wanted at least: {db, deg, hz}; null: nothing. */
  least() {
    return Object.fromEntries(Object.entries(this.wanted).map(([key, { value }]) => [key, Number(value) > 0 ? Number(value) : null]));
  }

  /** What the curve has to stay out of in the Nichols picture, for the margins that are wanted. */
  region() {
    const { db, deg } = this.least();
    return db && deg ? [{ colour: 6, fill: true, x: [-180 - deg, -180, -180 + deg, -180], y: [0, db, 0, -db] }] : [];
  }

  /** What masks of the study the open loop has to stay out of. */
  masks(quantity) {
    const { requirements = [], analyses = [] } = this.required ?? {};
    return masksIn(requirements, analyses.filter((a) => a.command === "loop").map((a) => a.name), quantity);
  }

  drawLocus(designs) {
    const found = this.told;
    const crossing = found.margins.gain_crossovers.at(-1) ?? found.margins.phase_crossovers.at(-1);
    this.size ??= crossing?.frequency_hz ? NEAR * 2 * Math.PI * crossing.frequency_hz : 1.5 * Math.max(1e-6, ...found.poles.re.map((re, i) => Math.hypot(re, found.poles.im[i])));
    [this.locus.x.range, this.locus.y.range] = locusRanges(found.poles, this.size);
    const poles = (label, { re, im }, own, mark) => ({ label, colour: own, x: re, y: im, line: false, marks: re.map(() => mark) });
    const { re = [], im = [], gain = [], at = 1 } = this.locusOf ?? {};
    const others = { ...poles("at other gains", { re, im }, "--edge", "dot"), points: gain.map((g) => g * at) };
    const unstable = { areas: [{ colour: 6, fill: true, x: [0, 1e9, 1e9, 0], y: [0, 0, 1, 1], spans: "y" }] };
    this.locus.handles = [...handlesOf(this.parameters, this.values), ...(this.locusOf ? closedHandles(found.poles, this.locusOf, GAIN) : [])];
    this.locus.set([others, poles("open loop", found.open_poles, "--dim", "cross"), ...designs.map(([d, own, label]) => poles(`closed loop, ${label}`, d.poles, own, "square"))], { lines: [{ axis: "x", value: 0 }], extra: unstable });
  }

  drawStep(designs) {
    const { left_s: left } = this.told.step;
    fill(this.stepSays, left === null ? (this.told.margins.closed_loop === "unstable" ? " Unstable, by a motion that the step does not excite." : "") : ` Unstable: more than 10 away from the step after ${shown(left, 3)} s; shown until then.`);
    this.step.x.range = [0, this.told.step.time.at(-1)];
    this.step.set(designs.map(([d, own, label, dash]) => ({ label, colour: own, dash, x: d.step.time, y: d.step.value })), { lines: [{ axis: "y", value: 1 }], extra: { areas: stepRegions(this.required?.requirements ?? []) } });
  }

  /** The verdict in words, and the margins as numbers, of both designs. */
  say(found, kept) {
    const { word, text } = found.verdict;
    fill(this.verdict, h("strong", { class: TONES[word] ?? "" }, word), ` ${text.replace(/^L: (the closed loop is (un)?stable: )?/, "").replace(/; gain margin.*$/, "")}`);
    fill(this.numbers, figures(found, [...(kept ? [{ ...kept, label: "kept" }] : []), ...this.loud], this.least()));
  }
}

/** From where to where a slider goes. */
function reach({ value, least }) {
  if (value === 0) return [least === null ? -1 : Math.max(-1, least), 1];
  return [value * 10 ** -REACH, value * 10 ** REACH].sort((a, b) => a - b).map((x) => Number(x.toPrecision(5)));
}
