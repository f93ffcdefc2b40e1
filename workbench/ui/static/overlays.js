// Curves that lie over every picture: those of runs that are ticked, and of stores.

import { server, whole } from "./api.js";

const kept = new Map(); // number of a run or name of a store → its curves
const listeners = new Set();

/** Let a function hear when they change; return what ends that. */
export function onOverlays(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** Whether the curves of a run or a store lie over every picture. */
export function isOverlaid(key) {
  return kept.has(key);
}

/** All curves that do, but for those of one run, whose picture it is. */
export function overlaid(but = null) {
  return [...kept].filter(([key]) => key !== but).flatMap(([, curves]) => curves);
}

/** Lay curves over every picture, each named after where it is from; none: no longer. */
export function overlay(key, name, curves) {
  if (curves) kept.set(key, curves.map((c) => ({ ...c, label: `${name}: ${c.label}`, points: null, marks: [] })));
  else kept.delete(key);
  for (const listener of [...listeners]) listener();
}

/** The same for a run. */
export async function overlayRun(number, on) {
  if (!on) return overlay(number);
  const { curves } = await whole(number);
  if (!curves.length) throw new Error("it has no frequency response to lay over others");
  return overlay(number, nameOf(server.works.get(number)), curves);
}

/** What a run is called. */
export function nameOf(work) {
  return work.name || `${work.command} ${work.number}`;
}
