// Curves that stay for all pictures.

const kept = [];

/** The pinned curves. */
export function pinned() {
  return kept;
}

/** Keep a curve for all pictures. */
export function pin(curve) {
  if (!kept.some((c) => c.label === curve.label)) kept.push(curve);
}

/** Keep it no longer. */
export function unpin(label) {
  const at = kept.findIndex((c) => c.label === label);
  if (at >= 0) kept.splice(at, 1);
}
