// Curves that stay for all pictures.

const kept = [];
let shown = true;

/** Whether pictures show the pinned curves. */
export function pinsShown() {
  return shown;
}

/** Let pictures show the pinned curves, or leave them out. */
export function showPins(on) {
  shown = on;
}

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
