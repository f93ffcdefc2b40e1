// A list of variables under a field, searched by name, unit and description while one types; of 100,000 as of ten.

import { fill, h } from "./dom.js";
import { exact, unitShown } from "./numbers.js";

const MOST = 60; // lines at once
const PAGE = 8; // lines that PageDown goes

let count = 0;

/**
 * Let a field offer variables {name, unit?, description?, min?, max?}; in a text area each line is one choice, followed
 * by `after`. Return what is to stand in the page: the field with its list.
 */
export function withPicker(input, variables, after = "") {
  if (!variables.length) return input;
  const id = `picker-${(count += 1)}`;
  const several = input.tagName === "TEXTAREA";
  const list = h("ul", { id, class: "picker", role: "listbox", "aria-label": "Variables", hidden: true });
  let words = null;
  let found = [];
  let at = -1;
  const typed = () => (several ? input.value.slice(0, input.selectionStart).split("\n").pop() : input.value);
  const close = () => {
    list.hidden = true;
    list.replaceChildren();
    if (!several) input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
  };
  const take = (variable) => {
    if (several) {
      const before = input.value.slice(0, input.selectionStart);
      const line = before.slice(before.lastIndexOf("\n") + 1);
      const rest = input.value.slice(input.selectionStart);
      input.value = before.slice(0, before.length - line.length) + variable.name + after + rest;
      const end = input.value.length - rest.length;
      input.setSelectionRange(end, end);
    } else input.value = variable.name + after;
    close();
    input.dispatchEvent(new Event("input", { bubbles: true }));
    close();
  };
  const mark = (to) => {
    at = Math.max(0, Math.min(found.length - 1, to));
    [...list.children].forEach((line, i) => line.setAttribute("aria-selected", String(i === at)));
    list.children[at]?.scrollIntoView({ block: "nearest" });
    input.setAttribute("aria-activedescendant", `${id}-${at}`);
  };
  const open = (all = false) => {
    const text = all ? "" : typed().trim().toLowerCase();
    if (several && after && text.includes(after)) return close(); // its value is written now
    words ??= variables.map((v) => `${v.name} ${unitShown(v.unit)} ${v.description ?? ""}`.toLowerCase());
    found = [];
    const parts = text.split(/\s+/);
    for (let i = 0; i < variables.length && found.length <= MOST; i += 1) if (parts.every((p) => words[i].includes(p))) found.push(variables[i]);
    const more = found.length > MOST;
    found = found.slice(0, MOST);
    at = -1;
    if (!found.length || (found.length === 1 && found[0].name === typed().trim())) return close();
    fill(list, found.map((v, i) => h("li", { id: `${id}-${i}`, role: "option", "aria-selected": "false", onpointerdown: (event) => { event.preventDefault(); take(v); } },
      h("span", { class: "name" }, v.name), " ", h("span", { class: "unit" }, [unitShown(v.unit), range(v)].filter(Boolean).join(", ")),
      v.description ? h("span", { class: "dim" }, v.description) : null)),
    more ? h("li", { class: "dim", role: "option", "aria-disabled": "true" }, `The first ${MOST}; type to find others of ${variables.length}.`) : null);
    list.hidden = false;
    list.scrollTop = 0;
    if (!several) input.setAttribute("aria-expanded", "true");
    return null;
  };
  for (const [name, value] of [...(several ? [] : [["role", "combobox"], ["aria-expanded", "false"]]), ["aria-controls", id], ["aria-autocomplete", "list"], ["autocomplete", "off"]]) input.setAttribute(name, value);
  input.addEventListener("input", (event) => event.isTrusted && open());
  input.addEventListener("click", () => open(!several));
  input.addEventListener("blur", close);
  input.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1, PageDown: PAGE, PageUp: -PAGE }[event.key];
    if (list.hidden) {
      if (event.key === "ArrowDown" && (!several || event.altKey)) {
        open(true);
        event.preventDefault();
      }
    } else if (by) {
      mark(at + by);
      event.preventDefault();
    } else if (event.key === "Enter" && at >= 0) {
      take(found[at]);
      event.preventDefault();
    } else if (event.key === "Escape") {
      close();
      event.preventDefault();
    }
  });
  return h("div", { class: "picked" }, input, list);
}

/** The range that the FMU declares for a variable, in words; empty: none. */
export function range({ min = null, max = null }) {
  if (min === null && max === null) return "";
  return min === null ? `≤ ${exact(max)}` : max === null ? `≥ ${exact(min)}` : `${exact(min)} … ${exact(max)}`;
}
