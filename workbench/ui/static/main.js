// The pages by their addresses, the theme.

import { connect, lookAgain, onChange, server } from "./api.js";
import { fill, h, say } from "./dom.js";
import { comparePage } from "./compare.js";
import { buildPage } from "./build.js";
import { dataPage } from "./data.js";
import { diagramPage } from "./diagram.js";
import { keepPage } from "./keep.js";
import { modelPage, runPage } from "./model.js";
import { recolour } from "./plot.js";
import { fillRail, mark } from "./rail.js";
import { studyPage } from "./study.js";
import { tunePage } from "./tune.js";

const main = document.getElementById("main");
const side = document.getElementById("side");
let leave = null;
const PATIENCE = 300; // so long the page before is shown [ms]

/** Address → page; a page is a function of the rest of the address that returns {element, title, leave?}. */
const PAGES = { open: modelPage, run: runPage, compare: comparePage, keep: keepPage, system: diagramPage, tune: tunePage, build: buildPage };
const OF_KIND = { store: comparePage, study: studyPage, data: dataPage, modelica: buildPage, record: buildPage };

async function show() {
  const [name, ...rest] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  leave?.();
  leave = null;
  const asked = location.hash;
  const waits = setTimeout(() => fill(main, h("p", { class: "dim", role: "status" }, "Opening …")), PATIENCE);
  try {
    const kind = name === "open" ? server.files.find((f) => f.name === rest[0])?.kind : null;
    const make = OF_KIND[kind] ?? PAGES[name];
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
      local.length ? h("div", { class: "row" }, local.slice(0, SHOWN).map((f) => h("a", { class: "button", href: `#/open/${encodeURIComponent(f.name)}` }, f.name)), local.length > SHOWN ? `and ${local.length - SHOWN} more under Files` : null) : null,
      h("p", {}, h("a", { class: "button", href: "#/open/fmu:Rudder/measure/nfr" }, "Try it: measure the bundled rudder")),
      h("p", { class: "dim" }, `FMI workbench ${server.version}`)),
  };
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
  const rail = (open) => {
    document.body.dataset.rail = open ? "open" : "folded";
    document.getElementById("menu").setAttribute("aria-expanded", String(open));
  };
  const wide = matchMedia("(min-width: 1001px)");
  rail(wide.matches);
  wide.onchange = () => rail(wide.matches);
  document.getElementById("menu").onclick = () => rail(document.body.dataset.rail !== "open");
  try {
    await connect();
  } catch (error) {
    fill(main, h("h1", {}, "No answer"), h("p", { class: "bad" }, error.message));
    return;
  }
  document.getElementById("folder").textContent = server.folder;
  fillRail(side);
  onChange((work, event) => {
    if (event.event === "state" && work.has_record && !work.aside) lookAgain().catch(() => {}); // a store may be new
    if (event.event === "state" && work.state === "failed" && !work.aside) say(`${work.command}: ${work.failure?.message ?? "failed"}`, true);
    if (event.event === "removed" && location.hash === `#/run/${work.number}`) location.hash = work.subject.length !== 1 ? "#/" : `#/open/${encodeURIComponent(work.subject[0])}${server.forms[work.command] ? `/measure/${work.command}` : ""}`;
  });
  addEventListener("pointerdown", (event) => {
    for (const open of document.querySelectorAll("details.menu[open]")) if (!open.contains(event.target)) open.open = false;
  });
  addEventListener("resize", recolour); // pictures are as high as the window lets them
  window.addEventListener("hashchange", () => {
    if (!wide.matches) rail(false);
    show();
    main.focus({ preventScroll: true });
  });
  window.addEventListener("focus", () => lookAgain().catch(() => {})); // what fails is said by the stream of events
  await show();
}

begin();
