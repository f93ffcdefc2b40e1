// Poles and zeros of blocks that can be dragged: where they are, and what parameters they have elsewhere. No page is touched here.

/** What a zero or a pole of the first order, 1/−T, becomes where it is dragged to. */
function constant(name) {
  return (x) => (x === 0 ? null : { [name]: -1 / x });
}

// Kind of a block → its poles and zeros: {zero, pole} lists of {re, im, to(re, im)}; `v` are its values, `n(p)` its full names.
const OF_KIND = {
  lead_lag: ({ lead, lag }, n) => ({ zeros: lead ? [{ re: -1 / lead, im: 0, to: constant(n("lead")) }] : [], poles: lag ? [{ re: -1 / lag, im: 0, to: (x) => (x < 0 ? constant(n("lag"))(x) : null) }] : [] }),
  pi: ({ proportional: p, integral: i }, n) => ({ zeros: p && i ? [{ re: -i / p, im: 0, to: (x) => ({ [n("integral")]: -x * p }) }] : [], poles: [] }),
  pid: pidZeros,
  notch: ({ frequency: f, width, depth }, n) => {
    const w = 2 * Math.PI * f;
    const pair = (damping, to) => (damping < 1 ? [1, -1].map((sign) => ({ re: -damping * w, im: sign * w * Math.sqrt(1 - damping ** 2), to })) : []);
    const size = (x, y) => Math.hypot(x, y);
    const moved = (x, y) => ({ [n("frequency")]: size(x, y) / (2 * Math.PI) });
    return {
      zeros: pair(depth * width, (x, y) => (size(x, y) && x <= 0 ? { ...moved(x, y), [n("depth")]: -x / size(x, y) / width } : null)),
      poles: pair(width, (x, y) => (x < 0 ? { ...moved(x, y), [n("width")]: -x / size(x, y), [n("depth")]: (depth * width * size(x, y)) / -x } : null)),
    };
  },
};
OF_KIND.neal_smith_pilot = OF_KIND.crossover_pilot = OF_KIND.lead_lag;

/** (P T + D) s² + (P + I T) s + I: both zeros follow from P, I, D and T; of both that are wanted, I and D do. */
function pidZeros({ proportional: p, integral: i, derivative: d, filter: t }, n) {
  const [a, b] = [p * t + d, p + i * t];
  if (!a || !i) return { zeros: [], poles: [] };
  const square = b * b - 4 * a * i;
  const roots = square < 0 ? [1, -1].map((s) => [-b / (2 * a), (s * Math.sqrt(-square)) / (2 * a)]) : [1, -1].map((s) => [(-b + s * Math.sqrt(square)) / (2 * a), 0]);
  const to = (k) => (x, y) => {
    const other = roots[1 - k];
    const apart = square >= 0; // real ones move by themselves, a pair together
    const [sum, product] = apart ? [x + other[0], x * other[0]] : [2 * x, x * x + y * y];
    const q = -p / (sum + product * t);
    return Number.isFinite(q) ? { [n("integral")]: product * q, [n("derivative")]: q - p * t } : null;
  };
  return { zeros: roots.map(([re, im], k) => ({ re, im, to: to(k) })), poles: [] };
}

/**
 * Poles and zeros of the blocks: [{x, y, mark, label, to(x, y): values or null}]. `parameters` as the server tells them,
 * `values` those that are others now.
 */
export function handlesOf(parameters, values) {
  const blocks = new Map();
  for (const p of parameters.filter((q) => q.quick && OF_KIND[q.kind])) blocks.set(p.component, [...(blocks.get(p.component) ?? []), p]);
  return [...blocks].flatMap(([component, own]) => {
    const v = Object.fromEntries(own.map((p) => [p.name.slice(component.length + 1), values[p.name] ?? p.value]));
    const { zeros, poles } = OF_KIND[own[0].kind](v, (name) => `${component}.${name}`);
    const handle = (mark, what) => ({ re, im, to }) => ({ x: re, y: im, mark, label: `${what} of ${component}`, to });
    return [...zeros.map(handle("ring", "zero")), ...poles.map(handle("cross", "pole"))].filter((h) => Number.isFinite(h.x) && Number.isFinite(h.y));
  });
}

/** Poles of the closed loop, each dragged along the root locus {re, im, gain}: to the gain of its nearest point. */
export function closedHandles(poles, { re, im, gain, at }, factor) {
  const to = (x, y) => {
    let [best, least] = [null, Infinity];
    re.forEach((r, i) => {
      const d = (r - x) ** 2 + (im[i] - y) ** 2;
      if (d < least) [best, least] = [i, d];
    });
    return best === null ? null : { [factor]: gain[best] * at };
  };
  return poles.re.map((x, i) => ({ x, y: poles.im[i], mark: "", label: "pole of the closed loop", to }));
}
