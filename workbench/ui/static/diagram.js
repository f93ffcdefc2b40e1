// A system as boxes and wires, from and to its file: what is drawn is what the file says, nothing is hidden.

import { factsOf, forget, get, post, server } from "./api.js";
import { fill, h, say } from "./dom.js";
import { write } from "./keep.js";
import { head } from "./model.js";

const SVG = "http://www.w3.org/2000/svg";

function s(tag, properties, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

const BLOCK = "text/x-block"; // what is dragged: the kind of a block
const drafts = new Map(); // page → text that was not written yet

export async function diagramPage([name, plant]) {
  const key = `${name} ${plant ?? ""}`;
  const text = drafts.get(key) ?? (name === "new" ? await fresh(plant) : (await get(`/api/text?name=${encodeURIComponent(name)}`)).text);
  const area = h("textarea", { id: "toml", rows: 22, value: text, spellcheck: false, "aria-describedby": "toml-help toml-wrong", oninput: () => draw() });
  const file = h("input", { type: "text", id: "file", value: name === "new" || name.includes(":") ? "loop.toml" : name, spellcheck: false });
  const place = h("div", { class: "drawing", tabIndex: 0, role: "region", "aria-label": "Diagram" });
  const parts = h("div");
  const wrong = h("p", { id: "toml-wrong", class: "bad", role: "status" });
  const chosen = { wire: null }; // input whose wire takes the next block
  const known = new Map(); // model → what `info` says of it
  let asked = 0;
  let before = Promise.resolve();
  /** Let the server read the text, changed if a change is asked for, and show what it says: one after the other. */
  function draw(...change) {
    const mine = (asked += 1);
    before = before.then(async () => {
      if (!change.length && mine !== asked) return; // what was typed is older than what is typed now
      try {
        let [sent, system] = [];
        do { // what is typed meanwhile stays
          sent = area.value;
          system = await post("/api/diagram", { name: name.includes(":") ? name : file.value, text: sent, change });
        } while (change.length && area.value !== sent);
        if (change.length) area.value = system.text;
        drafts.set(key, area.value);
        fill(wrong, system.wrong.join("; "));
        show(system);
      } catch (error) {
        fill(wrong, error.message); // the picture stays as it was
      }
    });
    return before;
  }
  function show(system) {
    const mine = asked;
    for (const { model } of system.components) {
      if (!model || known.has(model)) continue;
      known.set(model, null);
      factsOf(model).then((facts) => { // what cannot be opened is told when the file is written
        known.set(model, facts);
        if (mine === asked) show(system);
      }, () => {});
    }
    if (!system.connections.some(({ to }) => to === chosen.wire)) chosen.wire = null;
    fill(place, picture(system, known, chosen, (from, to) => {
      say(`${from} → ${to}`);
      draw("connect", from, to);
    }, (kind, to) => put(kind, to)));
    const open = parts.querySelector("details")?.open ?? false;
    fill(parts, partsOf(system, draw, open));
  }
  /** Put a block into the wire to an input, or anywhere. */
  function put(kind, to = chosen.wire) {
    chosen.wire = null;
    draw(...(to ? ["insert", kind, to] : ["add", kind]));
  }
  place.addEventListener("dragover", (event) => event.dataTransfer.types.includes(BLOCK) && event.preventDefault());
  place.addEventListener("drop", (event) => {
    if (event.defaultPrevented) return; // a wire has taken it
    event.preventDefault();
    put(event.dataTransfer.getData(BLOCK), null);
  });
  const add = server.palette.map(([group, kinds]) => h("div", { class: "group", role: "group", "aria-label": group }, h("span", { class: "dim" }, group),
    kinds.map((kind) => h("button", { type: "button", class: "quiet", draggable: true, title: "Drop it into a wire, or choose a wire and click", ondragstart: (event) => event.dataTransfer.setData(BLOCK, kind), onclick: () => put(kind) }, `+ ${kind.replaceAll("_", " ")}`))));
  const keep = async () => {
    if (!(await write(file.value, area.value))) return;
    drafts.delete(key);
    forget(file.value);
    try {
      await factsOf(file.value);
      location.hash = `#/open/${encodeURIComponent(file.value)}/measure/loop`;
    } catch (error) {
      say(error.message, true);
      fill(wrong, error.message);
    }
  };
  await draw();
  const [of, here] = name === "new" ? [plant, "loop"] : [name, "diagram"];
  const above = await factsOf(of).then((facts) => head(of, facts, here), () => h("h1", {}, name)); // one that cannot be opened is mended here
  return {
    title: name === "new" ? "New system" : name,
    element: h("div", {}, above, name === "new" ? h("h2", {}, `A loop around ${plant}`) : null,
      h("p", { class: "dim" }, "Click an output, then an input, to connect them; drop a block into a wire, or click the wire and then the block. The file at the bottom is the system; the picture shows it."),
      h("div", { class: "palette", role: "toolbar", "aria-label": "Blocks" }, add), place, parts,
      h("label", { for: "toml" }, h("h2", {}, "System file")), h("p", { id: "toml-help", class: "help dim" }, "This is all of the system; paths are relative to the file. The page on system files in the documentation lists every key."), area, wrong,
      h("div", { class: "row" }, h("label", { for: "file" }, "File"), file, h("button", { type: "button", onclick: keep }, "Write and measure the loop"))),
  };
}

/** A position loop around a model, to begin with. */
async function fresh(plant) {
  const known = await factsOf(plant);
  const [u, y] = [known.inputs[0], known.outputs[0] ?? known.states[0]];
  if (!u || !y) throw new Error(`${plant} has no input, or no output`);
  const unit = (v) => (v?.unit ? `"${v.unit}"` : '"1"');
  return `name = "loop"

[components]
plant = ${JSON.stringify(plant)}
error = {sum = "+-", unit = ${unit(y)}}
gain = {gain = 1.0, units = {u = ${unit(y)}, y = ${unit(u)}}}

[connections]
"error.u2" = "plant.${y.name}"
"gain.u" = "error.y"
"plant.${u.name}" = "gain.y"

[inputs]
reference = "error.u1"

[outputs]
${/^[A-Za-z0-9_-]+$/.test(y.name) ? y.name : JSON.stringify(y.name)} = "plant.${y.name}"
`;
}

/** Ports of each component: those of blocks, those that wires, inputs and outputs name, and of models that have few. */
function ports(system, known) {
  const found = Object.fromEntries(system.components.map(({ name, inputs, outputs }) => [name, { in: new Set(inputs), out: new Set(outputs), more: [] }]));
  const put = (full, way) => {
    const [name, ...rest] = full.split(".");
    found[name]?.[way].add(rest.join("."));
  };
  for (const { from, to } of system.connections) {
    put(from, "out");
    put(to, "in");
  }
  for (const [, full] of system.inputs) put(full, "in");
  for (const [, full] of system.outputs) put(full, "out");
  for (const { name, model } of system.components) {
    for (const [way, kind] of [["in", "inputs"], ["out", "outputs"]]) {
      const others = (known.get(model)?.[kind] ?? []).map((v) => v.name).filter((n) => !found[name][way].has(n));
      if (others.length <= FEW) others.forEach((n) => found[name][way].add(n));
      else found[name].more.push(`${others.length} other ${kind}`);
    }
  }
  return found;
}

const MOST = 28; // letters of a name that is drawn
const LABEL = 24; // letters of the name of a component
const LEAST = 0.7; // of its size, below which the picture scrolls
const FEW = 8; // ports of a model that are drawn unconnected
const GAP = 90, ROW = 22, SIDE = 120;

function picture(system, known, chosen, onconnect, onput) {
  const all = ports(system, known);
  const names = Object.keys(all);
  const labels = Object.fromEntries(system.components.map(({ name, label }) => [name, brief(label)]));
  const level = levels(names, system);
  const columns = [];
  for (const name of names) (columns[level[name]] ??= []).push(name);
  const at = {};
  let height = 0;
  let x = SIDE;
  columns.forEach((column) => {
    const wide = Math.max(...(column ?? []).map((name) => width([brief(name, LABEL), labels[name]], all[name])), 0);
    let y = 30;
    for (const name of column ?? []) {
      const size = 50 + ROW * Math.max(all[name].in.size, all[name].out.size, 1) + (all[name].more.length ? ROW : 0);
      at[name] = { x, y, w: wide, h: size };
      y += size + 26;
    }
    height = Math.max(height, y);
    x += wide + GAP;
  });
  const where = (full, way) => {
    const [name, ...rest] = full.split(".");
    const box = at[name];
    if (!box) return null;
    const k = [...all[name][way]].indexOf(rest.join("."));
    return { x: box.x + (way === "out" ? box.w : 0), y: box.y + 56 + ROW * k };
  };
  const whole = x - GAP + SIDE;
  const back = height + 10;
  const notes = [];
  const paths = system.connections.map(({ from, to, more }, i) => {
    const [a, b] = [where(from, "out"), where(to, "in")];
    if (!a || !b) return null;
    const d = b.x > a.x ? `M${a.x} ${a.y}C${a.x + GAP / 2} ${a.y} ${b.x - GAP / 2} ${b.y} ${b.x} ${b.y}`
      : `M${a.x} ${a.y}h${18 + 4 * i}V${back + 8 * i}H${b.x - 18 - 4 * i}V${b.y}H${b.x}`;
    const path = s("g", { class: "wire", tabindex: 0, role: "button", "aria-pressed": String(chosen.wire === to), "aria-label": `wire from ${from} to ${to}` }, s("path", { class: "reach", d }), s("path", { d }), s("title", {}, `${from} → ${to} ${more}`.trim()));
    const press = () => {
      chosen.wire = chosen.wire === to ? null : to;
      for (const wire of svg.querySelectorAll(".wire")) wire.setAttribute("aria-pressed", String(wire === path && chosen.wire === to));
      if (chosen.wire) say("The next block goes into this wire.");
    };
    path.addEventListener("click", press);
    path.addEventListener("keydown", (event) => (event.key === "Enter" || event.key === " ") && (event.preventDefault(), press()));
    for (const [kind, over] of [["dragover", true], ["dragleave", false]]) path.addEventListener(kind, (event) => event.dataTransfer.types.includes(BLOCK) && (event.preventDefault(), path.classList.toggle("over", over)));
    path.addEventListener("drop", (event) => {
      event.preventDefault();
      onput(event.dataTransfer.getData(BLOCK), to);
    });
    if (more) notes.push(s("text", { class: "edge", x: (a.x + b.x) / 2, y: (b.x > a.x ? (a.y + b.y) / 2 : back + 8 * i) - 6, "text-anchor": "middle" }, more));
    return path;
  }).filter(Boolean);
  let output = null; // that was clicked
  const svg = s("svg", { class: "diagram", viewBox: `0 0 ${Math.max(whole, 400)} ${back + 8 * system.connections.length + 16}`, role: "group", "aria-label": "Diagram of the system" }, ...paths, ...notes);
  [svg.style.minWidth, svg.style.maxWidth] = [`${LEAST * whole}px`, `${whole}px`]; // smaller it cannot be read
  for (const { name, what } of system.components) {
    const box = at[name];
    const group = s("g", {}, s("rect", { x: box.x, y: box.y, width: box.w, height: box.h }), s("text", { x: box.x + box.w / 2, y: box.y + 18, "text-anchor": "middle" }, brief(name, LABEL)), s("text", { class: "dim", x: box.x + box.w / 2, y: box.y + 34, "text-anchor": "middle" }, labels[name]));
    group.firstChild.append(s("title", {}, `${name} = ${what}`));
    if (all[name].more.length) group.append(s("text", { class: "dim", x: box.x + box.w / 2, y: box.y + box.h - 8, "text-anchor": "middle" }, all[name].more.join(", ")));
    for (const way of ["in", "out"]) {
      for (const port of all[name][way]) {
        const full = `${name}.${port}`;
        const p = where(full, way);
        const dot = s("circle", { class: "port", cx: p.x, cy: p.y, r: 7, tabindex: 0, role: "button", "aria-label": `${way === "in" ? "input" : "output"} ${full}` });
        const press = () => {
          if (way === "out") {
            output = full;
            say(`From ${full}: now choose an input.`);
          } else if (output) onconnect(output, full);
          else say("Choose an output first.");
        };
        dot.addEventListener("click", press);
        dot.addEventListener("keydown", (event) => (event.key === "Enter" || event.key === " ") && (event.preventDefault(), press()));
        const inside = way === "in" ? { x: p.x + 12, anchor: "start" } : { x: p.x - 12, anchor: "end" };
        group.append(s("text", { x: inside.x, y: p.y + 4, "text-anchor": inside.anchor }, brief(port)), dot);
      }
    }
    svg.append(group);
  }
  for (const [kind, way] of [["inputs", "in"], ["outputs", "out"]]) {
    for (const [label, full] of system[kind]) {
      const p = where(full, way);
      const wired = way === "out" && system.connections.some(({ from }) => from === full);
      if (p) svg.append(s("text", { class: "edge", x: p.x + (way === "in" ? -30 : 10), y: wired ? p.y - 8 : p.y + 4, "text-anchor": way === "in" ? "end" : "start" }, way === "in" ? `${brief(label)} →` : `→ ${brief(label)}`));
    }
  }
  return svg;
}

function brief(port, most = MOST) {
  return port.length > most ? `${port.slice(0, most - 1)}…` : port;
}

/** How wide a box is, so that the names at its two sides do not meet. */
function width(words, ports) {
  const longest = (names) => Math.max(0, ...[...names].map((n) => brief(n).length));
  return Math.max(130, 50 + 7.4 * (longest(ports.in) + longest(ports.out)), ...words.map((w) => 20 + 7.4 * w.length), 20 + 7.4 * ports.more.join(", ").length);
}

/** Columns: a component stands to the right of those that feed it, but for the wires that close a loop. */
function levels(names, system) {
  const feeds = new Map(names.map((n) => [n, []]));
  for (const { from, to } of system.connections) feeds.get(from.split(".")[0])?.push(to.split(".")[0]);
  const level = Object.fromEntries(names.map((n) => [n, 0]));
  const first = system.inputs.map(([, full]) => full.split(".")[0]);
  const order = [...new Set([...first, ...names])].filter((n) => n in level);
  const seen = new Set();
  const visit = (name, at, path) => {
    if (path.has(name) || (seen.has(name) && level[name] >= at)) return;
    seen.add(name);
    level[name] = Math.max(level[name], at);
    for (const next of feeds.get(name) ?? []) if (!path.has(next) && next in level) visit(next, at + 1, new Set([...path, name]));
  };
  for (const name of order) if (!seen.has(name)) visit(name, 0, new Set());
  return level;
}

/** What there is, with a button to take each away. */
function partsOf(system, draw, open) {
  const away = (label, ...change) => h("button", { type: "button", class: "quiet", "aria-label": label, onclick: () => draw(...change) }, "×");
  return h("details", { open }, h("summary", {}, `${system.components.length} components, ${system.connections.length} wires`),
    h("ul", { class: "list" },
      system.components.map(({ name, what }) => h("li", { class: "row" }, away(`remove ${name} and its wires`, "remove", name), h("strong", {}, name), h("code", {}, what))),
      system.connections.map(({ from, to, more }) => h("li", { class: "row" }, away(`remove the wire to ${to}`, "cut", to), `${from} → ${to}`, more ? h("code", {}, more) : null))));
}
