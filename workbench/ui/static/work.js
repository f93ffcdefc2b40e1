// One work: its picture while it runs, and what it gives when it has ended.

import { factsOf, goOn, onChange, server, stop, whole } from "./api.js";
import { Bode } from "./bode.js";
import { code, fill, h, told } from "./dom.js";
import { gainKnob } from "./loop.js";
import { shown, unitShown } from "./numbers.js";
import { histories } from "./point.js";

export async function workPage([number]) {
  const work = server.works.get(Number(number)) ?? (await whole(Number(number)));
  const shownWork = live(Number(number), { ongoing: async (stopped) => { location.hash = `#/run/${(await goOn(stopped)).number}`; } });
  return {
    title: `${work.command} ${number}`,
    leave: shownWork.leave,
    element: h("div", {}, h("h1", {}, `${work.command} of ${work.subject.join(", ")}`),
      work.subject.length === 1 ? h("p", {}, h("a", { href: `#/open/${encodeURIComponent(work.subject[0])}` }, "To the model")) : null, shownWork.element),
  };
}

/**
 * What a work shows, kept up to date; {element, leave}. `onband` is told a band drawn with the mouse, `onagain` values
 * to run with, `ongoing` the number of a stopped work that is to go on.
 */
export function live(number, { onband = null, onagain = null, ongoing = null }) {
  const said = h("div", { class: "row", role: "status" });
  const halt = h("button", { type: "button", class: "quiet", onclick: () => stop(number) }, "Stop"); // one: a click needs it to stay
  const below = h("div", { role: "status" });
  const body = h("div");
  const tail = h("div");
  let picture = null;
  let knob = null;
  let waits = 0;
  let units = {}; // of inputs and outputs by name, as far as they are known
  const subject = server.works.get(number)?.subject ?? [];
  if (subject.length === 1) {
    factsOf(subject[0]).then((facts) => {
      units = Object.fromEntries([...facts.inputs, ...facts.outputs, ...facts.states].map((v) => [v.name, v.unit ?? ""]));
    }, () => {}); // its failure is told where the work itself fails
  }
  const update = async () => {
    const work = server.works.get(number);
    if (!work) return;
    const running = work.state === "running" || work.state === "waiting";
    halt.hidden = !running;
    fill(said,
      h("strong", { class: { failed: "bad", stopped: "watch" }[work.state] ?? "" }, work.state === "done" && !work.well ? "done, not all well" : work.state),
      h("span", {}, running ? [work.total ? `${work.done} of ${work.total}` : "", work.words ?? ""].join(" ") : work.seconds ? `${shown(work.seconds, 3)} s` : ""),
      work.goes_on && ongoing ? h("button", { type: "button", class: "quiet", title: "Measure what is missing; what is finished stays", onclick: () => ongoing(number) }, "Go on") : null,
      work.state === "stopped" && !work.goes_on && onagain ? h("button", { type: "button", class: "quiet", onclick: () => onagain({}) }, "Run again") : null);
    fill(below,
      running ? h("progress", { max: work.total || 1, value: work.total ? work.done : null, "aria-label": work.command }) : null,
      work.failure?.message ? h("p", { class: "bad" }, `${work.failure.kind}: ${work.failure.message}`) : null,
      running ? null : headline(work));
    if (work.points.length && work.points.some((p) => p && "response" in p)) {
      picture ??= new Bode({ onband, number, onagain });
      if (!picture.element.isConnected) fill(body, picture.element);
      if (running) picture.show(ofPoints(work.points.filter(Boolean), { input: units[work.asked.input] ?? "", output: units[work.asked.output] ?? "" }));
    }
    if (running) fill(tail, code(work.line, "The same in a terminal"));
    else await finished();
  };
  const finished = async () => {
    const full = await whole(number);
    if (full.curves.length) {
      picture ??= new Bode({ onband, number, onagain });
      picture.show(full.curves, full);
      if (full.command === "loop" && full.record.linear) {
        knob ??= gainKnob(full, picture);
        fill(body, knob);
      } else if (!picture.element.isConnected) fill(body, picture.element);
    } else if (full.signals) {
      fill(body, histories(full.signals));
    }
    fill(tail, afterwards(full));
  };
  const end = onChange((work, event) => {
    if (work.number !== number) return;
    if (event.event === "state") update();
    else waits ||= requestAnimationFrame(() => { waits = 0; update(); });
  });
  update();
  return { element: h("div", {}, h("div", { class: "row" }, said, halt), below, body, tail), leave: end };
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

const FIRST = 12; // verdicts and remarks that stand open

/** What the record says first, as its report does: in a sentence, verdicts, warnings and remarks. */
function headline({ lead, verdicts, remarks }) {
  const lines = [...(verdicts ?? []).map(told), ...(remarks ?? []).map((text) => h("p", {}, text))];
  return h("section", { class: "headline", "aria-label": "What was found" }, lead ? h("p", {}, lead) : null, lines.slice(0, FIRST),
    lines.length > FIRST ? h("details", {}, h("summary", {}, `${lines.length - FIRST} more`), lines.slice(FIRST)) : null);
}

const PICTURED = new Set(["nfr", "branches", "loop", "simulate"]); // whose pictures say it; of others the report does

/** What a work that has ended gives: remarks, files, report, the command and the Python. */
function afterwards(full) {
  const at = `/api/works/${full.number}`;
  const reported = () => {
    const waits = h("p", { class: "dim" }, "The report is being written …");
    return [waits, h("iframe", { src: `${at}/report.html`, title: "Report", onload: () => waits.remove() })];
  };
  const report = h("div", {}, full.has_record && !PICTURED.has(full.command) ? reported() : null);
  return [
    full.has_record ? h("div", { class: "row" },
      h("button", { type: "button", onclick: () => fill(report, reported()) }, "Report"),
      h("a", { class: "button", href: `${at}/report.html`, download: `${full.command}-${full.number}.html` }, "Save the report"),
      h("a", { class: "button", href: `${at}/picture.svg`, download: `${full.command}-${full.number}.svg` }, "Picture"),
      h("a", { class: "button", href: `${at}/data.csv`, download: `${full.command}-${full.number}.csv` }, "CSV"),
      h("a", { class: "button", href: `${at}/data.json`, download: `${full.command}-${full.number}.json` }, "JSON")) : null,
    code(full.line, "The same in a terminal"), full.call ? code(full.call, "in Python") : null,
    full.chosen.length ? h("p", { class: "dim" }, full.chosen.join("; ")) : null, report,
  ];
}
