// A model: its card, its operating point, its measurements.

import { begin, done, factsOf, get, goOn, lookAgain, onChange, post, server, whole } from "./api.js";
import { code, fill, h, say, table, wrongs } from "./dom.js";
import { Form } from "./form.js";
import { shown, unitShown } from "./numbers.js";
import { live } from "./work.js";

const TABS = [["card", "Card"], ["point", "Operating point"], ["measure", "Measure"]];

export async function modelPage([name, tab = "card", ...rest]) {
  const known = await factsOf(name);
  const content = h("div");
  const tabs = known.components ? [...TABS, ["diagram", "Diagram"]] : [...TABS, ["loop", "Close a loop"]];
  const page = { card, point, measure }[tab] ?? card;
  const shownPage = await page(name, known, content, rest);
  const address = (id) => (id === "diagram" ? `#/system/${encodeURIComponent(name)}` : id === "loop" ? `#/system/new/${encodeURIComponent(name)}` : `#/open/${encodeURIComponent(name)}/${id}`);
  return {
    title: known.model,
    leave: shownPage?.leave,
    element: h("div", {},
      h("h1", {}, known.model), h("p", { class: "dim" }, known.description ?? name),
      h("nav", { class: "tabs", "aria-label": "Of this model" }, tabs.map(([id, label]) => h("a", { href: address(id), "aria-current": id === tab ? "page" : null }, label))),
      content),
  };
}

// -- card --------------------------------------------------------------------------------------------

async function card(name, known, content) {
  const rows = [["file", name], ["FMI", known.fmi_version], ["made by", known.generation_tool], ["interfaces", (known.interfaces ?? []).join(", ")],
    ["runs here", known.runs_here?.join(", ") || (known.runnable ? "yes" : "no: it has no binary for this machine")], ["platforms", known.platforms?.join(", ")], ["solver", known.solver]];
  const health = h("div", { role: "status" }, h("p", { class: "dim" }, "Checked in the background …"));
  const variables = ["inputs", "outputs", "states", "parameters"].flatMap((kind) => (known[kind] ?? []).map((v) => ({ ...v, kind: kind.slice(0, -1) })));
  fill(content,
    h("div", { class: "cards" },
      h("section", {}, h("h2", {}, "What it is"), h("dl", {}, rows.filter(([, v]) => v).flatMap(([k, v]) => [h("dt", {}, k), h("dd", {}, v)]))),
      h("section", {}, h("h2", {}, "Health"), health)),
    known.call.remarks.length ? h("section", {}, h("h2", {}, "Remarks"), h("ul", {}, known.call.remarks.map((n) => h("li", {}, n)))) : null,
    h("h2", {}, `${variables.length} variables`), variableTable(variables),
    code(known.call.line, "The same in a terminal"));
  if (known.runnable && !known.components) {
    const earlier = [...server.works.values()].find((w) => w.command === "check" && w.subject[0] === name && w.state !== "failed");
    const work = earlier ?? (await begin("check", name, {}, { aside: true }));
    const look = () => healthOf(work.number, health);
    const end = onChange((w) => w.number === work.number && look());
    look();
    return { leave: end };
  }
  fill(health, h("p", {}, known.components ? `${known.components.length} components, ${known.connections.length} connections` : "It cannot run here."));
  return null;
}

async function healthOf(number, place) {
  const work = server.works.get(number);
  if (work.state === "running" || work.state === "waiting") {
    fill(place, h("p", { class: "dim" }, `Checked in the background: ${work.done} of ${work.total || "…"}`), h("progress", { max: work.total || 1, value: work.done, "aria-label": "check" }));
    return;
  }
  const full = await whole(number);
  if (!full.record) {
    fill(place, h("p", { class: "bad" }, full.failure.message ?? work.state));
    return;
  }
  const counted = {};
  for (const line of full.record.checks) counted[line.verdict] = [...(counted[line.verdict] ?? []), line];
  const tones = { good: "good", watch: "watch", poor: "watch", broken: "bad" };
  fill(place,
    h("p", {}, Object.entries(counted).map(([verdict, lines], i) => [i ? ", " : "", h("strong", { class: tones[verdict] ?? "dim" }, `${lines.length} ${verdict}`)])),
    h("ul", {}, full.record.checks.filter((l) => ["broken", "poor", "watch"].includes(l.verdict)).map((l) => h("li", {}, h("strong", { class: tones[l.verdict] }, l.name), ` ${l.evidence ?? ""}`))),
    h("p", {}, h("a", { href: `#/run/${number}` }, "The whole check")));
}

