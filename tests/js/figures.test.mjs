// What a loop has come to, beside what is wanted: node --test tests/js
import assert from "node:assert/strict";
import { test } from "node:test";
import { endsOf, figure } from "../../workbench/ui/static/figures.js";

const design = (word, more = {}) => ({ margins: { closed_loop: word }, ...more });
const integrator = (low, high) => endsOf([high, low, (low + high) / 2].map((f) => ({ frequency_hz: f, value: [0, -1 / f] }))); // crosses at 1 Hz

test("a stable loop meets what is wanted, or not; an unstable one meets nothing", () => {
  assert.equal(figure(design("stable"), 7, 6, "db").tone, "good");
  assert.equal(figure(design("stable"), 5, 6, "db").tone, "bad");
  assert.equal(figure(design("unstable"), 14.6, 6.84, "hz").tone, "bad");
  assert.equal(figure(design("unknown"), 14.6, 6.84, "hz").tone, "");
  assert.equal(figure(design("stable"), 7, null, "db").tone, "");
});

test("a crossover below the band is told, and violates what is wanted inside or above it", () => {
  const measured = design("stable", { ends: integrator(2, 20) });
  const found = figure(measured, null, 6.84, "hz");
  assert.equal(found.tone, "bad");
  assert.match(found.text, /below 2 .*not measured/);
  assert.equal(figure(measured, null, 1.5, "hz").tone, "watch"); // below 2 Hz anything may be
  for (const key of ["db", "deg"]) assert.deepEqual([figure(measured, null, 6, key).text, figure(measured, null, 6, key).tone], ["not known", "watch"]);
  assert.equal(figure(measured, null, undefined, undefined).tone, ""); // nothing is wanted
});

test("a crossover above the band is told, and meets what is wanted below or inside it", () => {
  const measured = design("stable", { ends: integrator(0.1, 0.5) });
  assert.equal(figure(measured, null, 0.4, "hz").tone, "good");
  assert.match(figure(measured, null, 0.4, "hz").text, /above 0.5 /);
  assert.equal(figure(measured, null, 2, "hz").tone, "watch");
});

test("points without a value are no ends", () => {
  assert.equal(endsOf([{ frequency_hz: 1, value: null }]), null);
  assert.deepEqual(endsOf([{ frequency_hz: 1, value: null }, { frequency_hz: 2, value: [3, 4] }]).map((e) => e.gain), [5, 5]);
});
