// Numbers of the pictures: decibels, phases that do not jump, nearest points, differences, ticks. No page is touched here.

/** Gain in decibels; null where there is none. */
export function decibels(re, im) {
  const gain = Math.hypot(re, im);
  return gain > 0 && Number.isFinite(gain) ? 20 * Math.log10(gain) : null;
}

/**
 * Phase [deg] of points in the order given, without jumps of more than half a turn between neighbours.
 * Points without a value are null and are stepped over.
 */
export function unwrapped(points) {
  let last = null;
  return points.map(({ re, im }) => {
    if (re === null || im === null || (re === 0 && im === 0)) return null;
    let phase = (Math.atan2(im, re) * 180) / Math.PI;
    if (last !== null) phase -= 360 * Math.round((phase - last) / 360);
    last = phase;
    return phase;
  });
}

/** Phase [deg] within (-180, 180]. */
export function wrapped(points) {
  return points.map(({ re, im }) => (re === null || im === null ? null : (Math.atan2(im, re) * 180) / Math.PI));
}

/** The curve as Bode shows it, by rising frequency unless it is a branch, which may fold back. */
export function bode(curve, { unwrap = true, linear = false, radians = false } = {}) {
  const all = curve.frequency_hz.map((f, i) => ({ f, re: curve.re[i], im: curve.im[i], i }));
  if (curve.kind !== "branch") all.sort((a, b) => a.f - b.f);
  const phase = (unwrap ? unwrapped : wrapped)(all);
  return {
    x: all.map((p) => (radians ? 2 * Math.PI * p.f : p.f)),
    gain: all.map((p) => (p.re === null ? null : linear ? Math.hypot(p.re, p.im) : decibels(p.re, p.im))),
    phase,
    index: all.map((p) => p.i),
    // What the error, relative to the value as a complex number, is of the gain and of the phase.
    low: all.map((p) => bounded(p, curve.error?.[p.i], -1, linear)),
    high: all.map((p) => bounded(p, curve.error?.[p.i], 1, linear)),
    swing: all.map((p) => {
      const e = curve.error?.[p.i];
      return e === null || e === undefined ? null : e >= 1 ? 180 : (Math.asin(e) * 180) / Math.PI;
    }),
  };
}

function bounded({ re, im }, error, sign, linear) {
  if (re === null || error === null || error === undefined) return null;
  const gain = Math.hypot(re, im) * Math.max(0, 1 + sign * error);
  if (linear) return gain;
  return gain > 0 ? 20 * Math.log10(gain) : -400;
}

/** Second response over the first at the frequencies of the first, where both are known: [{f, db, deg}]. */
export function difference(first, second) {
  const b = bode(second);
  const found = [];
  first.frequency_hz.forEach((f, i) => {
    const gain = between(b.x, b.gain, f);
    const phase = between(b.x, b.phase, f);
    const own = decibels(first.re[i] ?? 0, first.im[i] ?? 0);
    if (gain === null || phase === null || own === null) return;
    let deg = phase - (Math.atan2(first.im[i], first.re[i]) * 180) / Math.PI;
    deg -= 360 * Math.round(deg / 360);
    found.push({ f, db: gain - own, deg });
  });
  return found.sort((p, q) => p.f - q.f);
}

/** Value between points, straight over the logarithm of x; null outside, or beside a point that is missing. */
export function between(xs, ys, x) {
  const right = xs.findIndex((v) => v >= x * (1 - 1e-9));
  if (right < 0) return null;
  if (Math.abs(xs[right] - x) <= 1e-9 * x) return ys[right];
  if (right === 0 || ys[right] === null || ys[right - 1] === null) return null;
  const t = Math.log(x / xs[right - 1]) / Math.log(xs[right] / xs[right - 1]);
  return ys[right - 1] + t * (ys[right] - ys[right - 1]);
}

