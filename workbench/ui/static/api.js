// What the server knows: what can be opened, forms, and work, which is heard of while it runs.

export const server = { version: "", folder: "", files: [], palette: [], forms: {}, fileForms: {}, works: new Map() };

const listeners = new Set();

/** Let a function hear of each change of a work; return what ends that. */
export function onChange(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

async function answered(response) {
  const body = response.headers.get("content-type")?.includes("json") ? await response.json() : await response.text();
  if (response.ok) return body;
  const error = new Error(body.message ?? (typeof body === "string" && body ? body.trim() : `the server answered ${response.status}`));
  error.fields = body.fields ?? null;
  error.status = response.status;
  throw error;
}

export async function get(path) {
  return answered(await fetch(path));
}

export async function post(path, body = {}) {
  return answered(await fetch(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) }));
}

/**
 * Begin a request; an error has `fields` where fields of its form are wrong. What a page asks beside what a person
 * measures (a card, a trial of an operating point) is `aside`: no list shows it, and no study has it.
 */
export async function begin(command, subject, values, { aside = false } = {}) {
  const work = await post("/api/works", { command, subject: [].concat(subject), values, aside });
  return known(work);
}

/** The same of a system with other values than its file has. */
export async function beginDraft(asked) {
  return known(await post("/api/tune", asked));
}

export async function stop(number) {
  await post(`/api/works/${number}/stop`);
}

/** Throw a run that has ended away. */
export async function remove(number) {
  await post(`/api/works/${number}/remove`);
}

/** Let a stopped work go on as another one, with what it has finished; return that. */
export async function goOn(number) {
  const work = known(await post(`/api/works/${number}/go-on`));
  await whole(work.number);
  return work;
}

/** Everything about one work; when it ended, with its record and curves, which are kept. */
export async function whole(number) {
  const work = server.works.get(number);
  if (work?.full && work.full.state === work.state) return work.full;
  const full = await get(`/api/works/${number}`);
  const merged = known(full);
  full.points.forEach((point, i) => { merged.points[i] = point ?? merged.points[i]; });
  if (!["waiting", "running"].includes(full.state)) merged.full = full;
  return full;
}

/** Do a request and return all about it when it has ended. */
export function done(command, subject, values, how = {}) {
  return begin(command, subject, values, how).then((work) => ended(work.number));
}

const facts = new Map();

/** What `info` says of a model; it is asked once. */
export async function factsOf(name) {
  if (!facts.has(name)) {
    const asked = done("info", name, {}, { aside: true }).then((work) => {
      if (!work.record) throw new Error(work.failure.message ?? "there is no description");
      return { ...work.record, call: work };
    });
    facts.set(name, asked);
    asked.catch(() => facts.delete(name));
  }
  return facts.get(name);
}

/** Forget what is known of a model whose file was written. */
export function forget(name) {
  facts.delete(name);
}

/** Look again at what can be opened. */
export async function lookAgain() {
  server.files = (await get("/api/files")).files;
  for (const listener of [...fileListeners]) listener();
}

const fileListeners = new Set();

/** Let a function hear when what can be opened was looked at again. */
export function onFiles(listener) {
  fileListeners.add(listener);
}

export function ended(number) {
  return new Promise((resolve, reject) => {
    const look = () => {
      const work = server.works.get(number);
      if (["waiting", "running"].includes(work.state)) return false;
      whole(number).then(resolve, reject);
      return true;
    };
    if (look()) return;
    const end = onChange((w) => w.number === number && look() && end());
  });
}

/** How far a work is: waiting, running, ended. */
function stage(work) {
  return ["waiting", "running"].indexOf(work.state) + 1 || 3;
}

/** An answer may be older than the events that overtook it: a work that is known to have ended stays ended. */
function known(facts) {
  const work = server.works.get(facts.number) ?? { points: [] };
  const { points: _, record: __, curves: ___, signals: ____, ...told } = facts;
  const overtaken = told.state && work.state && stage(told) < stage(work);
  Object.assign(work, overtaken ? { ...told, ...work } : told);
  server.works.set(work.number, work);
  return work;
}

function heard(event) {
  if (event.event === "removed") {
    const gone = server.works.get(event.work);
    server.works.delete(event.work);
    for (const listener of [...listeners]) listener(gone ?? { number: event.work, subject: [] }, event);
    return;
  }
  const work = known({ number: event.work });
  if (event.event === "state") {
    const { id: _, work: __, event: ___, ...facts } = event;
    Object.assign(work, facts);
  } else if (event.event === "progress") {
    [work.done, work.total, work.words] = [event.done, event.total, event.words];
    if (event.point) work.points[event.index] = event.point;
  } else if (event.event === "note") {
    work.words = event.text;
  }
  for (const listener of [...listeners]) listener(work, event);
}

/** Ask for everything that a page needs, and hear of what happens from then on. */
export async function connect() {
  const start = await get("/api/start");
  Object.assign(server, { version: start.version, folder: start.folder, files: start.files, palette: start.palette });
  server.forms = Object.fromEntries(start.forms.map((f) => [f.command, f]));
  server.fileForms = Object.fromEntries(start.file_forms.map((f) => [f.command, f]));
  server.works.clear();
  await Promise.all(start.works.map(async (w) => {
    known(w);
    if (["waiting", "running"].includes(w.state)) await whole(w.number);
  }));
  hear(start.last);
}

let stream = null;

function hear(last) {
  stream?.close();
  stream = new EventSource(`/api/events?last=${last}`);
  const gone = document.getElementById("gone");
  stream.onopen = () => { gone.hidden = true; };
  stream.onmessage = (message) => heard(JSON.parse(message.data));
  stream.addEventListener("forgotten", () => location.reload());
  stream.onerror = () => { gone.hidden = false; };
}
