// What an editor of studies offers: node --test tests/js
import assert from "node:assert/strict";
import { test } from "node:test";
import { completions, namesIn, tablesOf } from "../../workbench/ui/static/complete.js";

const schema = {
  properties: {
    name: { type: "string" },
    models: { type: "object", additionalProperties: { anyOf: [{ type: "string" }, { $ref: "#/$defs/model" }] } },
    analyses: { type: "object", additionalProperties: { anyOf: [
      { properties: { command: { const: "trim" }, model: {}, u0: { description: "Inputs." } } },
      { anyOf: [{ properties: { command: { const: "nfr" }, band: { description: "Band.", unit: "Hz" }, method: { anyOf: [{ enum: ["solve", "settle"] }, { $ref: "#/$defs/reference" }] } } }] },
      { properties: { command: {} } },
    ] } },
    requirements: { type: "array", items: { anyOf: [{ properties: { kind: { const: "value" }, path: {}, analysis: {} } }, { properties: { kind: { const: "mask" }, upper: {} } }, { properties: { kind: {} } }] } },
  },
  $defs: { model: { properties: { model: {}, tolerance: {} } }, reference: { type: "object", properties: { from: {} } } },
};
const TEXT = `[models]
lag = "fmu:FirstOrderLag"

[analyses.rest]
command = "trim"

[analyses.sweep]
command = "nfr"
band = "1:2"

[[requirements]]
kind = "value"
`;
const offered = (text, line) => {
  const at = text.indexOf(line) + line.length;
  return completions(schema, text, at);
};
const labels = (found) => found.items.map((i) => i.label);

test("tables and the names that they give", () => {
  const tables = tablesOf(TEXT);
  assert.deepEqual(tables.map((t) => t.name), ["", "models", "analyses.rest", "analyses.sweep", "requirements"]);
  assert.deepEqual(namesIn(tables, "analyses"), ["rest", "sweep"]);
  assert.deepEqual(namesIn(tables, "models"), ["lag"]);
  assert.deepEqual(namesIn(tablesOf('analyses.a = {command = "trim"}'), "analyses"), ["a"]);
});

test("keys are those of the command, without those that are there", () => {
  assert.deepEqual(labels(offered(`${TEXT.replace('band = "1:2"\n', 'band = "1:2"\nm')}`, '"1:2"\nm')), ["method"]);
  const found = offered(TEXT.replace('command = "trim"\n', 'command = "trim"\nu'), '"trim"\nu');
  assert.deepEqual(labels(found), ["u0"]);
  assert.equal(found.items[0].insert, "u0 = ");
});

test("values are the words of the option, analyses by their names", () => {
  assert.deepEqual(labels(offered(TEXT.replace('band = "1:2"', 'band = "1:2"\nmethod = "s'), 'method = "s')), ["solve", "settle"]);
  assert.deepEqual(labels(offered(`${TEXT}analysis = `, "analysis = ")), ["rest", "sweep"]);
  assert.deepEqual(labels(offered(TEXT.replace('command = "trim"', 'command = "'), 'command = "')), ["trim", "nfr"]);
  assert.deepEqual(labels(offered(TEXT.replace('kind = "value"', 'kind = "'), 'kind = "')), ["value", "mask"]);
});
