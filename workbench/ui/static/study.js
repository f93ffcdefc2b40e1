// A study: its text, its requirements with their verdicts while it runs, and what it gave.

import { begin, get, lookAgain, onChange, post, server, whole } from "./api.js";
import { fill, h, say, wrongs } from "./dom.js";
import { Editor, schemaOf } from "./editor.js";
import { write } from "./keep.js";
import { live } from "./work.js";

const TONES = { passed: "good", violated: "bad", failed: "bad" };
const RESTS = 350; // so long after the last key the draft is checked [ms]
const drafts = new Map(); // study → {text, was}: what was not written yet

export async function studyPage([name, number = null]) {
  const bundled = name.includes(":");
  const { text } = await get(`/api/text?name=${encodeURIComponent(name)}`);
  const page = new StudyPage(name, bundled ? `${name.split(":")[1]}.toml` : name, text, drafts.get(name) ?? text);
  await page.check();
  const last = number === null ? [...server.works.values()].filter((w) => ["run", "envelope"].includes(w.command) && w.subject[0] === name).pop() : server.works.get(number);
  if (last) await page.watch(last.number);
  return { title: name, leave: () => page.leave(), element: page.element };
}

class StudyPage {
  /** `was`: text of the study as it is run; `file`: where it is written, another one where it is read-only. */
  constructor(name, file, was, text) {
    Object.assign(this, { name, was, told: { mistakes: [], analyses: [], requirements: [], envelope: false }, rows: new Map() });
    this.editor = new Editor(text, { label: "Study file", onchange: () => this.changed() });
    this.file = h("input", { type: "text", id: "file", value: file, spellcheck: false });
    this.running = h("button", { type: "button", onclick: () => this.run() }, "Run");
    this.writing = h("button", { type: "button", class: "quiet", onclick: () => this.write() }, "Write");
    this.state = h("span", { class: "dim", role: "status" });
    this.wrong = h("ol", { class: "mistakes", role: "status", "aria-label": "Mistakes" });
    this.table = h("div");
    this.adding = h("div");
    this.place = h("section", { class: "result", "aria-label": "Result" });
    this.element = h("div", {}, h("div", { class: "head" }, h("h1", {}, name), h("span", { class: "dim" }, "Study")),
      h("div", { class: "study" },
        h("section", { "aria-label": "Text of the study" }, h("div", { class: "bar" }, this.running, this.writing, h("label", { for: "file", class: "dim" }, "File"), this.file, this.state), this.editor.element, this.wrong,
          h("p", { class: "help" }, "Ctrl+Space completes what is written; the page of study files says what each key means.")),
        h("section", { "aria-label": "What is required" }, this.table, this.adding)),
      this.place);
    this.changed();
  }

  leave() {
    clearTimeout(this.waits);
    this.shown?.leave();
    this.end?.();
  }

  changed() {
    const { text } = this.editor;
    const open = text !== this.was;
    if (open) drafts.set(this.name, text);
    else drafts.delete(this.name);
    this.writing.disabled = !open && !this.name.includes(":"); // of a read-only one a copy can be written
    this.state.textContent = open ? "changed" : "";
    clearTimeout(this.waits);
    this.waits = setTimeout(() => this.check(), RESTS);
  }

  /** Let the server read the draft, and show what it says and what is wrong with it. */
  async check() {
    const { text } = this.editor;
    try {
      const told = await post("/api/study", { name: this.file.value, text });
      if (text !== this.editor.text) return; // what is typed now is checked next
      this.mistakes(told.mistakes);
      if (!told.mistakes.length) this.told = told; // else the table stays as it was
      this.draw();
    } catch (error) {
      this.mistakes([{ line: null, message: wrongs(error) }]);
    }
  }

  mistakes(found) {
    this.running.disabled = Boolean(found.length);
    this.editor.mark(found.map((m) => m.line).filter(Boolean));
    fill(this.wrong, found.map(({ line, message }) => h("li", {}, line ? h("button", { type: "button", class: "bare", onclick: () => this.editor.go(line) }, `line ${line}`) : null, " ", h("span", { class: "bad" }, message))));
  }

