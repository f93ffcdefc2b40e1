// What can stand at a place in a study file, by the schema of study files. No page is touched here.

const MOST = 80; // of what is offered

/** Tables of a text by their lines: [{name, from, to, keys: {key: value as written}}]; the first, "", has no heading. */
export function tablesOf(text) {
  const tables = [{ name: "", from: 0, keys: {} }];
  text.split("\n").forEach((line, i) => {
    const heading = line.match(/^\s*\[\[?\s*([^\]]+?)\s*\]\]?/);
    const pair = line.match(/^\s*("[^"]*"|[\w.-]+)\s*=\s*(.*)$/);
    if (heading) tables.push({ name: heading[1].replaceAll('"', ""), from: i, keys: {} });
    else if (pair) tables.at(-1).keys[pair[1]] = pair[2].trim();
  });
  tables.forEach((table, i) => { table.to = (tables[i + 1]?.from ?? Infinity) - 1; });
  return tables;
}

/** Names that tables or keys give: those of analyses ("analyses.NAME"), models ("models.NAME", or a key of [models]). */
export function namesIn(tables, section) {
  const found = new Set();
  for (const { name, keys } of tables) {
    if (name.startsWith(`${section}.`)) found.add(name.split(".")[1]);
    for (const key of Object.keys(keys)) {
      if (name === section) found.add(key.split(".")[0].replaceAll('"', ""));
      else if (!name && key.startsWith(`${section}.`)) found.add(key.split(".")[1]);
    }
  }
  return [...found];
}

function resolved(schema, held) {
  return held?.$ref ? held.$ref.replace("#/", "").split("/").reduce((s, key) => s[key], schema) : held;
}

/** All tables that a place can be, each with properties: branches of anyOf are taken apart; beside properties they are conditions. */
function branches(schema, held) {
  const own = resolved(schema, held);
  return own?.anyOf && !own.properties ? own.anyOf.flatMap((h) => branches(schema, h)) : own ? [own] : [];
}

function bare(value) {
  return (value ?? "").replace(/\s*#.*$/, "").replace(/^"(.*)"$/, "$1");
}

/** Keys of a table → their schemas. */
export function propertiesOf(schema, { name, keys }) {
  const [section, ...rest] = name.split(".");
  const held = schema.properties[section];
  if (!name) return schema.properties;
  if (section === "requirements" || section === "analyses") {
    const [key, every] = section === "requirements" ? ["kind", branches(schema, held.items)] : ["command", branches(schema, held.additionalProperties)];
    const named = every.filter((b) => b.properties[key].const !== undefined); // the last branch fits all
    const chosen = named.filter((b) => b.properties[key].const === bare(keys[key]));
    const own = Object.assign({}, ...chosen.map((b) => b.properties));
    return { ...own, [key]: { description: section === "requirements" ? "What is required." : "Command that is run.", enum: [...new Set(named.map((b) => b.properties[key].const))] } };
  }
  const at = rest.length ? held?.additionalProperties : held;
  return Object.assign({}, ...branches(schema, at).map((b) => b.properties ?? {}));
}

/** Words that a value can be. */
function wordsOf(schema, held) {
  return branches(schema, held).flatMap((b) => (b.const !== undefined ? [b.const] : b.enum ?? (b.type === "boolean" ? [true, false] : [])));
}

/**
 * What can stand where the cursor is: {from, items: [{insert, label, detail}]}; `from` is where the word begins that an
 * item takes the place of.
 */
export function completions(schema, text, at) {
  const before = text.slice(0, at);
  const line = before.slice(before.lastIndexOf("\n") + 1);
  const tables = tablesOf(text);
  const number = before.split("\n").length - 1;
  const table = tables.findLast((t) => t.from <= number);
  const offer = (from, typed, items) => {
    const wanted = typed.toLowerCase();
    const fits = items.filter((i) => i.label.toLowerCase().includes(wanted));
    return { from, items: fits.sort((a, b) => b.label.toLowerCase().startsWith(wanted) - a.label.toLowerCase().startsWith(wanted)).slice(0, MOST) };
  };
  const heading = line.match(/^\s*\[+([\w."-]*)$/);
  if (heading) {
    const tops = Object.entries(schema.properties).filter(([, p]) => ["object", "array"].includes(p.type) || p.anyOf);
    return offer(at - line.trimStart().length, heading[1], tops.map(([n, p]) => ({ label: n, insert: n === "requirements" || n === "approvals" ? `[[${n}]]\n` : n === "analyses" ? "[analyses.NAME]\n" : `[${n}]\n`, detail: p.description ?? "" })));
  }
  const properties = propertiesOf(schema, table);
  const key = line.match(/^\s*([\w-]*)$/);
  if (key) {
    const free = Object.entries(properties).filter(([n]) => !(n in table.keys) || n === key[1]);
    return offer(at - key[1].length, key[1], free.map(([n, p]) => ({ label: n, insert: `${n} = `, detail: [p.unit ? `[${p.unit}]` : "", p.description ?? ""].filter(Boolean).join(" ") })));
  }
  const value = line.match(/^\s*([\w-]+)\s*=\s*\[?(?:.*,\s*)?("?[\w:.-]*)$/);
  if (!value) return { from: at, items: [] };
  const [, name, typed] = value;
  const named = { analysis: "analyses", analyses: "analyses", model: "models", models: "models" }[name];
  const words = named && table.name ? namesIn(tables, named) : wordsOf(schema, properties[name]);
  return offer(at - typed.length, typed.replace('"', ""), words.map((w) => ({ label: String(w), insert: typeof w === "string" ? JSON.stringify(w) : String(w), detail: "" })));
}
