// What a record's page says below its headline: sections with pictures, tables and text, in the page's own colours.

import { code, fill, h, table, told } from "./dom.js";
import { modesOf } from "./modes.js";
import { legend } from "./legend.js";
import { Plot, colour, dashOf } from "./plot.js";

/** Sections of a page; where the first one's picture is drawn elsewhere, what stands beside frequencies or, unless it is to be `timed`, time there is left out. */
export function sectionsOf({ facts, sections, modes, wrong }, pictured, timed = false) {
  const made = sections.map((s, i) => section(pictured && i === 0 ? { ...s, pictures: s.pictures.map((p) => rest(p, timed || modes.length)).filter(Boolean) } : s, 2)).filter(Boolean);
  const known = facts.filter(([name]) => !["command", "call"].includes(name));
  return [wrong ? h("p", { class: "watch" }, wrong) : null, modes.length ? modesOf(modes) : null, ...made, known.length ? folded("Settings", [h("dl", {}, known.flatMap(([k, v]) => [h("dt", {}, k), h("dd", {}, v)]))]) : null];
}

/** The panels of a picture that a Bode picture or time histories do not show; null: none. */
function rest({ words, panels, svg }, timed) {
  const others = (panels ?? []).filter((p) => !/^frequency/.test(p.x.label) && (timed || !/^time/.test(p.x.label)));
  return svg || !others.length ? null : { words, panels: others };
}

function folded(title, inside) {
  return h("details", {}, h("summary", {}, title), inside);
}

function section(s, level) {
  const inside = [
    s.paragraphs.map((text) => h("p", {}, text)), s.verdicts.map(told), s.items.length ? h("ul", {}, s.items.map((text) => h("li", {}, text))) : null,
    s.pictures.map(picture),
    s.tables.map((t) => table(t.headings, t.rows, { caption: t.title, label: s.title, verdict: t.verdict, tones: t.tones })),
    s.code.map((text) => code(text, s.title)), s.parts.map((part) => section(part, level + 1)),
  ].flat().filter(Boolean);
  if (!inside.length) return null;
  return s.folded ? folded(s.title, inside) : h("section", {}, s.pictures.length && level === 2 ? null : h(`h${Math.min(level, 4)}`, {}, s.title), inside);
}

/** One picture: its panels, drawn here; or an image, whose colours the style sheet turns over in the dark. */
export function picture({ words, panels, svg }) {
  if (!panels) return h("img", { class: "drawn", alt: words, src: `data:image/svg+xml,${encodeURIComponent(svg)}` });
  const columns = new Set(panels.map((p) => p.column)).size;
  const rows = new Set(panels.map((p) => p.row)).size;
  const grid = h("div", { class: "panels", style: `--columns: ${columns}` });
  const plots = panels.map((panel) => {
    const plot = new Plot({ x: { ...panel.x }, y: { ...panel.y }, label: `${words} ${panel.title}`, equal: panel.equal, height: [0.44, 0.32, 0.26][Math.min(rows, 3) - 1] });
    const ink = (c) => (c.colour === null ? "--ink" : colour(c.colour));
    const curves = panel.curves.map((c) => ({ label: c.label, named: c.named, colour: ink(c), x: c.x, y: c.y, width: c.width, dash: c.dash, line: c.line, marks: c.mark ? c.x.map(() => c.mark) : null }));
    plot.set(curves, { lines: panel.lines, extra: { areas: panel.areas, texts: panel.texts } });
    const named = curves.filter((c) => c.named && c.label);
    const own = named.length > 1 ? legendOf(named, curves, plot) : null;
    grid.append(h("div", { class: "panel", style: columns > 1 ? `grid-column: ${panel.column + 1}` : "" }, panel.title ? h("h3", {}, panel.title) : null, own, plot.element));
    return plot;
  });
  for (const [i, panel] of panels.entries()) { // what has the same horizontal axis moves together
    const beside = plots.filter((_, k) => k !== i && panels[k].column === panel.column && panels[k].x.label === panel.x.label && String(panels[k].x.range) === String(panel.x.range));
    plots[i].onview = (view) => beside.forEach((p) => {
      p.view = view ? { x: view.x, y: p.view?.y ?? p.limits().y } : null;
      p.later();
    });
    plots[i].onmove = (value) => beside.forEach((p) => {
      p.cursor = value;
      p.later();
    });
  }
  return grid;
}

/** The curves that have names; their numbers are those among all. */
function legendOf(named, curves, plot) {
  const all = legend(curves, [plot]);
  [...all.children].forEach((line, i) => { if (!named.includes(curves[i])) line.remove(); });
  return all;
}

/** Signals over time, one picture for each unit. */
export function histories({ time, signals, units }, height = null) {
  const groups = new Map();
  for (const n of Object.keys(signals)) groups.set(units[n] ?? "", [...(groups.get(units[n] ?? "") ?? []), n]);
  const shown = [...groups].slice(0, 8);
  const plots = [];
  return h("div", {}, shown.map(([unit, names]) => {
    const plot = new Plot({ x: { label: "time [s]", log: false }, y: { label: `${names.length === 1 ? names[0] : "signals"} [${unit || "–"}]`, log: false }, label: `${names.join(", ")} over time`, height: height ?? (shown.length > 1 ? 0.3 : 0.5), onmove: (v) => plots.forEach((p) => { p.cursor = v; p.later(); }) });
    plots.push(plot);
    const curves = names.slice(0, 12).map((n, i) => ({ label: n, colour: colour(i), dash: dashOf(i), x: time, y: signals[n] }));
    plot.set(curves);
    return h("div", {}, legend(curves, [plot]), plot.element);
  }));
}

/** Fill a place with the sections of a page as soon as the server has them. */
export async function withSections(place, page, pictured, timed = false) {
  try {
    fill(place, sectionsOf(await page, pictured, timed));
  } catch (error) {
    fill(place, h("p", { class: "bad" }, error.message));
  }
}
