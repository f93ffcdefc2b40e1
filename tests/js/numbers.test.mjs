// Numbers of the browser's pictures against closed forms: node --test tests/js
import assert from "node:assert/strict";
import { test } from "node:test";
import { between, bode, decibels, difference, exact, extent, locusRanges, nearest, shown, ticks, unitShown, unwrapped, withUnit, wrapped } from "../../workbench/ui/static/numbers.js";
import { sourcesInLoops } from "../../workbench/ui/static/form.js";

const lag = (f, order = 1) => { // (1 / (1 + j f)) ^ order
  let [re, im] = [1, 0];
  for (let k = 0; k < order; k += 1) {
    const d = 1 + f * f;
    [re, im] = [(re + im * f) / d, (im - re * f) / d];
  }
  return { re, im };
};
const curve = (fs, of, kind = "measured") => ({ kind, frequency_hz: fs, re: fs.map((f) => of(f).re), im: fs.map((f) => of(f).im) });
const space = (low, high, n) => Array.from({ length: n }, (_, k) => low * (high / low) ** (k / (n - 1)));

test("values of a description are shown as they are", () => {
  for (const value of [54321.5, 2.06e7, 1 / 3, 1e-9, -0.1, 123456.789, 0, 6.02214076e23]) assert.equal(Number(exact(value)), value);
  assert.equal(exact(54321.5), "54321.5");
  assert.equal(exact(2.06e7), "2.06e7");
  assert.deepEqual([true, "text", null].map(exact), ["yes", "text", "–"]);
});

test("the unit 1 is not written", () => {
  assert.deepEqual(["1", null, "", "deg", "m/s2"].map((unit) => withUnit("2", unit)), ["2", "2", "2", "2 deg", "2 m/s²"]);
});

test("decibels", () => {
  assert.equal(decibels(10, 0), 20);
  assert.ok(Math.abs(decibels(3, 4) - 20 * Math.log10(5)) < 1e-12);
  assert.equal(decibels(0, 0), null);
  assert.equal(decibels(null, null), null);
});

test("a phase does not jump, whatever its order of arrival", () => {
  const fs = space(0.01, 100, 60);
  const mixed = fs.map((_, i) => fs[(i * 37) % 60]); // 37 and 60 have no common divisor: each once
  const b = bode(curve(mixed, (f) => lag(f, 5)));
  assert.deepEqual(b.x, fs);
  fs.forEach((f, i) => assert.ok(Math.abs(b.phase[i] + (5 * Math.atan(f) * 180) / Math.PI) < 1e-9));
});

test("gaps are stepped over", () => {
  const points = [{ re: -1, im: -0.1 }, { re: null, im: null }, { re: -1, im: 0.1 }];
  const [a, gap, c] = unwrapped(points);
  assert.equal(gap, null);
  assert.ok(Math.abs(c - a) < 20);
  assert.ok(Math.abs(wrapped(points)[2] - wrapped(points)[0]) > 300);
});

test("a branch that folds back keeps its order", () => {
  const b = bode(curve([1, 2, 1.5], (f) => lag(f), "branch"));
  assert.deepEqual(b.x, [1, 2, 1.5]);
});

test("errors as bars", () => {
  const b = bode({ ...curve([1], () => ({ re: 2, im: 0 })), error: [0.1] });
  assert.ok(Math.abs(b.low[0] - 20 * Math.log10(1.8)) < 1e-12);
  assert.ok(Math.abs(b.high[0] - 20 * Math.log10(2.2)) < 1e-12);
  assert.ok(Math.abs(b.swing[0] - (Math.asin(0.1) * 180) / Math.PI) < 1e-12);
  const all = bode({ ...curve([1], () => ({ re: 2, im: 0 })), error: [1.5] });
  assert.equal(all.swing[0], 180);
  assert.equal(bode({ ...curve([1], () => ({ re: 2, im: 0 })), error: [null] }).swing[0], null);
});

test("difference of two responses", () => {
  const [first, second] = [curve(space(0.1, 10, 7), (f) => lag(f)), curve(space(0.05, 20, 400), (f) => lag(f, 2))];
  const found = difference(first, second);
  assert.equal(found.length, 7);
  for (const { f, db, deg } of found) {
    assert.ok(Math.abs(db + 10 * Math.log10(1 + f * f)) < 1e-3);
    assert.ok(Math.abs(deg + (Math.atan(f) * 180) / Math.PI) < 1e-2);
  }
  assert.equal(difference(first, curve([50, 60], (f) => lag(f))).length, 0);
});

