// The operating point of a model: inputs and parameters by sliders, what it is then, and points that are kept.

import { done, get, lookAgain, post, server } from "./api.js";
import { code, fill, h, say, table, wrongs } from "./dom.js";
import { shown, unitShown } from "./numbers.js";

export function operatingPoint(name, known, content) {
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
export function keptPoints(known) {
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
