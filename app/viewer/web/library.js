// The list of cases: polled from the server, drawn with text nodes only, so that no name can be markup.

const SOON_MS = 1500, LATER_MS = 10000;
const find = (id) => document.getElementById(id);
const known = (value) => value !== null && value !== undefined;
const mm = (value) => (known(value) ? `${value.toFixed(2)} mm` : "unknown");
const seconds = (value) => (known(value) ? `${value.toFixed(1)} s` : "unknown");
const duration = (value) => (known(value) ? `${Math.floor(value / 60)}:${String(Math.floor(value % 60)).padStart(2, "0")}` : "unknown");
const share = (row) => (row.frames ? `${((100 * row.valid_frames) / row.frames).toFixed(1)} %` : "unknown");
const registration = (row) => (row.registration === null ? "none" : row.registration ? `accepted, FRE ${mm(row.fre_mm)}` : "refused");

// Label or what returns it, text of a case.
const ROWS = [
  ["Folder", (row) => row.folder],
  ["Changed", (row) => date(row)],
  ["Provenance", (row) => row.kind],
  ["Duration", (row) => duration(row.duration_s)],
  ["Frames", (row) => String(row.frames)],
  ["Valid frames", share],
  ["Breaches", (row) => String(row.breaches)],
  ["Deepest point", (row) => (row.breaches ? mm(row.deepest_mm) : "no breach")],
  ["Lowest distance", (row) => mm(row.min_signed_distance_mm)],
  ["Stop margin", (row) => mm(row.stop_mm)],
  ["Warning distance", (row) => mm(row.warn_mm)],
  ...["NEGATIVE", "WARNING", "POSITIVE", "UNKNOWN"].map((state) => [
    () => `Time ${listed.labels[state]}`,
    (row) => seconds(row.state_seconds[state]),
  ]),
  ["Registration", registration],
  ["As expected", (row) => (row.as_expected === null ? "nothing expected" : row.as_expected ? "yes" : "NO")],
  ["Notes", (row) => String(row.notes)],
];

let listed = { cases: [], operates: false, opened: null, labels: {}, max_upload_bytes: 0 };
let drawn = "", busy = "";
const chosen = new Set();

function date(row) {
  return new Date(row.changed).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}