/** Variables that can be searched; only those in sight are elements, so that thousands scroll smoothly. */
function variableTable(all) {
  const height = 26;
  let rows = all;
  const inner = h("div", { class: "inner" });
  const box = h("div", { class: "window", tabIndex: 0, role: "region", "aria-label": "Variables" }, inner);
  const count = h("span", { class: "dim", role: "status" }, "");
  const draw = () => {
    inner.style.height = `${rows.length * height}px`;
    box.style.height = `${Math.min(420, Math.max(1, all.length) * height + 2)}px`;
    const first = Math.max(0, Math.floor(box.scrollTop / height) - 5);
    const seen = rows.slice(first, first + Math.ceil((box.clientHeight || 420) / height) + 10);
    fill(inner, seen.map((v, i) => h("div", { class: "line", style: `top: ${(first + i) * height}px` },
      h("span", { title: v.name }, v.name), h("span", { class: "dim" }, v.kind), h("span", {}, shown(v.start)), h("span", { class: "dim" }, unitShown(v.unit)), h("span", { class: "dim", title: v.description ?? "" }, v.description ?? ""))));
  };
  const search = h("input", {
    type: "search", class: "wide", placeholder: "Search name, description, unit", "aria-label": "Search variables",
    oninput: () => {
      const text = search.value.toLowerCase();
      rows = all.filter((v) => `${v.name} ${v.description ?? ""} ${v.unit ?? ""} ${v.kind}`.toLowerCase().includes(text));
      count.textContent = `${rows.length} of ${all.length}`;
      box.scrollTop = 0;
      draw();
    },
  });
  box.addEventListener("scroll", draw);
  draw();
  return h("div", {}, h("div", { class: "row" }, search, count),
    h("div", { class: "window-head line", "aria-hidden": "true" }, ["name", "kind", "start", "unit", "description"].map((t) => h("span", {}, t))), box);
}

// -- operating point --------------------------------------------------------------------------------------

function point(name, known, content) {
  const values = { u: {}, p: {} };
  const result = h("div", { role: "status" });
  let waits = null;
  let runs = null;
  const changed = () => {
    clearTimeout(waits);
    waits = setTimeout(trim, 250);
  };
  const knobs = (list, kind) => {
    const all = list.filter((v) => v.type === "Real" || typeof v.start === "number");
    const place = h("div");
    const show = (text = "") => {
      const found = all.filter((v) => `${v.name} ${v.description ?? ""}`.toLowerCase().includes(text.toLowerCase()));
      fill(place, found.slice(0, MOST).map((v) => knob(v, values[kind][v.name], (x) => {
        values[kind][v.name] = x;
        changed();
      })), found.length > MOST ? h("p", { class: "dim" }, `${MOST} of ${found.length}; search for the others.`) : null);
    };
    show();
    return [all.length > MOST ? h("input", { type: "search", placeholder: "Search", "aria-label": `Search ${kind === "u" ? "inputs" : "parameters"}`, oninput: (event) => show(event.target.value) }) : null, place];
  };
  async function trim() {
    const asked = {
      u0: Object.entries(values.u).map(([k, v]) => `${k}=${v}`), start_values: Object.entries(values.p).map(([k, v]) => `${k}=${v}`),
      free: free.value.trim() || null, fix: fix.value.split("\n").filter(Boolean),
    };
    const mine = (runs = Symbol("trim"));
    fill(result, h("p", { class: "dim" }, "Trimming …"));
    try {
      const work = await done("trim", name, Object.fromEntries(Object.entries(asked).filter(([, v]) => v?.length)), { aside: true });
      if (mine === runs) showPoint(work, result, known);
    } catch (error) {
      if (mine === runs) fill(result, h("p", { class: "bad" }, wrongs(error)));
    }
  }
  const free = h("input", { id: "free", type: "text", placeholder: "inputs, by commas", onchange: changed, spellcheck: false });
  const fix = h("textarea", { id: "fix", rows: 2, placeholder: "NAME=VALUE, one a line", onchange: changed, spellcheck: false });
  fill(content, h("div", { class: "columns" },
    h("section", {}, h("h2", {}, "Inputs"), knobs(known.inputs, "u"),
      h("details", {}, h("summary", {}, `Parameters (${known.parameters.length})`), knobs(known.parameters, "p")),
      h("details", {}, h("summary", {}, "Find inputs for wanted values"), h("div", { class: "field" }, h("label", { for: "free" }, "Free inputs"), free), h("div", { class: "field" }, h("label", { for: "fix" }, "Wanted values"), fix))),
    h("section", {}, h("h2", {}, "Equilibrium"), result, h("div", { id: "kept" }, keptList(known)))));
  trim();
  return null;
}

