// The form of a request: its fields come from the server, which knows them from the request itself.

import { fill, h } from "./dom.js";
import { unitShown } from "./numbers.js";
import { range, withPicker } from "./picker.js";

const FEW = 5; // fields stand open where none is said to come first; the others are under headings
// Option → names that it takes.
const NAMES = {
  at: "points", data: "data", validation: "data", also: "data", study: "studies", lin: "lin", nfr: "nfr", open: "loops", input: "inputs", output: "measured", inputs: "inputs", outputs: "measured", source: "measured", target: "inputs",
  block: "components", limiter: "components", attitude: "measured", watch: "measured", second: "inputs", u0: "inputs", bias: "inputs",
  signals: "inputs", x0: "states", floating: "states", dx: "states", du: "inputs", start_values: "parameters", free: "inputs", vary: "all", uncertain: "parameters", over: "all", fix: "all", bound: "all",
};
const FILLED = ["open", "input", "output", "inputs", "outputs"]; // with the first name that there is, where one is needed
const IN_UNITS = { amplitudes: "input", amplitude: "input" }; // a field in the unit of the variable that another names

/**
 * The fields of a form, with values; `facts` (of `info`) gives names to choose from and units.
 * Fields to `skip` are filled elsewhere. The object has `element`, `values()`, `set(name, value)` and `wrong({name: message})`.
 */
export class Form {
  constructor(form, facts, { values = {}, files = {}, skip = [] } = {}) {
    this.inputs = new Map();
    this.flags = new Map(form.fields.map((f) => [f.name, f.flag]));
    this.facts = facts;
    const { inputs = [], outputs = [], states = [], parameters = [], connections = [], components = [] } = facts ?? {};
    const plain = (names) => names.map((name) => ({ name }));
    this.names = {
      ...Object.fromEntries(Object.entries(files).map(([kind, names]) => [kind, plain(names)])), loops: plain(sourcesInLoops(connections)), components: plain(components.map((c) => c.name)), inputs, states, parameters,
      measured: unique([...outputs, ...states]), all: unique([...parameters, ...inputs, ...states, ...outputs]),
    };
    const groups = new Map();
    const fields = form.fields.filter((f) => !skip.includes(f.name));
    const said = fields.filter((f) => f.first);
    const first = said.length ? said : fields.filter((f) => !f.group && f.kind !== "switch").slice(0, FEW);
    for (const field of fields) {
      const group = field.required || first.includes(field) ? "" : field.group || "More";
      if (!groups.has(group)) groups.set(group, []);
      groups.get(group).push(this.field(field, values[field.name]));
    }
    this.general = h("p", { class: "wrong bad", role: "alert", hidden: true });
    const needed = (element) => Number(!element.querySelector("[aria-required]"));
    this.element = h("div", { class: "fields" }, (groups.get("") ?? []).sort((a, b) => needed(a) - needed(b)),
      [...groups].filter(([name]) => name).map(([name, fields]) => h("details", {}, h("summary", {}, name), h("div", { class: "fields" }, fields))),
      this.general);
    this.element.addEventListener("input", () => this.units());
    this.units();
  }

  /** Say the units that other fields decide, and the range that the FMU declares. */
  units() {
    for (const [name, of] of Object.entries(IN_UNITS)) {
      const [entry, other] = [this.inputs.get(name), this.inputs.get(of)];
      if (!entry || !other) continue;
      const variable = this.facts?.inputs?.find((v) => v.name === other.input.value.trim());
      const unit = unitShown(variable?.unit);
      fill(entry.unit, unit ? `[${unit}]` : "");
      const declared = variable ? range(variable) : "";
      fill(entry.range, declared ? `${variable.name}: ${declared} ${unit} as the FMU declares.` : "");
    }
  }

