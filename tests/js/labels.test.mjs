// Places of words in a picture: node --test tests/js
import assert from "node:assert/strict";
import { test } from "node:test";
import { meets, placed } from "../../workbench/ui/static/labels.js";

const bounds = { left: 0, right: 600, top: 0, bottom: 300 };
const WIDE = 6.6; // of a letter

function boxes(notes, places) {
  return places.map(({ x, y, align }, i) => {
    const wide = WIDE * notes[i].text.length;
    const left = { left: x, right: x - wide, center: x - wide / 2 }[align];
    return { left, right: left + wide, top: y - 7, bottom: y + 7 };
  });
}

test("a line meets a box", () => {
  const box = { left: 10, right: 20, top: 10, bottom: 20 };
  assert.ok(meets(box, [0, 15], [30, 15]));
  assert.ok(meets(box, [15, 12], [16, 13])); // inside
  assert.ok(!meets(box, [0, 0], [30, 5]));
  assert.ok(!meets(box, [0, 21], [9, 30]));
  assert.ok(meets(box, [5, 5], [25, 25]));
  assert.ok(!meets(box, [25, 0], [25, 30]));
});

test("texts keep clear of curves and of each other", () => {
  const line = Array.from({ length: 100 }, (_, i) => [6 * i, 100 + (i > 50 ? 3 * (i - 50) : 0)]); // flat, then it falls
  const other = line.map(([x, y]) => [x, y + 6]);
  const notes = [{ x: 312, y: 106, text: "−3 dB at 3.44 Hz" }, { x: 330, y: 121, text: "−3 dB at 4.07 Hz" }, { x: 250, y: 100, text: "1.2 dB at 2 Hz" }];
  const places = placed(notes, [line, other], bounds);
  const found = boxes(notes, places);
  found.forEach((box, i) => {
    assert.ok(box.left >= bounds.left && box.right <= bounds.right && box.top >= bounds.top && box.bottom <= bounds.bottom);
    for (const curve of [line, other]) assert.ok(!curve.some((p, k) => k && meets(box, curve[k - 1], p)), `text ${i} covers a curve`);
    found.slice(i + 1).forEach((b) => assert.ok(!(box.left < b.right && b.left < box.right && box.top < b.bottom && b.top < box.bottom)));
  });
});

test("a text at the edge stays inside", () => {
  const notes = [{ x: 598, y: 4, text: "phase margin 45°" }, { x: 2, y: 296, text: "gain margin 6 dB" }];
  for (const box of boxes(notes, placed(notes, [], bounds))) assert.ok(box.left >= 0 && box.right <= 600 && box.top >= 0 && box.bottom <= 300);
});
