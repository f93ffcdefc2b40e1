// Recorded data: their channels and signals, and the models that are made of them.

import { post, server } from "./api.js";
import { Bode } from "./bode.js";
import { fill, h, say, wrongs } from "./dom.js";
import { address, asked, prefill } from "./measure.js";
import { shown, unitShown } from "./numbers.js";
import { legend } from "./legend.js";
import { Plot, colour } from "./plot.js";

const FEW = 32; // different values of a channel that a person or a program has set: an input, perhaps
const DRAWN = 8; // signals at once
const LINES = 100; // channels in the table
const RESTS = 120; // so long after a move of the picture its signals are asked for again [ms]
const ROLES = [["", "–"], ["input", "input"], ["output", "output"]];

const intervals = new Map(); // file without times → sampling interval, as it was typed

export async function dataPage([name, number = null]) {
  const content = h("div");
  let leave = null;
  const show = async () => {
    leave?.();
    leave = null;
    try {
      const told = await post("/api/data", { name, dt: intervals.get(name) ?? null });
      leave = (told.curves ? response : record)(name, told, content, number).leave;
    } catch (error) {
      fill(content, h("p", { class: "bad" }, error.message), /\bdt\b/.test(error.message) ? untimed(name, show) : null);
    }
  };
  await show();
  return { title: name, leave: () => leave?.(), element: h("div", {}, h("div", { class: "head" }, h("h1", {}, name), h("span", { class: "dim" }, "Recorded data")), content) };
}

/** Ask for the sampling interval of a file that has no times. */
function untimed(name, show) {
  const field = h("input", { type: "text", id: "dt", inputMode: "decimal", value: intervals.get(name) ?? "" });
  return h("form", { class: "row", onsubmit: (event) => {
    event.preventDefault();
    const dt = Number(field.value);
    if (!(dt > 0)) return say("The sampling interval is a positive number of seconds.", true);
    intervals.set(name, dt);
    return show();
  } }, h("label", { for: "dt" }, "Sampling interval [s]"), field, h("button", { type: "submit" }, "Open"));
}

/** A measured frequency response, and a model that is fitted to it. */
function response(name, told, content, number) {
  const bode = new Bode({ title: name, key: name, heights: [0.24, 0.18] });
  bode.show(told.curves);
  const page = asked({ name, known: facts(name, []), content, form: server.fileForms.fit, number, above: h("p", { class: "help" }, server.fileForms.fit.help), beside: h("section", { "aria-label": "Measured response" }, bode.bar(), bode.element) });
  return { leave: () => { page.leave(); bode.leave(); } };
}

/** What a form takes for the description of a model: the channels. */
function facts(name, channels) {
  return { model: name, inputs: channels, outputs: channels, states: [], parameters: [] };
}

/** A record over time. */
function record(name, told, content, number) {
  const { time, channels } = told;
  const roles = guessed(channels);
  const last = server.works.get(number)?.asked;
  if (last) for (const [side, key] of [["input", "inputs"], ["output", "outputs"]]) for (const n of [last[key] ?? []].flat()) roles.set(n, side);
  const drawn = new Set([...roles.keys()].slice(0, DRAWN));
  if (drawn.size < 2) for (const c of channels.slice(0, DRAWN)) drawn.add(c.name);
  const signals = new Signals(name, channels);
  const of = (role) => channels.map((c) => c.name).filter((n) => roles.get(n) === role);
  let page = null;
  const table = channelTable(channels, roles, drawn, () => {
    signals.show([...drawn]);
    page?.changed();
  });
  const dt = intervals.get(name);
  const missing = channels.some((c) => c.missing);
  const even = time.dt === null ? "not equidistant" : `every ${shown(time.dt)} s`;
  const models = server.files.filter((f) => ["fmu", "system"].includes(f.kind));
  const model = h("select", { id: "model" }, models.map((f) => h("option", {}, f.name)));
  const calibrate = () => {
    const named = Object.entries({ inputs: of("input"), outputs: of("output") }).filter(([, names]) => names.length);
    prefill(model.value, "calibrate", { data: name, ...Object.fromEntries(named) });
    location.hash = address(model.value, "measure", "calibrate");
  };
  page = asked({
    name, known: facts(name, channels), content, form: server.fileForms.identify, number, skip: ["inputs", "outputs"],
    usual: { ...(dt ? { dt: String(dt) } : {}), ...(missing ? { repair: true } : {}) },
    more: () => ({ ...(of("input").length ? { inputs: of("input").join(",") } : {}), ...(of("output").length ? { outputs: of("output").join(",") } : {}) }),
    above: [h("p", { class: "help" }, "A linear model from what is marked as input to what is marked as output; the data are judged first."), table],
    beside: [
      h("p", {}, `${shown(time.samples, 9)} samples, ${even}, from ${shown(time.begin)} to ${shown(time.end)} s; ${channels.length} channels.`), told.notes.map((note) => h("p", { class: "dim" }, note)),
      h("section", { "aria-label": "Signals" }, signals.element),
      models.length ? h("div", { class: "row" }, h("label", { for: "model" }, "Which parameters of a model do they tell?"), model, h("button", { type: "button", class: "quiet", onclick: calibrate }, "Calibrate …")) : null,
    ],
  });
  signals.show([...drawn]);
  return page;
}