/** Number of the point nearest to a place on the screen; null: none within `most`. Points are {x, y} in pixels. */
export function nearest(points, x, y, most = Infinity) {
  let best = null;
  let least = most * most;
  points.forEach((p, i) => {
    if (p === null) return;
    const d = (p.x - x) ** 2 + (p.y - y) ** 2;
    if (d <= least) [best, least] = [i, d];
  });
  return best;
}

/** Ticks of an axis: [{value, label, minor}]. */
export function ticks(low, high, log, most = 8) {
  if (!(high > low)) return [];
  return log && high / low >= 4 ? logarithmic(low, high) : linear(low, high, most);
}

function linear(low, high, most) {
  const raw = (high - low) / Math.max(2, most);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * (1 - 1e-9));
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high * (1 + 1e-12) + step * 1e-9; k += 1) {
    found.push({ value: k * step, label: brief(k * step, step), minor: false });
  }
  return found;
}

function logarithmic(low, high) {
  const decades = Math.log10(high / low);
  const found = [];
  const every = Math.max(1, Math.ceil(decades / 8));
  for (let d = Math.floor(Math.log10(low)); d <= Math.ceil(Math.log10(high)); d += 1) {
    for (let m = 1; m < 10; m += 1) {
      const value = m * 10 ** d;
      if (value < low * (1 - 1e-9) || value > high * (1 + 1e-9)) continue;
      const named = m === 1 ? d % every === 0 : (decades < 1 ? [2, 3, 4, 5, 7] : decades < 2.2 ? [2, 5] : []).includes(m);
      found.push({ value, label: named ? brief(value, value) : "", minor: m !== 1 });
    }
  }
  return found;
}

/** A number for a tick, as short as its neighbours allow. */
export function brief(value, step) {
  if (Math.abs(value) < step * 1e-6) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(3).replace(/\.?0+e/, "e").replace("e+", "e");
  const places = Math.max(0, Math.min(8, -Math.floor(Math.log10(step) + 1e-9)));
  return String(Number(value.toFixed(places)));
}

/** A unit as it is shown: 1 is none, and powers are raised ("m/s2": m/s²). */
export function unitShown(unit) {
  return !unit || unit === "1" ? "" : unit.replace(/(?<=[A-Za-z])[234](?![\w])/g, (d) => "²³⁴"[d - 2]);
}

/** A value with its unit, if it has one. */
export function withUnit(text, unit) {
  return `${text} ${unitShown(unit)}`.trimEnd();
}

/** A value as it is: the shortest text that gives the number back. */
export function exact(value) {
  if (typeof value !== "number" || !Number.isFinite(value)) return shown(value);
  const size = Math.abs(value);
  return size >= 1e6 || (size < 1e-3 && size > 0) ? value.toExponential().replace("e+", "e") : String(value);
}

/** A number for a table or a cursor. */
export function shown(value, digits = 5) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return String(value);
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  if (size >= 1e6 || (size < 1e-3 && size > 0)) return value.toExponential(digits - 1).replace(/\.?0+e/, "e").replace("e+", "e");
  return String(Number(value.toPrecision(digits)));
}

const EDGE = 1.2; // times the farthest unstable pole reaches a root locus

/** Ranges [of Re, of Im] of a root locus: poles {re, im} of a size, and whatever is unstable. */
export function locusRanges({ re, im }, size) {
  const unstable = re.map((_, i) => i).filter((i) => re[i] > 0);
  const tall = Math.max(size, ...unstable.map((i) => EDGE * Math.abs(im[i])));
  return [[-size, Math.max(size / 4, ...unstable.map((i) => EDGE * re[i]))], [-tall, tall]];
}

/** Smallest and largest of the numbers in lists; null where there is none. */
export function extent(lists) {
  let low = Infinity;
  let high = -Infinity;
  for (const list of lists) {
    for (const v of list) {
      if (v === null || v === undefined || !Number.isFinite(v)) continue;
      if (v < low) low = v;
      if (v > high) high = v;
    }
  }
  return low <= high ? [low, high] : null;
}