const MOST = 40; // knobs at once
const WIDE = 10; // times what the start value spans: a declared range beyond it is too coarse for a slider

function knob(variable, chosen, onvalue) {
  const id = `knob-${variable.name}`;
  const own = typeof variable.start === "number" ? variable.start : 0;
  const start = chosen ?? own;
  const span = Math.max(Math.abs(own) || Math.abs(variable.nominal ?? 0) || 10, Math.abs(start - own));
  const [least, most] = [variable.min ?? -Infinity, variable.max ?? Infinity];
  const ends = [Math.max(least, own - span), Math.min(most, own + span)];
  if (most > least && most - least <= WIDE * span) [ends[0], ends[1]] = [least, most];
  const range = Number.isFinite(least) || Number.isFinite(most) ? `from ${shown(least)} to ${shown(most)}` : "";
  const number = h("input", { id, type: "text", inputMode: "decimal", value: shown(start, 10), "aria-describedby": `${id}-help` });
  const slider = h("input", { type: "range", min: ends[0], max: ends[1], step: (ends[1] - ends[0]) / 200 || "any", value: start, "aria-label": `${variable.name}, slider` });
  number.onchange = () => {
    const x = Number(number.value);
    const good = number.value.trim() !== "" && Number.isFinite(x);
    number.setAttribute("aria-invalid", String(!good));
    if (!good) return;
    if (x < least || x > most) say(`${variable.name}: the model declares values ${range}`, true);
    if (x < Number(slider.min)) slider.min = Math.max(x, least);
    if (x > Number(slider.max)) slider.max = Math.min(x, most);
    slider.value = x;
    onvalue(x);
  };
  slider.oninput = () => {
    number.value = shown(Number(slider.value), 6);
    onvalue(Number(slider.value));
  };
  return h("div", { class: "knob" }, h("label", { for: id, title: [variable.description ?? variable.name, range].filter(Boolean).join(", ") }, variable.name), slider, number, h("span", { class: "dim", id: `${id}-help` }, unitShown(variable.unit)));
}

function showPoint(work, place, known) {
  if (!work.record) {
    fill(place, h("p", { class: "bad" }, work.failure.message ?? work.state));
    return;
  }
  const { operating_point: at, converged } = work.record;
  const label = h("input", { type: "text", "aria-label": "Name of the point", value: freeName() });
  fill(place,
    h("p", { class: converged ? "good" : "bad" }, converged ? "At rest." : "No equilibrium was found; this is where the search ended."),
    work.remarks.map((n) => h("p", { class: "dim" }, n)),
    h("div", { class: "row" }, label, h("button", {
      type: "button", onclick: async () => {
        try {
          const file = (await post(`/api/works/${work.number}/keep`, { name: `${label.value || "point"}.json` })).name;
          await lookAgain();
          fill(document.getElementById("kept"), keptList(known));
          label.value = freeName();
          say(`Kept as ${file}; analyses take it under "At".`);
        } catch (error) {
          say(error.message, true);
        }
      },
    }, "Keep this point")),
    valuesOf(at),
    table(["equation", "residual", "unit"], work.record.residual.map((r) => [r.name, shown(r.value, 3), unitShown(r.unit)]), { caption: "Residuals" }),
    code(work.line, "The same in a terminal"), work.call ? code(work.call, "in Python") : null);
}

/** States, inputs and outputs of an operating point. */
function valuesOf(at) {
  const rows = (values) => Object.entries(values).map(([n, v]) => [n, shown(v), unitShown(at.units[n])]);
  return h("div", { class: "cards" }, table(["state", "value", "unit"], rows(at.x), { caption: "States" }),
    table(["signal", "value", "unit"], [...rows(at.u), ...rows(at.y)], { caption: "Inputs and outputs" }));
}

/** A name under which no point is kept. */
function freeName() {
  const taken = server.files.map((f) => f.name);
  let k = 1;
  while (taken.includes(`point-${k}.json`)) k += 1;
  return `point-${k}`;
}

/** Files of the folder that hold operating points of a model. */
function keptPoints(known) {
  return server.files.filter((f) => f.kind === "point" && f.model === known.model).map((f) => f.name);
}

function keptList(known) {
  const kept = keptPoints(known);
  if (!kept.length) return null;
  return [h("h3", {}, "Kept points"), kept.map((file) => {
    const inside = h("div");
    const open = async (event) => {
      if (!event.target.open) return;
      try {
        fill(inside, valuesOf(JSON.parse((await get(`/api/text?name=${encodeURIComponent(file)}`)).text).operating_point));
      } catch (error) {
        fill(inside, h("p", { class: "bad" }, error.message));
      }
    };
    return h("details", { ontoggle: open }, h("summary", {}, file), inside);
  })];
}

