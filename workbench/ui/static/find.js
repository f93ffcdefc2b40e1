// A controller that is wanted: `tune` finds its parameters, which come back to the sliders of the loop.

import { begin, ended, get, onChange, server, stop } from "./api.js";
import { fill, h, told, wrongs } from "./dom.js";
import { write } from "./keep.js";
import { wantedOf, wantedStudy } from "./limits.js";
import { shown, withUnit } from "./numbers.js";

const MARGINS = [["db", "gain margin"], ["deg", "phase margin"]]; // they must be there; the crossover comes as near as it can
const MET = 1e-4; // of its scale: so far beyond a limit is at it

/**
 * The button that finds what is wanted, and what it found. `wanted()` gives margins and crossover, `study()` the study
 * that is chosen or null, `values()` those of the sliders, `free()` the parameters that may change with their limits;
 * `found` takes parameter → value.
 */
export function finding({ name, open, wanted, study, values, free, found }) {
  const halt = h("button", { type: "button", class: "quiet", hidden: true, onclick: () => running && stop(running) }, "Stop");
  const go = h("button", { type: "button", class: "quiet", title: "Let tune choose the ticked parameters within the range of their sliders", onclick: () => find() }, "Find it");
  const says = h("div", { class: "found", role: "status" });
  let running = null;
  async function find() {
    go.disabled = true;
    let end = () => {};
    try {
      const file = study() ?? (await written());
      if (!file) return;
      const asked = { free: free(), study: file, ...(!study() && wanted().hz ? { hard: MARGINS.filter(([key]) => wanted()[key]).map(([, label]) => label) } : {}) };
      running = (await begin("tune", name, asked)).number;
      halt.hidden = false;
      const tell = () => fill(says, h("p", { class: "dim" }, server.works.get(running)?.words || "Opening the model …"));
      end = onChange((work) => work.number === running && tell());
      tell();
      const full = await ended(running);
      end();
      if (!full.record) throw new Error(full.failure?.message ?? full.state);
      found(Object.fromEntries(full.record.parameters.map((p) => [p.name, p.value])));
      fill(says, h("p", {}, full.lead), full.record.requirements.filter((r) => !r.passed).map(missed), held(full.record), atLimits(full.record), h("p", {}, h("a", { href: `#/run/${running}` }, `All of it: tune ${running}`)));
    } catch (error) {
      fill(says, h("p", { class: "bad" }, wrongs(error)));
    } finally {
      end();
      running = null;
      halt.hidden = true;
      go.disabled = false;
    }
  }
  /** The study with what is wanted, beside the system: it stays, to be run again; null: it was not to be replaced. */
  async function written() {
    const path = besideOf(name);
    const text = wantedStudy({ model: modelOf(name), open, set: await values(), ...wanted() });
    const there = server.files.some((f) => f.name === path) ? (await get(`/api/text?name=${encodeURIComponent(path)}`)).text : null;
    return there === text || (await write(path, text, there?.startsWith(text.split("\n")[0]) ? there : null)) ? path : null;
  }
  return h("div", {}, h("div", { class: "row" }, go, halt), says);
}

/** How a study that lies beside a system names it. */
function modelOf(name) {
  return name.includes(":") ? name : name.split("/").at(-1);
}

/** Where the study with what is wanted of a system lies. */
function besideOf(name) {
  return `${name.replace(/^\w+:/, "").replace(/\.\w+$/, "")}_wanted.toml`;
}

/** The study of what is wanted of a system is one of the `file` from now on, into which the values were written. */
export async function moveWanted(name, file) {
  const [old, path] = [besideOf(name), besideOf(file)];
  if (!server.files.some((f) => f.name === old)) return;
  const { text } = await get(`/api/text?name=${encodeURIComponent(old)}`);
  const moved = wantedOf(text, modelOf(name), modelOf(file));
  if (moved && moved !== text) await write(path, moved, path === old ? text : null, `Wrote ${file}; what is wanted of it is in ${path}.`);
}

/** Whether it is met, to the digits that are shown. */
function met(r) {
  return r.passed || (r.excess !== null && r.excess <= MET);
}

/** A requirement that is not met: by how much, or why nothing is known. */
function missed(r) {
  const name = r.at ? `${r.name} (${r.at})` : r.name;
  const limit = [["min", "≥"], ["max", "≤"], ["equal", "="]].filter(([key]) => key in r.limit).map(([key, sign]) => `${sign} ${shown(r.limit[key])}`).join(", ");
  if (met(r)) return h("p", { class: "dim" }, `${name}: at its limit, ${withUnit(shown(r.after), r.unit)}`);
  return told({ word: r.after === null ? "failed" : "violated", tone: "bad", text: `${name}: ${r.after === null ? r.reason : `${withUnit(shown(r.after), r.unit)}, wanted ${limit}`}${r.where ? ` (${r.where})` : ""}` });
}

/** What is met, and holds back what is not. */
function held({ requirements }) {
  const names = [...new Set(requirements.filter((r) => r.active && met(r)).map((r) => r.name))];
  return requirements.every(met) || !names.length ? null : h("p", {}, `Held back by: ${names.join(", ")}.`);
}

/** Parameters that a limit holds: further away there may be more. */
function atLimits({ parameters }) {
  const held = parameters.filter((p) => p.at_bound);
  return held.length ? h("p", { class: "watch" }, `At the end of its range: ${held.map((p) => `${p.name} = ${shown(p.value, 4)}`).join(", ")}.`) : null;
}
