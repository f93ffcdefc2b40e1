// Requirements of a study, drawn where a loop is tuned: what its curves have to stay out of. No page is touched here.

const FAR = 1e4; // as far as a region reaches where nothing ends it

/** The largest least value, of a kind of requirement. */
function least(requirements, kind) {
  const found = requirements.filter((r) => r.kind === kind && typeof r.min === "number").map((r) => r.min);
  return found.length ? Math.max(...found) : null;
}

/** Margins that a study asks for: {db, deg, ms}; null where it asks for none. */
export function marginsIn(requirements) {
  const delay = least(requirements, "delay margin");
  return { db: least(requirements, "gain margin"), deg: least(requirements, "phase margin"), ms: delay === null ? null : 1e3 * delay };
}

/** Regions of masks on a quantity ("gain" or "phase") over frequency; the analyses that are of the loop are `of`. */
export function masksIn(requirements, of, quantity) {
  const found = requirements.filter((r) => r.kind === "mask" && of.includes(r.analysis) && (r.quantity ?? "gain").startsWith(quantity));
  const region = (corners, edge) => ({ colour: 6, fill: true, x: [...corners.map(([f]) => f), corners.at(-1)[0], corners[0][0]], y: [...corners.map(([, v]) => v), edge, edge] });
  return found.flatMap((r) => [r.upper?.length > 1 ? region(r.upper, FAR) : null, r.lower?.length > 1 ? region(r.lower, -FAR) : null]).filter(Boolean);
}

/** What a step response has to stay out of: above the overshoot, outside of the band once it has to have settled. */
export function stepRegions(requirements) {
  const regions = [];
  for (const r of requirements) {
    if (typeof r.max !== "number") continue;
    if (r.kind === "overshoot") regions.push({ colour: 6, fill: true, x: [0, FAR, FAR, 0], y: [1 + r.max / 100, 1 + r.max / 100, FAR, FAR] });
    if (r.kind === "settling time") {
      const band = typeof r.band === "number" ? r.band : 0.02;
      for (const [edge, far] of [[1 + band, FAR], [1 - band, -FAR]]) regions.push({ colour: 6, fill: true, x: [r.max, FAR, FAR, r.max], y: [edge, edge, far, far] });
    }
  }
  return regions;
}

/** The requirement that asks most of a kind: its number among all; null: there is none. */
export function numberOf(requirements, kind) {
  const all = requirements.map((r, i) => [r, i]).filter(([r]) => r.kind === kind && typeof r.min === "number");
  return all.length ? all.reduce((a, b) => (b[0].min > a[0].min ? b : a))[1] : null;
}
