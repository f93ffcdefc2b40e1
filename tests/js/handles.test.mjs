// Poles and zeros of blocks against their transfer functions: node --test tests/js
import assert from "node:assert/strict";
import { test } from "node:test";
import { closedHandles, handlesOf } from "../../workbench/ui/static/handles.js";

const block = (kind, values) => Object.entries(values).map(([n, value]) => ({ name: `c.${n}`, component: "c", kind, value, quick: true }));
const near = (a, b) => assert.ok(Math.abs(a - b) <= 1e-9 * Math.max(1, Math.abs(b)), `${a} is not ${b}`);

/** Value of a polynomial, highest power first, at a complex place. */
function poly(coefficients, [x, y]) {
  return coefficients.reduce(([re, im], c) => [re * x - im * y + c, re * y + im * x], [0, 0]);
}

const KINDS = {
  lead_lag: [{ gain: 3, lead: 0.5, lag: 0.1 }, ({ lead }) => [lead, 1], ({ lag }) => [lag, 1]],
  pi: [{ proportional: 2, integral: 3 }, ({ proportional: p, integral: i }) => [p, i], () => [1]],
  pid: [{ proportional: 2, integral: 3, derivative: 0.4, filter: 0.01 }, ({ proportional: p, integral: i, derivative: d, filter: t }) => [p * t + d, p + i * t, i], () => [1]],
  notch: [{ frequency: 4, width: 0.5, depth: 0.2 }, ({ frequency: f, width, depth }) => [1, 2 * depth * width * 2 * Math.PI * f, (2 * Math.PI * f) ** 2], ({ frequency: f, width }) => [1, 2 * width * 2 * Math.PI * f, (2 * Math.PI * f) ** 2]],
};

for (const [kind, [values, numerator, denominator]] of Object.entries(KINDS)) {
  test(`${kind}: handles are roots, and roots go where they are dragged`, () => {
    const parameters = block(kind, values);
    const handles = handlesOf(parameters, {});
    assert.ok(handles.length);
    for (const handle of handles) {
      const of = handle.mark === "ring" ? numerator : denominator;
      const [re, im] = poly(of(values), [handle.x, handle.y]);
      const size = poly(of(values).map(Math.abs), [Math.hypot(handle.x, handle.y), 0])[0];
      near(re / size, 0);
      near(im / size, 0);
      const wanted = handle.y ? [1.3 * handle.x, 0.8 * handle.y] : [1.3 * handle.x, 0];
      const changed = Object.fromEntries(Object.entries(handle.to(...wanted)).map(([n, v]) => [n.slice(2), v]));
      const there = poly(of({ ...values, ...changed }), wanted);
      const scale = poly(of({ ...values, ...changed }).map(Math.abs), [Math.hypot(...wanted), 0])[0];
      near(Math.hypot(...there) / scale, 0);
    }
  });
}

test("values that are others now count, and blocks that cannot be taken out have none", () => {
  const [zero] = handlesOf(block("pi", { proportional: 2, integral: 3 }), { "c.integral": 8 });
  near(zero.x, -4);
  assert.deepEqual(handlesOf(block("pi", { proportional: 2, integral: 3 }).map((p) => ({ ...p, quick: false })), {}), []);
  assert.deepEqual(handlesOf(block("gain", { gain: 2 }), {}), []);
});

test("a pole that cannot be there is refused", () => {
  const [, pole] = handlesOf(block("lead_lag", { gain: 1, lead: 0.5, lag: 0.1 }), {});
  assert.equal(pole.to(1, 0), null);
});

test("a pole of the closed loop goes to the gain of the nearest point of the locus", () => {
  const locus = { re: [-1, -2, -3], im: [0, 1, 2], gain: [0.5, 1, 2], at: 2 };
  const [handle] = closedHandles({ re: [-2], im: [1] }, locus, "loop gain");
  assert.deepEqual(handle.to(-2.9, 1.8), { "loop gain": 4 });
});