// -- measure ---------------------------------------------------------------------------------------------

const asking = new Map(); // model and command → what was filled in

/** Why a model cannot have an analysis, in words; empty: it can. */
function whyNot(form, known) {
  const needs = (kind, ...names) => form.fields.some((f) => f.required && names.includes(f.name)) && !known[kind].length;
  if (!known.components && !known.runnable) return form.command === "check" ? "" : "it has no binary that runs on this machine";
  if (form.of_system && !known.components) return "it needs a system; close a loop around this model first";
  if (needs("inputs", "input", "inputs", "target")) return "it needs an input, and this model has none";
  if (needs("outputs", "output", "outputs", "source") && !known.states.length) return "it needs an output or a state, and this model has none";
  if (form.command === "branches" && known.interfaces && !known.interfaces.includes("me")) return "it sets the states, which co-simulation does not let it do";
  return "";
}

async function measure(name, known, content, [chosen]) {
  const can = Object.keys(server.forms).filter((c) => !whyNot(server.forms[c], known));
  const command = chosen ?? ["nfr", "simulate", ...can].find((c) => can.includes(c)) ?? "check";
  const form = server.forms[command];
  const why = whyNot(form, known);
  const offered = can.includes(command) ? can : [command, ...can];
  const key = `${name} ${command}`;
  const place = h("section", { "aria-label": "Result" });
  const last = [...server.works.values()].filter((w) => w.command === command && w.subject[0] === name && !w.aside).pop();
  const fields = new Form(form, known, { values: asking.get(key) ?? last?.asked ?? {}, files: keptPoints(known) });
  let shownWork = null;
  const run = h("button", { type: "submit", disabled: Boolean(why) }, `Run ${command}`);
  let end = null;
  const watch = (number) => {
    shownWork?.leave();
    end?.();
    end = onChange((work, event) => { // what turns out to be wrong when the model is open
      if (work.number === number && event.event === "state" && work.failure?.field) fields.wrong({ [work.failure.field]: work.failure.message });
    });
    const hasBand = form.fields.some((f) => f.name === "band");
    shownWork = live(number, { onband: hasBand && ((lo, hi) => (fields.set("band", `${shown(lo, 4)}:${shown(hi, 4)}`), say(`Band ${shown(lo, 4)} … ${shown(hi, 4)} Hz; run to measure it.`))), onagain: again, ongoing: async (stopped) => {
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
    asking.set(key, fields.values());
    if (now) submit();
    else {
      fields.open();
      say("The form holds this point; change what you want, and run.");
    }
  }
  async function submit() {
    const values = fields.values();
    asking.set(key, values);
    fields.wrong({});
    run.disabled = true;
    try {
      const work = await begin(command, name, values);
      watch(work.number);
      place.scrollIntoView({ block: "nearest" }); // "More" may have moved it out of sight
      if (place.getBoundingClientRect().top < 0) place.scrollIntoView({ block: "start" });
    } catch (error) {
      if (error.fields) fields.wrong(error.fields);
      else fields.wrong({ "": error.message });
    } finally {
      run.disabled = false;
    }
  }
  const choose = h("select", { id: "command", onchange: () => { location.hash = `#/open/${encodeURIComponent(name)}/measure/${choose.value}`; } },
    offered.map((c) => h("option", { value: c, selected: c === command }, c)));
  const others = Object.keys(server.forms).filter((c) => !offered.includes(c));
  fill(content, h("div", { class: "columns" },
    h("form", { onsubmit: (event) => { event.preventDefault(); submit(); }, oninput: () => asking.set(key, fields.values()), noValidate: true },
      h("div", { class: "field" }, h("label", { for: "command" }, "Analysis"), choose, h("p", { class: "help" }, form.help)),
      why ? h("p", { class: "watch" }, `Not for this model: ${why}.`) : null,
      fields.element, h("div", { class: "row" }, run),
      others.length ? h("details", {}, h("summary", {}, `${others.length} analyses that this model cannot have`), h("dl", {}, others.flatMap((c) => [h("dt", {}, c), h("dd", {}, whyNot(server.forms[c], known))]))) : null),
    place));
  if (last) watch(last.number);
  else fill(place, h("p", { class: "dim" }, form.counts === "points" ? "Points appear here while they are measured." : "The result appears here.", " Fields with * are needed."));
  return { leave: () => { shownWork?.leave(); end?.(); } };
}