test("a difference does not count whole turns", () => {
  const turned = (k) => curve(space(1, 2, 20), (f) => lag(f, k));
  for (const { deg } of difference(turned(1), turned(1))) assert.equal(Math.round(deg), 0);
});

test("between", () => {
  assert.ok(Math.abs(between([1, 100], [0, 2], 10) - 1) < 1e-12);
  assert.equal(between([1, 100], [0, 2], 0.5), null);
  assert.equal(between([1, 100], [0, 2], 200), null);
  assert.equal(between([1, 100], [0, null], 10), null);
  assert.equal(between([1, 100], [5, 2], 1), 5);
});

test("nearest", () => {
  const points = [{ x: 0, y: 0 }, null, { x: 10, y: 0 }];
  assert.equal(nearest(points, 9, 1), 2);
  assert.equal(nearest(points, 100, 0, 20), null);
  assert.equal(nearest([], 0, 0), null);
});

test("ticks lie inside and are round", () => {
  for (const [low, high] of [[0, 1], [-3.2, 7.9], [1e-6, 5e-6], [-1e8, 3e8], [99.9, 100.1]]) {
    const found = ticks(low, high, false);
    assert.ok(found.length >= 2 && found.length <= 12, `${low} ${high}: ${found.length}`);
    for (const t of found) assert.ok(t.value >= low - 1e-9 * (high - low) && t.value <= high + 1e-9 * (high - low));
    assert.equal(new Set(found.map((t) => t.label)).size, found.length);
  }
  const decades = ticks(0.1, 100, true).filter((t) => t.label);
  assert.deepEqual(decades.map((t) => t.label), ["0.1", "1", "10", "100"]);
  assert.deepEqual(ticks(1, 1, false), []);
});

test("what is shown", () => {
  assert.deepEqual([null, undefined, NaN, Infinity, true, 0.1 + 0.2, 123456.7].map((v) => shown(v)), ["–", "–", "–", "∞", "yes", "0.3", "123460"]);
  assert.deepEqual([2.06e7, -1e6, 999999, 5.4545e-7, 0.00522, 0].map((v) => shown(v, 6)), ["2.06e7", "-1e6", "999999", "5.4545e-7", "0.00522", "0"]);
  assert.deepEqual(extent([[1, null, 3], [], [-2, NaN]]), [-2, 3]);
  assert.equal(extent([[null]]), null);
});

test("units", () => {
  assert.deepEqual(["1", "", null, "deg", "m/s2", "kg/m3", "kg.m2/s", "1/s2", "mmH2O"].map(unitShown), ["", "", "", "deg", "m/s²", "kg/m³", "kg.m²/s", "1/s²", "mmH2O"]);
});

test("a narrow band has more than two labels", () => {
  assert.ok(ticks(0.1, 0.4, true).filter((t) => t.label).length >= 4);
});

test("labels keep their distance", () => {
  for (const [low, high] of [[0.05, 0.4], [0.1, 0.9], [0.5, 20], [1e-3, 1e4]]) {
    const at = ticks(low, high, true).filter((t) => t.label).map((t) => Math.log(t.value / low) / Math.log(high / low));
    for (let k = 1; k < at.length; k += 1) assert.ok(at[k] - at[k - 1] > 0.06, `${low} ${high}: ${at}`);
  }
});

test("where a loop can be opened", () => {
  const wires = [["error.y", "gain.u"], ["plant.del", "error.u2"], ["gain.y", "plant.delC"], ["plant.load", "scope.u"], ["source.y", "error.u1"]];
  assert.deepEqual(sourcesInLoops(wires.map(([source, destination]) => ({ source, destination }))), ["plant.del", "error.y", "gain.y"]);
  assert.deepEqual(sourcesInLoops([]), []);
});

test("a root locus shows every unstable pole", () => {
  const [[left, right], [low, high]] = locusRanges({ re: [-500, -1, 11.9, 11.9], im: [0, 700, 89, -89] }, 20);
  assert.ok(left === -20 && right > 11.9 && low < -89 && high > 89 && high < 700);
  assert.deepEqual(locusRanges({ re: [-1], im: [3] }, 20), [[-20, 5], [-20, 20]]);
});
