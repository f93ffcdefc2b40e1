// A model: what can be asked of it, what it is, and whether it is sound.

import { begin, factsOf, onChange, server, whole } from "./api.js";
import { buildPage } from "./build.js";
import { dataPage } from "./data.js";
import { code, fill, h } from "./dom.js";
import { address, measure, whyNot } from "./measure.js";
import { exact, unitShown } from "./numbers.js";
import { operatingPoint } from "./operating.js";
import { range } from "./picker.js";
import { studyPage } from "./study.js";
import { workPage } from "./work.js";

const TABS = [["card", "Model"], ["point", "Operating point"]];
const PAGES = { card, point: operatingPoint, measure };

export async function modelPage([name, tab = "card", ...rest]) {
  const known = await factsOf(name);
  const content = h("div");
  const shownTab = PAGES[tab] && (tab !== "measure" || rest.length) ? tab : "card";
  const shownPage = await PAGES[shownTab](name, known, content, rest);
  return {
    title: known.model,
    leave: shownPage?.leave,
    element: h("div", {}, head(name, known, shownTab), content),
  };
}

/** What stands above every page of a model. */
export function head(name, known, here) {
  const tabs = [...TABS, ...(known.components ? [["diagram", "Diagram"], ["tune", "Tune"], ["build", "Make an FMU"]] : [["loop", "Close a loop"]])];
  const to = (id) => ({ tune: `#/tune/${encodeURIComponent(name)}`, build: `#/build/${encodeURIComponent(name)}`, diagram: `#/system/${encodeURIComponent(name)}`, loop: `#/system/new/${encodeURIComponent(name)}` })[id] ?? address(name, id);
  return h("div", { class: "head" }, h("h1", { title: known.model }, known.model), h("span", { class: "dim clip", title: known.description ?? name }, known.description ?? name),
    h("nav", { class: "tabs", "aria-label": "Of this model" }, tabs.map(([id, label]) => h("a", { href: to(id), "aria-current": id === here ? "page" : null }, label))));
}

/** A run, with the form that asks it again. */
export async function runPage([number]) {
  const work = server.works.get(Number(number)) ?? (await whole(Number(number)));
  const page = { identify: dataPage, fit: dataPage, run: studyPage, envelope: studyPage, build: buildPage, export: buildPage, compile: buildPage }[work.command];
  if (work.subject.length === 1 && page && server.files.some((f) => f.name === work.subject[0])) return page([work.subject[0], Number(number)]);
  if (work.subject.length !== 1 || !server.forms[work.command]) return workPage([number]);
  try {
    await factsOf(work.subject[0]);
  } catch { // its file is gone
    return workPage([number]);
  }
  return modelPage([work.subject[0], "measure", work.command, Number(number)]);
}

/** What can be asked of a model, by what one wants to know; the command beside. */
function intents(name, known) {
  const themes = new Map();
  const never = [];
  for (const form of Object.values(server.forms)) {
    const why = whyNot(form, known);
    if (why) never.push([form, why]);
    else themes.set(form.theme, [...(themes.get(form.theme) ?? []), form]);
  }
  return h("section", { class: "intents" }, h("h2", {}, "What do you want to know?"),
    h("div", { class: "themes" }, [...themes].map(([theme, forms]) => h("div", {}, h("h3", {}, theme),
      forms.map((f) => h("a", { href: address(name, "measure", f.command), title: f.help }, h("span", {}, f.question), h("code", {}, f.command)))))),
    never.length ? h("details", {}, h("summary", {}, `${never.length} questions that this model cannot answer`), h("dl", {}, never.flatMap(([f, why]) => [h("dt", {}, f.command), h("dd", {}, why)]))) : null);
}

async function card(name, known, content) {
  const rows = [["file", name], ["FMI", known.fmi_version], ["made by", known.generation_tool], ["interfaces", (known.interfaces ?? []).join(", ")],
    ["runs here", known.runs_here?.join(", ") || (known.runnable ? "yes" : "no: it has no binary for this machine")], ["platforms", known.platforms?.join(", ")], ["solver", known.solver]];
  const health = h("div", { role: "status" }, h("p", { class: "dim" }, "Checked in the background …"));
  const variables = ["inputs", "outputs", "states", "parameters"].flatMap((kind) => (known[kind] ?? []).map((v) => ({ ...v, kind: kind.slice(0, -1) })));
  fill(content, intents(name, known),
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
  fill(health, h("p", {}, known.components ? `${known.components.length} components, ${known.connections.length} connections` : "It cannot run here."), known.components ? null : h("p", {}, h("a", { class: "button", href: `#/build/${encodeURIComponent(name)}` }, "Compile its sources for this machine")));
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
      h("span", { title: v.name }, v.name), h("span", { class: "dim" }, v.kind), h("span", { class: "number", title: exact(v.start) }, exact(v.start)), h("span", { class: "dim" }, unitShown(v.unit)), h("span", { class: "dim" }, range(v)), h("span", { class: "dim", title: v.description ?? "" }, v.description ?? ""))));
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
    h("div", { class: "window-head line", "aria-hidden": "true" }, ["name", "kind", "start", "unit", "range", "description"].map((t) => h("span", {}, t))), box);
}
