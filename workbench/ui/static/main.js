// The pages by their addresses, the list of files and of work at the side, the theme.

import { connect, lookAgain, onChange, onFiles, server } from "./api.js";
import { fill, h, say } from "./dom.js";
import { comparePage } from "./compare.js";
import { diagramPage } from "./diagram.js";
import { keepPage } from "./keep.js";
import { modelPage } from "./model.js";
import { recolour } from "./plot.js";
import { workPage } from "./work.js";

const main = document.getElementById("main");
const side = document.getElementById("side");
let leave = null;
const PATIENCE = 300; // so long the page before is shown [ms]

/** Address → page; a page is a function of the rest of the address that returns {element, title, leave?}. */
const PAGES = { open: modelPage, run: workPage, compare: comparePage, keep: keepPage, system: diagramPage };

async function show() {
  const [name, ...rest] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  leave?.();
  leave = null;
  const asked = location.hash;
  const waits = setTimeout(() => fill(main, h("p", { class: "dim", role: "status" }, "Opening …")), PATIENCE);
  try {
    const kind = name === "open" ? server.files.find((f) => f.name === rest[0])?.kind : null;
    const make = { store: comparePage, study: keepPage }[kind] ?? PAGES[name];
    const page = make ? await make(rest) : welcome();
    if (location.hash !== asked) {
      page.leave?.();
      return;
    }
    leave = page.leave ?? null;
    fill(main, page.element);
    main.dataset.shown = asked;
    document.title = `${page.title} – FMI workbench`;
  } catch (error) {
    if (location.hash !== asked) return;
    fill(main, h("h1", {}, "This cannot be shown"), h("p", { class: "bad" }, error.message));
    main.dataset.shown = asked;
  } finally {
    clearTimeout(waits);
  }
  mark();
}

const SHOWN = 12; // files on the first page

function welcome() {
  const local = server.files.filter((f) => f.kind !== "point" && !f.name.includes(":"));
  return {
    title: server.folder,
    element: h("div", {},
      h("h1", {}, "How does this FMU behave?"),
      h("p", {}, "Open a model: its card says what it is. Then find an operating point, measure responses at real amplitudes, look for limit cycles, and close loops around it."),
      h("p", {}, local.length ? `In the folder ${server.folder}:` : `There is nothing to open in the folder ${server.folder}. Start workbench ui in the folder of your FMU, or try a bundled model.`),
      local.length ? h("div", { class: "row" }, local.slice(0, SHOWN).map((f) => h("a", { class: "button", href: address(f) }, f.name)), local.length > SHOWN ? `and ${local.length - SHOWN} more under Files` : null) : null,
      h("p", {}, h("a", { class: "button", href: "#/open/fmu:Rudder/measure/nfr" }, "Try it: measure the bundled rudder")),
      h("p", { class: "dim" }, `FMI workbench ${server.version}`)),
  };
}

// -- at the side ------------------------------------------------------------------------------------

const found = h("ul", { class: "list" });
const shipped = h("ul", { class: "list" });
const working = h("ul", { class: "list short" });
const search = h("input", { type: "search", placeholder: "Search", "aria-label": "Search files", oninput: list });

function list() {
  const text = search.value.toLowerCase();
  const shown = server.files.filter((f) => f.kind !== "point" && f.name.toLowerCase().includes(text));
  const line = (f) => h("li", {}, h("a", { href: address(f), "data-name": f.name }, f.name.replace(/^\w+:/, ""), " ", h("span", { class: "dim" }, f.kind)));
  const own = shown.filter((f) => !/^(fmu|system|study):/.test(f.name));
  const bundled = shown.filter((f) => /^(fmu|system|study):/.test(f.name));
  fill(found, own.length ? own.map(line) : h("li", { class: "dim" }, text ? "Nothing of that name in this folder." : "Nothing to open in this folder."));
  fill(shipped, bundled.length ? bundled.map(line) : h("li", { class: "dim" }, "None of that name."));
  mark();
}

function address(file) {
  return `#/open/${encodeURIComponent(file.name)}`;
}

function works() {
  const all = [...server.works.values()].filter((w) => !w.aside).reverse();
  fill(working, all.length ? all.slice(0, 200).map((w) => h("li", {}, h("a", { href: `#/run/${w.number}`, "data-work": w.number },
    `${w.number} ${w.command} `, h("span", { class: "dim" }, w.subject.join(", ")),
    h("br"), h("span", { class: { failed: "bad", stopped: "watch", done: "dim" }[w.state] ?? "good" }, far(w))))) : h("li", { class: "dim" }, "None yet."));
  mark();
}

/** How far a work is, in words. */
function far(work) {
  if (work.state === "running" && work.total) return `${work.done} of ${work.total} ${work.total === 100 && work.counts === "points" ? "%" : work.counts}`;
  return work.state === "done" && !work.well ? "done, not all well" : work.state;
}

function mark() {
  const [, ...rest] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  for (const link of side.querySelectorAll("a")) {
    const here = link.dataset.work ? location.hash === link.getAttribute("href") : link.dataset.name === rest[0];
    if (here) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

// -- theme -------------------------------------------------------------------------------------------

function theme(name) {
  document.documentElement.dataset.theme = name;
  document.getElementById("theme").textContent = name === "dark" ? "Light" : "Dark";
  recolour(); // and nothing else: what is filled in stays
}

/** The theme that was chosen earlier, or the system's. */
function chosen() {
  try {
    const name = localStorage.getItem("theme");
    if (name) return name;
  } catch { /* where nothing may be kept */ }
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

async function begin() {
  // The token has become a cookie; the address need not keep it.
  if (location.search) history.replaceState(null, "", `/${location.hash}`);
  theme(chosen());
  document.getElementById("theme").onclick = () => {
    theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
    try {
      localStorage.setItem("theme", document.documentElement.dataset.theme);
    } catch { /* the choice ends with the page */ }
  };
  document.getElementById("menu").onclick = (event) => {
    event.currentTarget.setAttribute("aria-expanded", String(side.classList.toggle("open")));
  };
  try {
    await connect();
  } catch (error) {
    fill(main, h("h1", {}, "No answer"), h("p", { class: "bad" }, error.message));
    return;
  }
  document.getElementById("folder").textContent = server.folder;
  fill(side, search, h("h2", {}, server.folder), found, h("h2", {}, "Work"), working, h("h2", {}, "Bundled"), shipped);
  onFiles(list);
  list();
  works();
  let waits = 0;
  onChange((work, event) => {
    if (event.event === "state" && work.has_record && !work.aside) lookAgain().catch(() => {}); // a store may be new
    if (event.event === "state" && work.state === "failed") say(`${work.command}: ${work.failure?.message ?? "failed"}`, true);
    waits ||= requestAnimationFrame(() => {
      waits = 0;
      works();
    });
  });
  window.addEventListener("hashchange", () => {
    side.classList.remove("open");
    document.getElementById("menu").setAttribute("aria-expanded", "false");
    show();
    main.focus({ preventScroll: true });
  });
  window.addEventListener("focus", () => lookAgain().catch(() => {})); // what fails is said by the stream of events
  await show();
}

begin();
