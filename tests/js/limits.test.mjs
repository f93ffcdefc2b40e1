// Requirements as regions: node --test tests/js
import assert from "node:assert/strict";
import { test } from "node:test";
import { marginsIn, masksIn, numberOf, stepRegions, wantedOf, wantedStudy } from "../../workbench/ui/static/limits.js";

const REQUIREMENTS = [
  { name: "a", kind: "gain margin", analysis: "loop", min: 6 }, { name: "b", kind: "gain margin", analysis: "loop", min: 8 },
  { name: "c", kind: "phase margin", analysis: "loop", min: 45 }, { name: "d", kind: "overshoot", analysis: "run", max: 20 },
  { name: "e", kind: "settling time", analysis: "run", max: 2, band: 0.1 },
  { name: "f", kind: "mask", analysis: "loop", quantity: "gain_db", upper: [[1, 0], [10, -20]] }, { name: "g", kind: "mask", analysis: "other", quantity: "gain_db", lower: [[1, 0], [2, 0]] },
];

/** Whether a place is inside a polygon. */
function inside({ x, y }, px, py) {
  let within = false;
  for (let i = 0, j = x.length - 1; i < x.length; j = i, i += 1) {
    if (y[i] > py !== y[j] > py && px < ((x[j] - x[i]) * (py - y[i])) / (y[j] - y[i]) + x[i]) within = !within;
  }
  return within;
}

test("the strictest margins are wanted, and those are changed", () => {
  assert.deepEqual(marginsIn(REQUIREMENTS), { db: 8, deg: 45, ms: null });
  assert.equal(numberOf(REQUIREMENTS, "gain margin"), 1);
  assert.equal(numberOf(REQUIREMENTS, "delay margin"), null);
  assert.deepEqual(marginsIn([]), { db: null, deg: null, ms: null });
});

test("a mask of the loop is a region above its corners", () => {
  const [region, ...others] = masksIn(REQUIREMENTS, ["loop"], "gain");
  assert.equal(others.length, 0);
  assert.ok(inside(region, 2, 5));
  assert.ok(!inside(region, 2, -30));
  assert.deepEqual(masksIn(REQUIREMENTS, ["loop"], "phase"), []);
});

test("a step stays below the overshoot, and in its band once it has settled", () => {
  const all = stepRegions(REQUIREMENTS);
  const forbidden = (t, y) => all.some((r) => inside(r, t, y));
  assert.ok(forbidden(0.5, 1.3));
  assert.ok(!forbidden(0.5, 1.15));
  assert.ok(forbidden(2.5, 1.15));
  assert.ok(forbidden(2.5, 0.85));
  assert.ok(!forbidden(2.5, 1.05));
});

test("what is wanted of a loop is a study of it, with the values that sliders have", () => {
  const text = wantedStudy({ model: "a \"b\".toml", open: "plant.y", set: { "pi.integral": 2, "pi.proportional": 0.25 }, db: 6, deg: null, hz: 1.5 });
  assert.match(text, /loop = \{model = "a \\"b\\".toml", set = \{"pi.integral" = 2.0, "pi.proportional" = 0.25\}\}/);
  assert.match(text, /kind = "gain margin"\nmin = 6.0\n/);
  assert.match(text, /kind = "gain"\nfrequency = 1.5\nmin = 0.0\n$/);
  assert.doesNotMatch(text, /phase margin/);
  assert.match(wantedStudy({ model: "a.toml", open: "plant.y", set: {}, db: 6, deg: 45, hz: null }), /loop = "a.toml"\n/);
});

test("what is wanted is of another file once the values are written there", () => {
  const asked = { open: "plant.y", db: 6, deg: 45, hz: 1.5 };
  const before = wantedStudy({ ...asked, model: "system:a", set: { "pi.integral": 2 } });
  assert.equal(wantedOf(before, "system:a", "a$1.toml"), wantedStudy({ ...asked, model: "a$1.toml", set: {} }));
  assert.equal(wantedOf(before, "system:b", "a.toml"), null); // of another system
  assert.equal(wantedOf("name = 'mine'", "system:a", "a.toml"), null);
});
