// Where words stand in a picture: beside their points, clear of curves and of each other. No page is touched here.

const HIGH = 14; // of a line of text [pixel]
const WIDE = 6.6; // of a letter, on average
const GAP = 9; // beside a point
const STEPS = [12, 26, 40, 56, 72, 92]; // above or below it
const NEAR = 20; // farther away, a line leads to the point
const [OVER_CURVE, OVER_MARK, OVER_TEXT, OUTSIDE] = [10, 15, 40, 1000]; // what it costs to cover one

/** Whether a line from point to point meets a box {left, right, top, bottom}. */
export function meets({ left, right, top, bottom }, [x0, y0], [x1, y1]) {
  let [from, to] = [0, 1];
  for (const [d, low, high] of [[x1 - x0, left - x0, right - x0], [y1 - y0, top - y0, bottom - y0]]) {
    if (d === 0) {
      if (low > 0 || high < 0) return false;
      continue;
    }
    const [a, b] = [low / d, high / d];
    from = Math.max(from, Math.min(a, b));
    to = Math.min(to, Math.max(a, b));
    if (from > to) return false;
  }
  return true;
}

function overlap(a, b) {
  return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
}

/**
 * Places of texts [{x, y, text}] that belong to points, inside `bounds` {left, right, top, bottom}; `lines` are lists of
 * points [x, y] that they keep clear of. Each place: {x, y, align, leads}: a line leads to the point; in the same order.
 */
export function placed(notes, lines, bounds) {
  const taken = [];
  const marks = notes.map(({ x, y }) => ({ left: x - 5, right: x + 5, top: y - 5, bottom: y + 5 }));
  return notes.map(({ x, y, text }) => {
    const wide = WIDE * text.length;
    let best = null;
    for (const [k, step] of STEPS.entries()) {
      for (const dy of [-step, step]) {
        const sides = [["left", x + GAP, 0], ["right", x - GAP - wide, 0.2], ["center", x - wide / 2, 0.4], ["left", bounds.left, 1], ["right", bounds.right - wide, 1]];
        for (const [align, left, aside] of sides) {
          const box = { left, right: left + wide, top: y + dy - HIGH / 2, bottom: y + dy + HIGH / 2 };
          let cost = 2 * k + (dy > 0 ? 0.5 : 0) + aside;
          if (best && cost >= best.cost) continue;
          if (box.left < bounds.left || box.right > bounds.right || box.top < bounds.top || box.bottom > bounds.bottom) cost += OUTSIDE;
          cost += OVER_TEXT * taken.filter((t) => overlap(t, box)).length + OVER_MARK * marks.filter((m) => overlap(m, box)).length;
          for (const line of lines) if (line.some((p, i) => i && meets(box, line[i - 1], p))) cost += OVER_CURVE;
          if (!best || cost < best.cost) best = { cost, box, align, leads: step > NEAR };
        }
      }
    }
    const { box, align, leads } = best;
    taken.push(box);
    return { x: { left: box.left, right: box.right, center: (box.left + box.right) / 2 }[align], y: (box.top + box.bottom) / 2, align, leads };
  });
}
