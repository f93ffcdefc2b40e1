// An analysis of a model: its form, and beside it what it gives.

import { begin, goOn, onChange, server } from "./api.js";
import { fill, h, say, wrongs } from "./dom.js";
import { Form } from "./form.js";
import { shown } from "./numbers.js";
import { keptPoints } from "./operating.js";
import { mark } from "./rail.js";
import { live } from "./work.js";

const asking = new Map(); // model and command → what was filled in

/** Address of a page of a model. */
export function address(name, ...rest) {
  return `#/open/${[name, ...rest].map(encodeURIComponent).join("/")}`;
}

/** Why a model cannot have an analysis, in words; empty: it can. */
export function whyNot(form, known) {
  const needs = (kind, ...names) => form.fields.some((f) => f.required && names.includes(f.name)) && !known[kind].length;
  if (!known.components && !known.runnable) return form.command === "check" ? "" : "it has no binary that runs on this machine";
  if ((form.of_system || form.command === "tune") && !known.components) return "it needs a system; close a loop around this model first";
  if (needs("inputs", "input", "inputs", "target")) return "it needs an input, and this model has none";
  if (needs("outputs", "output", "outputs", "source") && !known.states.length) return "it needs an output or a state, and this model has none";
  if (form.command === "branches" && known.interfaces && !known.interfaces.includes("me")) return "it sets the states, which co-simulation does not let it do";
  return "";
}

/** The form of an analysis of a model, and beside it what it gave last, or the run of a number. */
export async function measure(name, known, content, [command, number = null]) {
  const form = server.forms[command];
  if (!form) throw new Error(`there is no analysis ${command}`);
  const why = whyNot(form, known);
  const themes = new Map();
  for (const f of Object.values(server.forms)) if (f === form || !whyNot(f, known)) themes.set(f.theme, [...(themes.get(f.theme) ?? []), f]);
  const choose = h("select", { id: "command", onchange: () => { location.hash = address(name, "measure", choose.value); } },
    [...themes].map(([theme, forms]) => h("optgroup", { label: theme }, forms.map((f) => h("option", { value: f.command, selected: f === form }, `${f.question} (${f.command})`)))));
  return asked({
    name, known, content, form, number, why,
    above: [h("div", { class: "field" }, h("label", { for: "command" }, "What do you want to know?"), choose, h("p", { class: "help" }, form.help)), why ? h("p", { class: "watch" }, `Not for this model: ${why}.`) : null],
  });
}

/** Fill the form of an analysis in, for when it is opened. */
export function prefill(name, command, values) {
  asking.set(`${name} ${command}`, values);
}

/** Files that fields name: data, kept points of a model, results of other analyses. */
function filesFor(known) {
  const of = (kind, command = null) => server.files.filter((f) => f.kind === kind && (!command || f.command === command)).map((f) => f.name);
  return { points: keptPoints(known), data: of("data"), studies: of("study"), lin: of("record", "lin"), nfr: of("record", "nfr") };
}

/**
 * A form, and beside it what it gave last, or the run of a number. `above`: what stands over its fields, `beside` over
 * the result; `verb`: what its button says; `more` returns values beside those of its fields, in place of those that it is to `skip`; `usual`: values
 * to begin with. What it returns has `changed`, to be called when `more` has.
 */
export function asked({ name, known, content, form, number = null, why = "", above = [], beside = null, verb = `Run ${form.command}`, more = () => ({}), skip = [], usual = {} }) {
  const { command } = form;
  const key = `${name} ${command}`;
  const place = h("section", { class: "result", "aria-label": "Result" });
  const last = number === null ? [...server.works.values()].filter((w) => w.command === command && w.subject[0] === name && !w.aside).pop() : server.works.get(number);
  const fields = new Form(form, known, { skip, values: { ...usual, ...((number === null ? asking.get(key) : null) ?? last?.asked ?? {}) }, files: filesFor(known) });
  const run = h("button", { type: "submit", disabled: Boolean(why) }, verb);
  const preview = h("code", { class: "preview" });
  const values = () => ({ ...fields.values(), ...more() });
  const changed = () => {
    asking.set(key, values());
    preview.textContent = preview.title = fields.line(form.words, name, values());
  };
  let shownWork = null;
  let watched = null;
  let end = null;
  const watch = (which) => {
    shownWork?.leave();
    end?.();
    watched = which;
    if (location.hash.startsWith("#/run/")) { // the address is that of the run that is shown
      history.replaceState(null, "", `#/run/${which}`);
      mark();
    }
    end = onChange((work, event) => { // what turns out to be wrong when the model is open
      if (work.number !== watched) return;
      if (event.event === "removed") nothing();
      else if (event.event === "state" && work.failure?.field) fields.wrong({ [work.failure.field]: work.failure.message });
    });
    const hasBand = form.fields.some((f) => f.name === "band");
    shownWork = live(which, { onband: hasBand && ((lo, hi) => (fields.set("band", `${shown(lo, 4)}:${shown(hi, 4)}`), changed(), say(`Band ${shown(lo, 4)} … ${shown(hi, 4)} Hz; run to measure it.`))), onagain: again, ongoing: async (stopped) => {
      try {
        watch((await goOn(stopped)).number);
      } catch (error) {
        say(wrongs(error), true);
      }
    } });
    fill(place, shownWork.element);
  };
  function again(values, now = true) {
    for (const [n, v] of Object.entries(values)) fields.set(n, v);
    changed();
    if (now) submit();
    else {
      fields.open();
      say("The form holds this point; change what you want, and run.");
    }
  }
  async function submit() {
    fields.wrong({});
    run.disabled = true;
    try {
      const work = await begin(command, name, values());
      watch(work.number);
      place.scrollIntoView({ block: "nearest" });
      if (place.getBoundingClientRect().top < 0) place.scrollIntoView({ block: "start" });
    } catch (error) {
      fields.wrong(error.fields ?? { "": error.message });
    } finally {
      run.disabled = false;
    }
  }
  function nothing() {
    shownWork?.leave();
    shownWork = null;
    fill(place, h("p", { class: "dim empty" }, form.counts === "points" && server.forms[command] ? "Points appear here while they are measured." : "The result appears here.", " Fields with * are needed."));
  }
  const columns = h("div", { class: "columns", "data-form": folded ? "folded" : "open" });
  const fold = h("button", { type: "button", class: "quiet", "aria-expanded": String(!folded), onclick: () => {
    folded = !folded;
    columns.dataset.form = folded ? "folded" : "open";
    fold.setAttribute("aria-expanded", String(!folded));
    fill(fold, folded ? "Form ›" : "‹ Fold");
  } }, folded ? "Form ›" : "‹ Fold");
  fill(content, fill(columns,
    h("form", { onsubmit: (event) => { event.preventDefault(); submit(); }, oninput: changed, noValidate: true },
      h("div", { class: "go" }, run, fold),
      h("div", { class: "asked-for" },
        above, fields.element, h("p", { class: "help" }, "The same in a terminal:"), preview)),
    h("div", { class: beside ? "looked-at" : "" }, beside, place)));
  changed();
  if (last) watch(last.number);
  else nothing();
  return { changed, leave: () => { shownWork?.leave(); end?.(); } };
}

let folded = false; // the form, on every page
