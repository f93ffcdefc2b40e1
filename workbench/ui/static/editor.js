// A text with numbers of lines, marks of mistakes, and what can stand where the cursor is.

import { completions } from "./complete.js";
import { get } from "./api.js";
import { fill, h, say } from "./dom.js";

let schema = null;

/** The schema of study files; it is asked for once. */
export function schemaOf() {
  schema ??= get("/api/study/schema");
  schema.catch(() => { schema = null; });
  return schema;
}

export class Editor {
  constructor(text, { label, onchange }) {
    this.area = h("textarea", { value: text, spellcheck: false, wrap: "off", "aria-label": label, "aria-autocomplete": "list", "aria-controls": "completions" });
    this.gutter = h("div", { class: "gutter", "aria-hidden": "true" });
    this.list = h("ul", { id: "completions", class: "picker", role: "listbox", "aria-label": "Completions", hidden: true });
    this.element = h("div", { class: "editor" }, this.gutter, this.area, this.list);
    this.marked = new Set();
    this.onchange = onchange;
    this.area.addEventListener("input", (event) => {
      this.number();
      onchange();
      if (event.inputType === "insertText" && /[\w"[]/.test(event.data ?? "")) this.complete();
      else this.close();
    });
    this.area.addEventListener("scroll", () => { this.gutter.scrollTop = this.area.scrollTop; });
    this.area.addEventListener("blur", () => this.close());
    this.area.addEventListener("keydown", (event) => this.key(event));
    this.number();
  }

  get text() {
    return this.area.value;
  }

  /** Numbers beside the lines; those with mistakes are marked. */
  number() {
    const count = this.text.split("\n").length;
    if (count === this.gutter.childElementCount && !this.renew) return;
    this.renew = false;
    fill(this.gutter, Array.from({ length: count }, (_, i) => h("div", { class: this.marked.has(i + 1) ? "bad" : "" }, String(i + 1))));
  }

  mark(lines) {
    this.marked = new Set(lines);
    this.renew = true;
    this.number();
  }

  /** Put the cursor into a line, and show it. */
  go(line) {
    if (!line) return;
    const lines = this.text.split("\n");
    const at = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    this.area.focus();
    this.area.setSelectionRange(at, at + (lines[line - 1]?.length ?? 0));
    this.area.scrollTop = Math.max(0, (line - 4) * Number.parseFloat(getComputedStyle(this.area).lineHeight));
  }

  /** Write lines at the end, so that Ctrl+Z takes them away again. */
  append(text) {
    this.area.focus();
    const end = this.text.length;
    this.area.setSelectionRange(end, end);
    this.insert(`${this.text.endsWith("\n") || !this.text ? "" : "\n"}\n${text}\n`);
    this.area.scrollTop = this.area.scrollHeight;
  }

  insert(text) {
    if (!document.execCommand("insertText", false, text)) this.area.setRangeText(text, this.area.selectionStart, this.area.selectionEnd, "end");
    this.number();
    this.onchange();
  }

  async complete(asked = false) {
    let known;
    try {
      known = await schemaOf();
    } catch (error) {
      if (asked) say(error.message, true);
      return;
    }
    const at = this.area.selectionStart;
    const { from, items } = completions(known, this.text, at);
    if (!items.length || (!asked && from === at)) {
      this.close();
      return;
    }
    this.offered = { from, to: at, items };
    this.at = 0;
    fill(this.list, items.map((item, i) => h("li", { id: `completion-${i}`, role: "option", "aria-selected": String(i === 0), onpointerdown: (event) => { event.preventDefault(); this.take(item); } }, h("span", { class: "name" }, item.label), item.detail ? h("span", { class: "dim" }, item.detail) : null)));
    this.list.hidden = false;
    const style = getComputedStyle(this.area);
    const line = this.text.slice(0, from).split("\n");
    this.list.style.top = `${Math.min(this.area.clientHeight, line.length * Number.parseFloat(style.lineHeight) - this.area.scrollTop + 12)}px`;
    this.list.style.left = `${this.gutter.offsetWidth + Math.min(this.area.clientWidth / 2, 8 * line.at(-1).length)}px`;
    this.area.setAttribute("aria-activedescendant", "completion-0");
  }

  close() {
    this.list.hidden = true;
    this.offered = null;
    this.area.removeAttribute("aria-activedescendant");
  }

  take(item) {
    const { from, to } = this.offered;
    this.area.focus();
    this.area.setSelectionRange(from, to);
    this.close();
    this.insert(item.insert);
  }

  key(event) {
    if (event.key === " " && event.ctrlKey) {
      event.preventDefault();
      this.complete(true);
      return;
    }
    if (!this.offered) return;
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (by) {
      this.at = (this.at + by + this.offered.items.length) % this.offered.items.length;
      [...this.list.children].forEach((line, i) => line.setAttribute("aria-selected", String(i === this.at)));
      this.list.children[this.at].scrollIntoView({ block: "nearest" });
      this.area.setAttribute("aria-activedescendant", `completion-${this.at}`);
    } else if (event.key === "Enter" || event.key === "Tab") this.take(this.offered.items[this.at]);
    else if (event.key === "Escape") this.close();
    else return;
    event.preventDefault();
  }
}
