// At the side: the runs first, then what can be opened.

import { onChange, onFiles, remove, server } from "./api.js";
import { fill, h, say } from "./dom.js";
import { isOverlaid, nameOf, onOverlays, overlay, overlayRun } from "./overlays.js";

const MOST = 200; // runs in the list
const BUNDLED = /^(fmu|system|study):/;

const runs = h("ul", { class: "list runs" });
const found = h("ul", { class: "list" });
const shipped = h("ul", { class: "list" });
const bundled = h("details", {}, h("summary", {}, "Bundled"), shipped);
const search = h("input", { type: "search", placeholder: "Filter runs and files", "aria-label": "Filter runs and files", oninput: draw });
let side = null;

/** Fill the side, and keep it as the server has it. */
export function fillRail(element) {
  side = element;
  bundled.open = !server.files.some((f) => !BUNDLED.test(f.name));
  fill(side, search, h("h2", {}, "Runs"), runs, h("h2", {}, "Files"), found, bundled);
  onFiles(files);
  draw();
  let waits = 0;
  onOverlays(works);
  onChange((work, event) => {
    if (event.event === "removed" && isOverlaid(work.number)) overlay(work.number);
    waits ||= requestAnimationFrame(() => {
      waits = 0;
      works();
    });
  });
}

function draw() {
  files();
  works();
}

function sought(text) {
  return search.value.toLowerCase().split(/\s+/).every((part) => text.toLowerCase().includes(part));
}

function files() {
  const shown = server.files.filter((f) => !["point", "record"].includes(f.kind) && sought(`${f.name} ${f.kind}`));
  const line = (f) => h("li", {}, h("a", { href: `#/open/${encodeURIComponent(f.name)}`, "data-name": f.name }, h("span", { class: "clip" }, f.name.replace(/^\w+:/, "")), h("span", { class: "dim" }, f.kind)));
  const own = shown.filter((f) => !BUNDLED.test(f.name));
  const others = shown.filter((f) => BUNDLED.test(f.name));
  fill(found, own.length ? own.map(line) : h("li", { class: "dim" }, search.value ? "No file of that name." : "Nothing to open in this folder."));
  fill(shipped, others.length ? others.map(line) : h("li", { class: "dim" }, "None of that name."));
  if (search.value && !own.length && others.length) bundled.open = true;
  mark();
}

function works() {
  const all = [...server.works.values()].filter((w) => !w.aside && sought(`${nameOf(w)} ${w.command} ${w.subject.join(" ")} ${w.state} ${w.brief ?? ""}`)).reverse();
  fill(runs, all.length ? all.slice(0, MOST).map(run) : h("li", { class: "dim" }, search.value ? "No such run." : "None yet: open a model and ask it something."));
  mark();
}

const OVERLAID = new Set(["nfr", "lin", "loop", "branches", "feedback", "identify", "fit"]); // what has curves over frequency

function run(work) {
  const running = ["waiting", "running"].includes(work.state);
  const tick = OVERLAID.has(work.command) && work.has_record ? h("input", { type: "checkbox", checked: isOverlaid(work.number), title: "Lay its curves over every picture", "aria-label": `Lay ${nameOf(work)} over every picture`, onchange: () => overlayRun(work.number, tick.checked).catch((error) => { tick.checked = false; say(error.message, true); }) }) : null;
  return h("li", {}, h("span", { class: "tick" }, tick), h("a", { href: `#/run/${work.number}`, "data-work": work.number },
    h("span", { class: "clip" }, nameOf(work)), h("span", { class: { failed: "state bad", stopped: "state watch", done: "state dim" }[work.state] ?? "state good" }, far(work)),
    h("span", { class: "brief clip" }, rest(work)), h("span", { class: "brief clip" }, work.brief || work.failure?.message || work.verdicts?.[0]?.text || work.lead || ""), h("span", { class: "dim clip" }, work.subject.join(", "))),
  running ? h("progress", { max: work.total || 1, value: work.total ? work.done : null, "aria-label": nameOf(work) }) : h("button", { type: "button", class: "bare away", "aria-label": `Throw ${nameOf(work)} away`, title: "Throw this run away", onclick: () => remove(work.number).catch((error) => say(error.message, true)) }, "×"));
}

function count(work) {
  return `${work.done} of ${work.total} ${work.total === 100 && work.counts === "points" ? "%" : work.counts}`;
}

/** What there is of a run that has not come to its end, in words. */
function rest(work) {
  if (work.later) return `It went on as ${work.command} ${work.later}`;
  return work.goes_on && work.total ? `${count(work)} kept` : "";
}

/** How far a run is, in words. */
function far(work) {
  if (work.state === "running" && work.total) return count(work);
  return work.state === "done" && !work.well ? "not all well" : work.state;
}

/** Mark where one is. */
export function mark() {
  const [, name] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  for (const link of side.querySelectorAll("a")) {
    const here = link.dataset.work ? location.hash === link.getAttribute("href") : link.dataset.name === name;
    if (here) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}
