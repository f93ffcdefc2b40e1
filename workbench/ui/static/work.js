// One run: its picture while it runs, and what it gives when it has ended; the same layout for every analysis.

import { factsOf, get, goOn, lookAgain, onChange, post, remove, server, stop, whole } from "./api.js";
import { Bode } from "./bode.js";
import { code, fill, h, menu, say, told, wrongs } from "./dom.js";
import { shown, unitShown } from "./numbers.js";
import { nameOf } from "./overlays.js";
import { envelopeMap } from "./envelope.js";
import { histories, withSections } from "./panels.js";

/** A run of several models, or of one that cannot be opened any more; that of a model is shown with its form. */
export async function workPage([number]) {
  const work = server.works.get(Number(number)) ?? (await whole(Number(number)));
  const shownWork = live(Number(number), { ongoing: async (stopped) => { location.hash = `#/run/${(await goOn(stopped)).number}`; } });
  return {
    title: `${work.command} ${number}`,
    leave: shownWork.leave,
    element: h("div", {}, h("h1", {}, `${work.command} of ${work.subject.join(", ")}`), shownWork.element),
  };
}

const FMUS = new Set(["build", "compile", "export"]); // what writes one
const MODELS = new Set(["lin", "identify", "fit"]); // what one can be made of
const PLAIN = new Set(["run", "build", "compile", "export", "identify"]); // what has no one picture
const KEEP_TIME = new Set(["identify"]); // whose signals over time stand in the page's own pictures

/** Keep the record of a run as a file, under a name that no other has. */
async function keptAs({ command, number }) {
  const name = (k) => `${command}-${number}${k > 1 ? `-${k}` : ""}.json`;
  let k = 1;
  while (server.files.some((f) => f.name === name(k))) k += 1;
  return (await post(`/api/works/${number}/keep`, { name: name(k) })).name;
}

const STATES = { failed: "bad", stopped: "watch", running: "good" };

/**
 * What a run shows, kept up to date; {element, leave}. `onband` is told a band drawn with the mouse, `onagain` values
 * to run with, `ongoing` the number of a stopped run that is to go on.
 */