  field(field, value) {
    const id = `field-${field.name}`;
    const help = h("p", { class: "help", id: `${id}-help`, title: field.flag }, field.kind === "list" ? `${field.help} One a line.` : field.help);
    const wrong = h("p", { class: "wrong", id: `${id}-wrong`, hidden: true });
    const own = { id, "aria-describedby": `${id}-help ${id}-wrong`, "aria-required": field.required || null };
    const names = this.names[field.name === "free" && field.kind === "list" ? "parameters" : NAMES[field.name]] ?? []; // of calibrate and tune
    const start = value ?? (field.required && FILLED.includes(field.name) ? names[0]?.name : null);
    let input;
    if (field.kind === "switch") {
      input = h("input", { ...own, type: "checkbox", checked: value ?? Boolean(field.default) });
    } else if (field.kind === "choice") {
      input = h("select", own, field.required || field.default ? null : h("option", { value: "" }, "–"), field.choices.map((c) => h("option", { value: c, selected: c === (value ?? field.default) }, c)));
    } else if (field.kind === "list") {
      input = h("textarea", { ...own, rows: 1, value: [].concat(start ?? []).join("\n"), placeholder: field.default || field.sample });
    } else {
      const number = field.kind === "number" || field.kind === "whole";
      input = h("input", {
        ...own, type: "text", inputMode: number ? "decimal" : "text", autocomplete: "off", spellcheck: false,
        value: start ?? "", placeholder: field.default || field.sample,
      });
    }
    const unit = h("span", { class: "unit" }, field.unit ? `[${unitShown(field.unit)}]` : "");
    const declared = h("p", { class: "help" });
    this.inputs.set(field.name, { field, input, wrong, unit, range: declared });
    if (field.kind === "switch") return h("div", { class: "field switch" }, input, h("label", { for: id }, field.label), help, wrong);
    const valued = names === this.names.all || (field.kind === "list" && /=/.test(`${field.sample}${field.help}`)); // NAME=VALUE
    const entry = ["choice", "number", "whole"].includes(field.kind) ? input : withPicker(input, names, valued ? "=" : "");
    return h("div", { class: "field" }, h("label", { for: id }, `${field.label}${field.required ? " *" : ""}`, unit), entry, declared, help, wrong);
  }

  /** The command that does the same, as far as it is filled in; what ran is told by the server, in full. */
  line(command, subject, values = this.values()) {
    const words = [];
    for (const [name, value] of Object.entries(values)) {
      const flag = this.flags.get(name);
      for (const text of [].concat(value)) words.push(text === true ? flag : text === false ? flag.replace("--", "--no-") : `${flag}=${quoted(text)}`);
    }
    return ["workbench", ...command, quoted(subject), ...words].join(" ");
  }

  values() {
    const found = {};
    for (const [name, { field, input }] of this.inputs) {
      if (field.kind === "switch") {
        if (input.checked !== Boolean(field.default)) found[name] = input.checked;
      } else if (field.kind === "list") {
        const texts = input.value.split("\n").map((t) => t.trim()).filter(Boolean);
        if (texts.length) found[name] = texts;
      } else if (input.value.trim() && !(field.kind === "choice" && input.value === field.default)) found[name] = input.value.trim();
    }
    return found;
  }

  set(name, value) {
    const entry = this.inputs.get(name);
    if (!entry) return;
    entry.input.value = value;
    this.units();
  }

  /** Show every field, the first of the settings first. */
  open() {
    const closed = [...this.element.querySelectorAll("details")];
    for (const details of closed) details.open = true;
    (closed[0]?.querySelector("input, select, textarea") ?? this.element.querySelector("input"))?.focus();
  }

  wrong(fields) {
    for (const { input, wrong } of this.inputs.values()) {
      input.removeAttribute("aria-invalid");
      wrong.hidden = true;
    }
    this.general.hidden = true;
    let first = null;
    for (const [name, message] of Object.entries(fields)) {
      const entry = this.inputs.get(name);
      if (!entry) {
        fill(this.general, message).hidden = false;
        continue;
      }
      entry.input.setAttribute("aria-invalid", "true");
      fill(entry.wrong, message).hidden = false;
      entry.input.closest("details")?.setAttribute("open", "");
      first ??= entry.input;
    }
    first?.focus();
    first?.scrollIntoView({ block: "center" });
  }
}

/** A word of a command line. */
function quoted(text) {
  return /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}

/** Variables without those that have the name of an earlier one. */
function unique(variables) {
  return [...new Map(variables.map((v) => [v.name, v])).values()];
}

/** Sources of the connections [{source, destination}] that lie in a loop: where it can be opened; outputs of plants first. */
export function sourcesInLoops(connections) {
  const part = (name) => name.split(".")[0];
  const reaches = (from, to, seen = new Set()) => from === to || connections.some(({ source, destination }) => {
    if (part(source) !== from || seen.has(destination)) return false;
    seen.add(destination);
    return reaches(part(destination), to, seen);
  });
  const found = connections.filter(({ source, destination }) => reaches(part(destination), part(source))).map((c) => c.source);
  return [...new Set(found)].sort((a, b) => Number(/\.y\d*$/.test(a)) - Number(/\.y\d*$/.test(b))); // blocks have y
}
