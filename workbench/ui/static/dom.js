// Elements of the page; text is always text, never markup.

/** An element with properties ("class", "onclick", "aria-…", …) and children (texts, elements, lists, null). */
export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && !["list", "form", "class", "for", "width", "height"].includes(name)) element[name] = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat(3).filter((c) => c !== null && c !== undefined && c !== false));
  return element;
}

/** Replace what an element holds. */
export function fill(element, ...children) {
  element.replaceChildren(...children.flat(3).filter((c) => c !== null && c !== undefined && c !== false));
  return element;
}

/** A button with a list of others below it. */
export function menu(label, items) {
  const list = h("div", { class: "menu-list" }, items);
  const element = h("details", { class: "menu" }, h("summary", { class: "button" }, label), list);
  list.addEventListener("click", (event) => { if (event.target.closest("a, button:not([aria-pressed])")) element.open = false; });
  element.addEventListener("focusout", (event) => { if (event.relatedTarget && !element.contains(event.relatedTarget)) element.open = false; });
  element.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    element.open = false;
    element.firstChild.focus();
  });
  return element;
}

/** A table: headings, rows of cells; numbers stand at the right, words of the column `verdict` have their `tones`. */
export function table(headings, rows, { caption = "", label = caption, verdict = null, tones = [] } = {}) {
  return h("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": label || headings.join(", ") },
    h("table", {},
      caption ? h("caption", {}, caption) : null,
      h("thead", {}, h("tr", {}, headings.map((t) => (t ? h("th", { scope: "col" }, t) : h("td"))))),
      h("tbody", {}, rows.map((row, k) => h("tr", {}, row.map((cell, i) =>
        i === 0 ? h("th", { scope: "row", class: i === verdict ? toned(tones[k]) : "" }, cell)
          : h("td", { class: i === verdict ? toned(tones[k]) : headings[i] !== "unit" && /^[-+−–\d.,e∞]+$/.test(String(cell)) ? "number" : "" }, cell)))))));
}

/** Class of a tone. */
function toned(tone) {
  return { poor: "bad" }[tone] ?? tone ?? "";
}

/** A verdict in its tone: its word, and what it is about. */
export function told({ word, tone, text }) {
  return h("p", {}, h("strong", { class: toned(tone) }, word), ` ${text}`);
}

/** Say something to those who see and to those who hear; it goes by itself, or when the next thing is said. */
export function say(text, bad = false) {
  const line = h("p", { class: bad ? "bad" : "" }, text);
  const place = document.getElementById("said");
  for (const older of [...place.children]) if (!older.classList.contains("bad")) older.remove(); // what went wrong stays
  place.append(line);
  setTimeout(() => line.remove(), bad ? 12000 : 5000);
}

/** What went wrong, in a line: a message, or those of the fields of a form. */
export function wrongs(error) {
  return Object.values(error.fields ?? { "": error.message }).join("; ");
}

/** A button that copies a text. */
function copying(text) {
  return h("button", {
    type: "button", class: "quiet", "aria-label": `Copy: ${text.split("\n")[0].slice(0, 60)}`,
    onclick: async (event) => {
      try {
        await navigator.clipboard.writeText(text);
        say("Copied.");
      } catch {
        const range = document.createRange();
        range.selectNodeContents(event.target.parentElement.querySelector("code") ?? event.target);
        getSelection().removeAllRanges();
        getSelection().addRange(range);
        say("Selected; copy it with Ctrl+C.");
      }
    },
  }, "Copy");
}

/** Code that can be copied. */
export function code(text, title) {
  return h("div", { class: "code" }, h("span", { class: "dim" }, title), h("pre", { tabIndex: 0, "aria-label": title }, h("code", {}, text.includes("\n") ? text : text.split(" ").flatMap((word) => [h("span", { class: "word" }, word), " "]))), copying(text));
}

/** Let a browser save a text or a blob under a name. */
export function save(content, name, type = "text/plain") {
  const blob = content instanceof Blob ? content : new Blob([content], { type });
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