export function live(number, { onband = null, onagain = null, ongoing = null }) {
  const halt = h("button", { type: "button", class: "quiet", onclick: () => stop(number) }, "Stop"); // one: a click needs it to stay
  const said = h("span", { class: "said", role: "status" });
  const more = h("span", { class: "row" });
  const tools = h("span", { class: "row tools" });
  const name = h("input", { type: "text", class: "name", "aria-label": "Name of the run", spellcheck: false, onchange: () => post(`/api/works/${number}/name`, { name: name.value.trim() }).catch((error) => say(error.message, true)) });
  const below = h("div", { role: "status" });
  const body = h("div", { class: "pictured" });
  const sections = h("div", { class: "sections" });
  const tail = h("div");
  let picture = null;
  let ended = false;
  let waits = 0;
  let units = {}; // of inputs and outputs by name, as far as they are known
  const subject = server.works.get(number)?.subject ?? [];
  if (subject.length === 1 && server.forms[server.works.get(number).command]) {
    factsOf(subject[0]).then((facts) => {
      units = Object.fromEntries([...facts.inputs, ...facts.outputs, ...facts.states].map((v) => [v.name, v.unit ?? ""]));
    }, () => {}); // its failure is told where the run itself fails
  }
  const drawn = () => {
    picture ??= new Bode({ onband, number, onagain });
    if (!picture.element.isConnected) fill(body, picture.element);
    return picture;
  };
  const update = async () => {
    const work = server.works.get(number);
    if (!work) return;
    const running = work.state === "running" || work.state === "waiting";
    halt.hidden = !running;
    if (document.activeElement !== name) name.value = nameOf(work);
    fill(said, h("strong", { class: STATES[work.state] ?? "" }, work.state === "done" && !work.well ? "done, not all well" : work.state), " ",
      h("span", { class: "dim" }, running ? [work.total ? `${work.done} of ${work.total}` : "", work.words ?? (work.total ? "" : "opening the model …")].join(" ") : work.seconds ? `${shown(work.seconds, 3)} s` : ""),
      work.later ? [" It went on as ", h("a", { href: `#/run/${work.later}` }, `${work.command} ${work.later}`), ", which has its points."] : null);
    fill(more,
      work.goes_on && ongoing ? h("button", { type: "button", class: "quiet", title: "Measure what is missing; what is finished stays", onclick: () => ongoing(number) }, "Go on") : null,
      work.state === "stopped" && !work.goes_on && onagain ? h("button", { type: "button", class: "quiet", onclick: () => onagain({}) }, "Run again") : null);
    fill(below,
      running ? h("progress", { max: work.total || 1, value: work.total ? work.done : null, "aria-label": work.command }) : null,
      work.failure?.message ? h("p", { class: "bad" }, `${work.failure.kind}: ${work.failure.message}`) : null,
      running ? null : headline(work));
    if (work.points.length && work.points.some((p) => p && "response" in p)) {
      if (running) drawn().show(ofPoints(work.points.filter(Boolean), { input: units[work.asked.input] ?? "", output: units[work.asked.output] ?? "" }));
    }
    if (running) fill(tail, code(work.line, "The same in a terminal"));
    else await finished();
    fill(tools, picture?.tools ?? [], made(work), work.command === "loop" && work.has_record ? h("a", { class: "button", href: `#/tune/${encodeURIComponent(work.subject[0])}/${encodeURIComponent([work.asked.open].flat().join(" -> "))}` }, "Tune it") : null, exports(work));
  };
  /** What can be done with what was found: an FMU of a model, the FMU that was made. */
  const made = (work) => {
    const file = work.has_record && FMUS.has(work.command) ? work.asked.out : null;
    if (file && server.files.some((f) => f.name === file)) return h("a", { class: "button", href: `#/open/${encodeURIComponent(file)}` }, `Open ${file}`);
    if (!work.has_record || !MODELS.has(work.command)) return null;
    return h("button", { type: "button", class: "quiet", title: "Keep the model as a file, and make an FMU of it", onclick: async () => {
      try {
        const kept = await keptAs(work);
        await lookAgain();
        location.hash = `#/open/${encodeURIComponent(kept)}`;
      } catch (error) {
        say(wrongs(error), true);
      }
    } }, "Make an FMU");
  };
  const exports = (work) => {
    const at = `/api/works/${number}`;
    const file = (kind, label, title) => h("a", { href: `${at}/${kind}`, download: `${work.command}-${number}.${kind.split(".").pop()}`, title }, label);
    const own = picture?.exports ?? [];
    if (!own.length && !work.has_record) return null;
    return menu("Export", [own, work.has_record ? [
      h("a", { href: `${at}/report.html`, target: "_blank", title: "The report as one page, with its pictures" }, "Report"), file("report.html", "Save the report", "One file, which needs nothing else"),
      !PLAIN.has(work.command) ? file("picture.svg", "Picture of the report", "As the command draws it") : null, file("data.csv", "All data, CSV", "Every number of the result as a table"), file("data.json", "All data, JSON", "The whole result; other analyses and Python read it")] : null]);
  };
  const finished = async () => {
    const full = await whole(number);
    let pictured = true;
    if (full.curves.length) {
      drawn().show(full.curves, full);
    } else if (full.signals) fill(body, histories(full.signals));
    else if (full.command === "envelope" && full.record?.points.length) fill(body, envelopeMap(full.record));
    else pictured = false;
    if (full.has_record && !ended) {
      ended = true;
      withSections(sections, get(`/api/works/${number}/page`), pictured, KEEP_TIME.has(full.command));
    }
    fill(tail, code(full.line, "The same in a terminal"), full.call ? code(full.call, "in Python") : null, full.chosen.length ? h("p", { class: "dim" }, full.chosen.join("; ")) : null);
  };
  const end = onChange((work, event) => {
    if (work.number !== number) return;
    if (event.event === "state") update();
    else waits ||= requestAnimationFrame(() => { waits = 0; update(); });
  });
  update();
  const away = h("button", { type: "button", class: "quiet", title: "Throw this run away", onclick: () => remove(number).catch((error) => say(error.message, true)) }, "Delete");
  return {
    element: h("div", { class: "run" }, h("div", { class: "bar", role: "toolbar", "aria-label": "This run" }, name, said, halt, more, h("span", { class: "gap" }), tools, away), below, body, sections, tail),
    leave: () => { end(); picture?.leave(); },
  };
}

/** Curves of the points that there are so far, one an amplitude. */
function ofPoints(points, units) {
  const curves = new Map();
  for (const p of points) {
    const label = `${shown(p.amplitude, 6)} ${unitShown(units.input)}`.trim();
    if (!curves.has(label)) curves.set(label, { label, kind: "measured", input_unit: units.input, output_unit: units.output, amplitude: p.amplitude, frequency_hz: [], re: [], im: [], error: [], status: [], stable: [], points: [] });
    const c = curves.get(label);
    c.frequency_hz.push(p.frequency);
    c.re.push(p.response?.[0] ?? null);
    c.im.push(p.response?.[1] ?? null);
    c.error.push(p.error);
    c.status.push(p.reason ? "failed" : p.averaged ? "averaged" : "settled");
    c.stable.push(p.stable);
    c.points.push(p);
  }
  return [...curves.values()].sort((a, b) => a.amplitude - b.amplitude);
}

const FIRST = 3; // verdicts and remarks that stand open

/** What the record says first, as its report does: in a sentence, verdicts, warnings and remarks. */
function headline({ lead, verdicts, remarks }) {
  const lines = [...(verdicts ?? []).map(told), ...(remarks ?? []).map((text) => h("p", { class: "dim" }, text))];
  return h("section", { class: "headline", "aria-label": "What was found" }, lead ? h("p", { class: "lead" }, lead) : null, lines.slice(0, FIRST),
    lines.length > FIRST ? h("details", {}, h("summary", {}, `${lines.length - FIRST} more`), lines.slice(FIRST)) : null);
}
