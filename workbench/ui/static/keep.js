// A session as a study file; texts that are written into the folder.

import { get, lookAgain, post, server } from "./api.js";
import { code, h, save, say } from "./dom.js";

export async function keepPage() {
  const text = await get("/api/study.toml");
  const lines = text.split("\n"); // the first say what is in it
  const said = lines.slice(0, lines.findIndex((line) => !line.startsWith("# "))).map((line) => h("p", {}, line.slice(2)));
  if (said.length === lines.length - 1) {
    return {
      title: "Keep",
      element: h("div", {}, h("h1", {}, "This session as a study"), said,
        h("p", {}, "There is nothing to keep yet: a study needs at least one analysis. Open a model and run one under Measure; what is measured stands here then.")),
    };
  }
  const area = h("textarea", { rows: 18, value: text, "aria-label": "Study file", spellcheck: false });
  const file = h("input", { type: "text", value: "session.toml", "aria-label": "File name" });
  return {
    title: "Keep",
    element: h("div", {}, h("h1", {}, "This session as a study"),
      said, h("p", {}, "To be run again with workbench run, in CI or elsewhere; add requirements as the page of study files says."), area,
      h("div", { class: "row" }, file, h("button", { type: "button", onclick: () => write(file.value, area.value) }, "Write into the folder"), h("button", { type: "button", class: "quiet", onclick: () => save(area.value, file.value) }, "Save elsewhere")),
      code(`workbench run ${file.value}`, "Run it"), h("h2", {}, "Commands"), [...server.works.values()].filter((w) => w.line && !w.aside).map((w) => code(w.line, `${w.number} ${w.state}`))),
  };
}

/** Write a text into the folder, and say so; ask before a file is replaced, unless it still is what it `was`. */
export async function write(name, text, was = null, said = `Wrote ${name}.`) {
  try {
    await post("/api/text", { name, text, ...(was === null ? {} : { was }) });
  } catch (error) {
    if (error.status !== 409) {
      say(error.message, true);
      return false;
    }
    if (!confirm(`${error.message}. Replace it?`)) return false;
    try {
      await post("/api/text", { name, text, replace: true });
    } catch (later) {
      say(later.message, true);
      return false;
    }
  }
  await lookAgain();
  say(said);
  return true;
}
