// Requirements of a study, drawn where a loop is tuned: what its curves have to stay out of. No page is touched here.

import { shown } from "./numbers.js";

const GROUND = 18; // points at each amplitude that are measured
const [DOWN, UP] = [10, 3]; // times the linear crossover: limits pull it down, seldom up
const FAR = 1e4; // as far as a region reaches where nothing ends it

/** The largest least value, of a kind of requirement. */
function least(requirements, kind) {
  const found = requirements.filter((r) => r.kind === kind && typeof r.min === "number").map((r) => r.min);
  return found.length ? Math.max(...found) : null;
}

/** Margins that a study asks for: {db, deg, ms}; null where it asks for none. */
export function marginsIn(requirements) {
  const delay = least(requirements, "delay margin");
  return { db: least(requirements, "gain margin"), deg: least(requirements, "phase margin"), ms: delay === null ? null : 1e3 * delay };
}

/** Regions of masks on a quantity ("gain" or "phase") over frequency; the analyses that are of the loop are `of`. */
export function masksIn(requirements, of, quantity) {
  const found = requirements.filter((r) => r.kind === "mask" && of.includes(r.analysis) && (r.quantity ?? "gain").startsWith(quantity));
  const region = (corners, edge) => ({ colour: 6, fill: true, x: [...corners.map(([f]) => f), corners.at(-1)[0], corners[0][0]], y: [...corners.map(([, v]) => v), edge, edge] });
  return found.flatMap((r) => [r.upper?.length > 1 ? region(r.upper, FAR) : null, r.lower?.length > 1 ? region(r.lower, -FAR) : null]).filter(Boolean);
}

/** What a step response has to stay out of: above the overshoot, outside of the band once it has to have settled. */
export function stepRegions(requirements) {
  const regions = [];
  for (const r of requirements) {
    if (typeof r.max !== "number") continue;
    if (r.kind === "overshoot") regions.push({ colour: 6, fill: true, x: [0, FAR, FAR, 0], y: [1 + r.max / 100, 1 + r.max / 100, FAR, FAR] });
    if (r.kind === "settling time") {
      const band = typeof r.band === "number" ? r.band : 0.02;
      for (const [edge, far] of [[1 + band, FAR], [1 - band, -FAR]]) regions.push({ colour: 6, fill: true, x: [r.max, FAR, FAR, r.max], y: [edge, edge, far, far] });
    }
  }
  return regions;
}

/** The requirement that asks most of a kind: its number among all; null: there is none. */
export function numberOf(requirements, kind) {
  const all = requirements.map((r, i) => [r, i]).filter(([r]) => r.kind === kind && typeof r.min === "number");
  return all.length ? all.reduce((a, b) => (b[0].min > a[0].min ? b : a))[1] : null;
}

/**
 * A study that asks for margins {db, deg} and a crossover {hz} of a loop, of a model with parameters `set` in place of
 * those of its file; what is null is not asked for. That the loop gain is at least one at a frequency puts its crossover
 * there or higher.
 */
export function wantedStudy({ model, open, set, db, deg, hz }) {
  const changed = Object.entries(set).map(([name, value]) => `${JSON.stringify(name)} = ${toml(value)}`);
  const asked = [
    ["gain margin", db, `kind = "gain margin"\nmin = ${toml(db)}`], ["phase margin", deg, `kind = "phase margin"\nmin = ${toml(deg)}`],
    ["crossover", hz, `kind = "gain"\nfrequency = ${toml(hz)}\nmin = 0.0`],
  ].filter(([, value]) => value !== null);
  return [
    `${heading(model)}${open}; the browser writes it anew when it is to be found.`, "[models]",
    `loop = ${changed.length ? `{model = ${JSON.stringify(model)}, set = {${changed.join(", ")}}}` : JSON.stringify(model)}`, "",
    "[analyses.margins]", 'command = "loop"', 'model = "loop"', `open = ${JSON.stringify(open)}`,
    ...asked.map(([name, , lines]) => `\n[[requirements]]\nname = "${name}"\nanalysis = "margins"\n${lines}`),
  ].join("\n") + "\n";
}

/** How such a study begins. */
function heading(model) {
  return `# What is wanted of ${model}, opened at `;
}

/** Such a study of another model, whose file has the values; null: it is no such study. */
export function wantedOf(text, model, other) {
  if (!text.startsWith(heading(model))) return null;
  return (heading(other) + text.slice(heading(model).length)).replace(/^loop = .*$/m, () => `loop = ${JSON.stringify(other)}`);
}

/** A number as TOML has it. */
function toml(value) {
  return Number.isInteger(value) ? `${value}.0` : String(value);
}

/** Where a loop with its limits is measured, as `loop` takes it: around the crossover [Hz] of the linear one. */
export function bandAround(crossing) {
  return { band: `${shown(crossing / DOWN, 4)}:${shown(crossing * UP, 4)}`, ratio: String(shown((DOWN * UP) ** (1 / GROUND), 4)), refine: "1" };
}

/** Margins in a picture: a bar from the curve to the border. */
export function notesOf({ open }, on, b) {
  return (open.marks ?? []).filter((m) => m.on === on).map((m) => {
    const y = on === "gain" ? m.db : b.phase[b.x.findIndex((x) => x >= m.hz)];
    return { x: m.hz, y, to: on === "gain" ? 0 : y - m.deg, text: m.text, colour: "--accent" };
  });
}

/** The circle around the origin of a Nyquist picture. */
export function circle() {
  const angles = Array.from({ length: 91 }, (_, k) => (k * Math.PI) / 45);
  return { label: "unit circle", colour: "--dim", x: angles.map(Math.cos), y: angles.map(Math.sin), dash: [2, 4], width: 1 };
}