function element(kind, text = "", attributes = {}) {
  const made = document.createElement(kind);
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

function problem(text) {
  find("problem").textContent = text;
}

async function answered(response) {
  if (response.ok) return response.json();
  let text = `the server answered ${response.status}`;
  try {
    text = (await response.json()).problem;
  } catch {} // without a body
  throw new Error(text);
}

// The page of an opened case has the host of this page: the server may listen at all addresses.
function local(url) {
  const target = new URL(url);
  target.hostname = location.hostname;
  return target.href;
}

async function openCase(row) {
  busy = `opening ${row.folder} ...`;
  draw();
  try {
    const { url } = await answered(await fetch(`open/${encodeURIComponent(row.folder)}`, { method: "POST" }));
    location.href = local(url);
  } catch (error) {
    problem(error.message);
  }
  busy = "";
  await refresh();
}

function card(row) {
  const item = element("li");
  const opened = listed.opened?.folder === row.folder;
  if (opened) item.dataset.opened = "true";
  if (row.picture) {
    const source = `picture/${encodeURIComponent(row.folder)}?${encodeURIComponent(row.changed)}`;
    item.append(element("img", "", { src: source, alt: `Deepest step of ${row.folder}`, loading: "lazy" }));
  } else item.append(element("div", "", { class: "blank" }));
  item.append(element("h2", row.name ?? row.folder), element("p", row.folder, { class: "folder" }));
  const state = row.state === "ready" ? date(row) : row.state === "computing" ? "is being replayed ..." : row.problem;
  item.append(element("p", state, { class: "state", "data-state": row.state }));
  if (row.state === "ready") {
    const values = element("dl");
    for (const label of ["Duration", "Breaches", "Deepest point"]) {
      const text = ROWS.find(([name]) => name === label)[1](row);
      values.append(element("dt", label), element("dd", text, label === "Breaches" && row.breaches ? { class: "breached" } : {}));
    }
    item.append(values);
  }
  const actions = element("div", "", { class: "actions" });
  const label = element("label");
  const box = element("input", "", { type: "checkbox", name: row.folder });
  box.checked = chosen.has(row.folder);
  box.disabled = row.state !== "ready" || (!box.checked && chosen.size >= 2);
  box.addEventListener("change", () => {
    if (box.checked) chosen.add(row.folder);
    else chosen.delete(row.folder);
    draw();
    document.getElementsByName(row.folder)[0]?.focus();
  });
  label.append(box, "Compare", element("span", ""));
  box.setAttribute("aria-label", `Compare ${row.folder}`);
  actions.append(label);
  if (opened) actions.append(element("a", "Go to its page", { class: "button", href: local(listed.opened.url) }));
  if (listed.operates) {
    const button = element("button", "Open", { type: "button", "aria-label": `Open ${row.folder}` });
    button.disabled = Boolean(busy) || row.state === "failed";
    button.addEventListener("click", () => openCase(row));
    actions.append(button);
  }
  item.append(actions);
  return item;
}

function draw() {
  const now = JSON.stringify([listed, [...chosen], busy]);
  if (now === drawn) return;
  drawn = now;
  const ready = listed.cases.filter((row) => row.state === "ready").length;
  find("count").textContent = busy || `${listed.cases.length} cases, ${ready} replayed`;
  find("role").hidden = listed.operates;
  find("upload").hidden = listed.max_upload_bytes === 0;
  find("upload-limit").textContent = `One case as a zip file of at most ${listed.max_upload_bytes >> 20} MiB; it is replayed before it appears.`;
  find("empty").hidden = listed.cases.length > 0;
  find("compare").disabled = chosen.size !== 2;
  find("cases").replaceChildren(...listed.cases.map(card));
}

function compare() {
  const rows = [...chosen].map((name) => listed.cases.find((row) => row.folder === name));
  if (rows.length !== 2 || !rows.every((row) => row?.state === "ready")) return;
  const head = element("tr");
  head.append(element("td"), ...rows.map((row) => element("th", row.name, { scope: "col" })));
  const body = ROWS.map(([label, text]) => {
    const line = element("tr");
    const values = rows.map(text);
    if (values[0] !== values[1]) line.dataset.differs = "true";
    line.append(element("th", typeof label === "function" ? label() : label, { scope: "row" }), ...values.map((value) => element("td", value)));
    return line;
  });
  const section = find("comparison");
  section.querySelector("thead").replaceChildren(head);
  section.querySelector("tbody").replaceChildren(...body);
  section.hidden = false;
  section.focus({ preventScroll: true });
  section.scrollIntoView({ block: "start" });
}

async function upload(event) {
  event.preventDefault();
  const file = find("upload-file").files[0], name = find("upload-name").value;
  if (file.size > listed.max_upload_bytes) {
    problem(`${file.name}: ${file.size >> 20} MiB; expected at most ${listed.max_upload_bytes >> 20} MiB`);
    return;
  }
  busy = `uploading ${name} ...`;
  problem("");
  find("upload-send").disabled = true;
  draw();
  try {
    await answered(await fetch(`upload/${encodeURIComponent(name)}`, { method: "POST", body: file }));
    event.target.reset();
    find("upload").open = false;
  } catch (error) {
    problem(error.message);
  }
  find("upload-send").disabled = false;
  busy = "";
  await refresh();
}

async function refresh() {
  try {
    listed = await answered(await fetch("library.json"));
    for (const name of chosen) if (!listed.cases.some((row) => row.folder === name)) chosen.delete(name);
    if (find("problem").dataset.lost) problem("");
    delete find("problem").dataset.lost;
  } catch (error) {
    problem(`CONNECTION LOST: ${error.message}`);
    find("problem").dataset.lost = "true";
  }
  draw();
}

async function poll() {
  await refresh();
  const waits = listed.cases.some((row) => row.state === "computing");
  setTimeout(poll, waits ? SOON_MS : LATER_MS);
}

find("compare").addEventListener("click", compare);
find("comparison-close").addEventListener("click", () => (find("comparison").hidden = true));
find("upload-form").addEventListener("submit", upload);
find("upload-file").addEventListener("change", () => {
  const name = find("upload-file").files[0]?.name.replace(/\.zip$/i, "").replace(/[^A-Za-z0-9_.-]+/g, "_") ?? "";
  if (!find("upload-name").value) find("upload-name").value = name.slice(0, 64);
});
poll();