  /** The requirements: each with what was found last; a click goes to its lines. */
  draw() {
    const { requirements, analyses, envelope } = this.told;
    const rows = requirements.flatMap((r) => {
      const found = [...this.rows.values()].filter((row) => row.name === r.name);
      return (found.length ? found : [null]).map((row) => ({ r, row }));
    });
    const over = envelope && this.work?.lead ? this.work : null; // what the map has come to
    const cells = ({ r, row }) => h("tr", {}, h("td", { class: TONES[row?.verdict] ?? "dim" }, row?.verdict ?? (over ? "see the map" : "not run")),
      h("th", { scope: "row" }, h("button", { type: "button", class: "bare", title: "Show it in the text", onclick: () => this.editor.go(r.line) }, row?.point ? `${r.name} (${row.point})` : r.name), h("span", { class: "dim" }, ` ${r.kind} of ${r.analysis}`), row?.where ? h("span", { class: "dim" }, row.where) : null, row?.reason ? h("span", { class: "watch" }, row.reason) : null),
      ...["value", "limit", "margin"].map((key) => h("td", { class: "number" }, row?.[key] ?? "")));
    const met = [...this.rows.values()].filter((row) => row.verdict === "passed").length;
    fill(this.table, h("h2", {}, rows.length ? `Requirements${this.rows.size ? `: ${met} of ${this.rows.size} met` : over ? "" : ": not run yet"}` : "No requirements yet"),
      rows.length ? h("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": "Requirements" }, h("table", {}, h("thead", {}, h("tr", {}, ["verdict", "requirement", "value", "limit", "margin"].map((t) => h("th", { scope: "col" }, t)))), h("tbody", {}, rows.map(cells)))) : null,
      over ? h("p", { class: over.well ? "good" : "bad" }, over.lead) : envelope ? h("p", { class: "dim" }, "It has an envelope: its requirement is mapped over the parameters.") : null);
    const names = analyses.map((a) => a.name).join(" ");
    if (names !== this.offered) this.offer(analyses);
    this.offered = names;
  }

  /** A form that writes a further requirement into the text. */
  async offer(analyses) {
    const kinds = await kindsOf();
    const own = new Map();
    const place = h("div", { class: "fields" });
    const kind = h("select", { id: "kind", onchange: () => show() }, Object.keys(kinds).map((k) => h("option", {}, k)));
    const show = () => {
      own.clear();
      const { properties, required = [] } = kinds[kind.value];
      const order = Object.entries(properties).filter(([n]) => n !== "kind").sort(([a], [b]) => required.includes(b) - required.includes(a));
      fill(place, h("p", { class: "help" }, kinds[kind.value].description ?? ""), order.map(([n, p]) => {
        const id = `requirement-${n}`;
        const input = n === "analysis" ? h("select", { id }, analyses.map((a) => h("option", {}, a.name))) : h("input", { id, type: "text", spellcheck: false, "aria-required": required.includes(n) || null, placeholder: p.default === undefined || p.default === null ? "" : JSON.stringify(p.default) });
        own.set(n, input);
        return h("div", { class: "field" }, h("label", { for: id }, `${n}${required.includes(n) ? " *" : ""}`, h("span", { class: "unit" }, p.unit ? `[${p.unit}]` : "")), input, h("p", { class: "help" }, p.description ?? ""));
      }));
    };
    const add = () => {
      const lines = ["[[requirements]]", ...[...own].filter(([, i]) => i.value.trim()).map(([n, i]) => `${n} = ${toml(i.value.trim(), kinds[kind.value].properties[n])}`)];
      lines.splice(1, 0, `kind = ${JSON.stringify(kind.value)}`);
      this.editor.append(lines.join("\n"));
    };
    show();
    fill(this.adding, analyses.length ? h("details", {}, h("summary", {}, "Add a requirement"), h("div", { class: "field" }, h("label", { for: "kind" }, "Kind"), kind), place, h("button", { type: "button", class: "quiet", onclick: add }, "Write it into the text")) : null);
  }

  /** Write the text into its file, and return the name of that; null: it was not to be replaced. */
  async kept() {
    const [{ text }, file] = [this.editor, this.file.value];
    if (!(await write(file, text, file === this.name ? this.was : null))) return null;
    drafts.delete(this.name);
    if (file === this.name) {
      this.was = text;
      this.changed();
    }
    return file;
  }

  async write() {
    const file = await this.kept();
    if (file && file !== this.name) location.hash = `#/open/${encodeURIComponent(file)}`;
  }

  /** Run what stands there: what was changed is written first. */
  async run() {
    const file = this.editor.text === this.was ? this.name : await this.kept();
    if (!file) return;
    try {
      const work = await begin(this.told.envelope ? "envelope" : "run", file, {});
      if (file !== this.name) {
        location.hash = `#/run/${work.number}`;
        return;
      }
      this.rows.clear();
      await this.watch(work.number);
      this.place.scrollIntoView({ block: "start" }); // it is below the text
    } catch (error) {
      say(wrongs(error), true);
    }
  }

  /** Show a run, and its verdicts as they come. */
  async watch(number) {
    this.shown?.leave();
    this.end?.();
    this.work = server.works.get(number);
    this.shown = live(number, { ongoing: () => this.run() });
    fill(this.place, this.shown.element);
    const take = (points) => {
      for (const point of points) for (const row of point?.requirements ?? []) this.rows.set(`${row.name} ${row.point}`, row);
      this.draw();
    };
    this.end = onChange((work, event) => {
      if (work.number !== number) return;
      if (event.event === "removed") fill(this.place);
      else if (event.point) take([event.point]);
      else if (event.event === "state" && work.has_record) {
        this.draw();
        lookAgain().catch(() => {});
      }
    });
    take((await whole(number)).points);
  }
}

/** What each kind of requirement takes: kind → its schema. */
async function kindsOf() {
  const { properties } = await schemaOf();
  return Object.fromEntries(properties.requirements.items.anyOf.filter((s) => s.properties.kind.const).map((s) => [s.properties.kind.const, s]));
}

/** A value as TOML has it: numbers, truths, lists and tables as they are, all else a text. */
function toml(text, schema) {
  const words = /^(true|false|[+-]?(\d[\d_]*)(\.\d+)?(e[+-]?\d+)?|[+-]?inf|\[.*\]|\{.*\}|".*")$/i.test(text);
  const texts = JSON.stringify(schema ?? {}).includes('"string"') && !JSON.stringify(schema ?? {}).includes('"number"') && !/^[[{"]/.test(text);
  return words && !texts ? text : JSON.stringify(text);
}
