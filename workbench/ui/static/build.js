// FMUs that are made here: of Modelica, of linear models, of systems, of the sources that an FMU brings.

import { factsOf, server } from "./api.js";
import { h } from "./dom.js";
import { asked } from "./measure.js";
import { head } from "./model.js";

const FORMS = { modelica: "build", record: "export", system: "export", fmu: "compile" }; // kind of a file → what makes an FMU of it
const STEP = "0.001"; // of a container, to begin with [s]

export async function buildPage([name, number = null]) {
  const kind = server.files.find((f) => f.name === name)?.kind;
  const form = server.fileForms[FORMS[kind]];
  if (!form) throw new Error(`${name}: no FMU is made of this`);
  const content = h("div");
  const known = kind === "fmu" || kind === "system" ? await factsOf(name) : null;
  const nothing = { model: name, inputs: [], outputs: [], states: [], parameters: [] };
  const usual = { out: free(name.split(":").pop().replace(/\.\w+$/, "").replace(/.*\//, "")), ...(kind === "system" ? { step: STEP } : {}), ...(kind === "modelica" || kind === "record" ? { platforms: "host" } : {}) };
  const page = asked({ name, known: known ?? nothing, content, form, number, usual, verb: "Make the FMU", above: h("p", { class: "help" }, form.help) });
  return {
    title: `Make an FMU of ${name}`,
    leave: page.leave,
    element: h("div", {}, known ? head(name, known, "build") : h("div", { class: "head" }, h("h1", {}, name), h("span", { class: "dim" }, form.question)), content),
  };
}

/** A name of an FMU that no file has. */
function free(stem) {
  const taken = (name) => server.files.some((f) => f.name === name);
  let k = 1;
  while (taken(k === 1 ? `${stem}.fmu` : `${stem}_${k}.fmu`)) k += 1;
  return k === 1 ? `${stem}.fmu` : `${stem}_${k}.fmu`;
}