/** Which channels force and which follow, as far as it can be seen: of two the first forces; else those with few values. */
function guessed(channels) {
  const roles = new Map();
  const set = channels.filter((c) => c.values <= FEW && c.values > 1);
  if (channels.length === 2) roles.set(channels[0].name, "input").set(channels[1].name, "output");
  else if (channels.length <= DRAWN) {
    for (const c of set) roles.set(c.name, "input");
    const others = channels.filter((c) => c.values > FEW);
    if (set.length && others.length === 1) roles.set(others[0].name, "output");
  }
  return roles;
}

/** The channels: which are inputs and outputs, which are drawn. */
function channelTable(channels, roles, drawn, onchange) {
  const body = h("tbody");
  const search = h("input", { type: "search", placeholder: `Filter ${channels.length} channels`, "aria-label": "Filter channels", oninput: () => draw() });
  const more = h("p", { class: "dim" });
  function draw() {
    const parts = search.value.toLowerCase().split(/\s+/);
    const found = channels.filter((c) => parts.every((p) => `${c.name} ${c.unit}`.toLowerCase().includes(p)));
    more.textContent = found.length > LINES ? `${LINES} of ${found.length}; filter for the others.` : "";
    fill(body, found.slice(0, LINES).map((c) => {
      const role = h("select", { "aria-label": `${c.name}: role`, onchange: () => {
        if (role.value) roles.set(c.name, role.value);
        else roles.delete(c.name);
        if (role.value) drawn.add(c.name);
        seen.checked = drawn.has(c.name);
        onchange();
      } }, ROLES.map(([value, label]) => h("option", { value, selected: (roles.get(c.name) ?? "") === value }, label)));
      const seen = h("input", { type: "checkbox", checked: drawn.has(c.name), "aria-label": `Draw ${c.name}`, onchange: () => {
        drawn[seen.checked ? "add" : "delete"](c.name);
        onchange();
      } });
      const range = c.least === null ? "no number" : `${shown(c.least, 4)} … ${shown(c.most, 4)} ${unitShown(c.unit)}`;
      return h("tr", {}, h("td", {}, seen), h("th", { scope: "row" }, h("span", { class: "clip", title: c.name }, c.name), h("span", { class: "dim clip", title: range }, range, c.missing ? h("span", { class: "watch" }, `, ${c.missing} missing`) : null)), h("td", {}, role));
    }));
  }
  draw();
  return h("div", { class: "channels" }, channels.length > 12 ? search : null, h("table", {}, h("thead", {}, h("tr", {}, ["drawn", "channel", "role"].map((t) => h("th", { scope: "col" }, t)))), body), more);
}

/** Signals over time, one picture for each unit; of what is looked at closer more samples are asked for. */
class Signals {
  constructor(name, channels) {
    Object.assign(this, { name, units: new Map(channels.map((c) => [c.name, c.unit])), plots: [], view: null });
    this.element = h("div");
  }

  async show(names) {
    this.names = names.slice(0, DRAWN);
    const groups = new Map();
    for (const n of this.names) groups.set(this.units.get(n), [...(groups.get(this.units.get(n)) ?? []), n]);
    const legends = [];
    this.plots = [...groups].map(([unit, own], k) => {
      const plot = new Plot({
        x: { label: k === groups.size - 1 ? "time [s]" : "", log: false }, y: { label: `${own.length === 1 ? shortened(own[0]) : "signals"} [${unitShown(unit) || "–"}]`, log: false },
        label: `${own.join(", ")} over time. Drag to move, plus, minus and 0 zoom.`, height: groups.size > 2 ? 0.18 : 0.24, quiet: k > 0,
        onmove: (v) => this.plots.forEach((p) => { p.cursor = v; p.later(); }),
      });
      plot.names = own;
      plot.onview = (view) => this.moved(plot, view);
      legends.push(h("div", {}));
      return plot;
    });
    fill(this.element, this.plots.length ? this.plots.map((p, k) => h("div", {}, legends[k], p.element)) : h("p", { class: "dim" }, "Choose channels to draw."));
    this.legends = legends;
    await this.ask(this.view, true);
  }

  /** All pictures show the same stretch of time. */
  moved(plot, view) {
    this.view = view?.x ?? null;
    for (const p of this.plots) {
      if (p !== plot) p.view = view ? { x: view.x, y: p.view?.y ?? p.limits().y } : null;
      p.later();
    }
    clearTimeout(this.waits);
    this.waits = setTimeout(() => this.ask(this.view), RESTS);
  }

  async ask(view, first = false) {
    if (!this.names.length) return;
    const mine = (this.asked = Symbol("asked"));
    try {
      const [begin, end] = view ?? [null, null];
      const told = await post("/api/data", { name: this.name, dt: intervals.get(this.name) ?? null, channels: this.names, begin, end });
      if (mine !== this.asked) return;
      this.plots.forEach((plot, k) => {
        const curves = plot.names.filter((n) => told.signals[n]).map((n, i) => ({ label: n, colour: colour(k + i), x: told.signals[n].x, y: told.signals[n].y, width: 1.2 }));
        plot.set(curves);
        if (first) fill(this.legends[k], legend(curves, [plot]));
      });
    } catch (error) {
      say(wrongs(error), true);
    }
  }
}

function shortened(name) {
  return name.length > 14 ? `${name.slice(0, 13)}…` : name;
}
