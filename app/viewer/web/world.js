// Edits the bodies of a simulated world: each is a request to the simulation, whose answer is in the list.

const number = (id, label, value, more = "") =>
  `<label>${label} <input id="world-${id}" type="number" step="any" value="${value}" ${more}></label>`;
const TOOLS = `
  <details id="world-move"><summary>Move a body...</summary>
    <label>Body <select id="world-body"></select></label>
    <div class="axes" role="group" aria-label="Way along the axes of the world, mm">
      ${number("dx", "x, mm", 0)}${number("dy", "y", 0)}${number("dz", "z", 0)}</div>
    <div class="axes" role="group" aria-label="Turn about an axis of the world">
      <label>About <select id="world-axis"><option>x</option><option>y</option><option selected>z</option></select></label>
      ${number("turn", "degrees", 0, 'min="-360" max="360"')}</div>
    <div class="axes"><button id="world-move-confirm" type="button">Move</button>
      <button id="world-remove" type="button">Remove</button></div>
    <p id="world-drag">In the picture: hold shift, and drag a body with the left mouse button.</p></details>
  <details id="world-add"><summary>Add an obstacle...</summary>
    <label>Name <input id="world-name" type="text" maxlength="32" pattern="[A-Za-z][A-Za-z0-9_]*" value="obstacle"></label>
    <label>Shape <select id="world-shape"><option value="box">box</option><option value="ball">ball</option>
      <option value="file">STL file, mm</option></select></label>
    <div class="axes" id="world-sizes" role="group" aria-label="Size, mm">
      ${number("sx", "size, mm", 20, 'min="0.1" max="1000"')}${number("sy", "y", 20, 'min="0.1" max="1000"')}
      ${number("sz", "z", 20, 'min="0.1" max="1000"')}</div>
    <label id="world-file-label" hidden>File <input id="world-file" type="file" accept=".stl"></label>
    <div class="axes" role="group" aria-label="Place in the world, mm">
      ${number("x", "at x, mm", "")}${number("y", "y", "")}${number("z", "z", "")}</div>
    <p>All arms of the simulation stop when a body is added or removed, until they are enabled.</p>
    <button id="world-add-confirm" type="button">Add the obstacle</button></details>
  <p id="world-answer" role="status"></p>`;

export function editWorld(trame) {
  const find = (id) => document.getElementById(`world-${id}`);
  const values = (ids) => ids.map((id) => Number(find(id).value));
  const valid = (ids) => ids.every((id) => find(id).value !== "" && find(id).reportValidity());

  // Shows why nothing was requested; what the simulation answers is shown in the list.
  async function ask(request) {
    let answer = "";
    try {
      await request();
    } catch (error) {
      answer = error?.data?.exception ?? error?.message ?? String(error);
    }
    find("answer").textContent = answer;
  }

  function move() {
    if (!valid(["dx", "dy", "dz", "turn"])) return;
    const [x, y, z, turn] = values(["dx", "dy", "dz", "turn"]);
    ask(() => trame.trigger("world_move", [find("body").value, x, y, z, find("axis").value, turn]));
  }

  function add() {
    const shape = find("shape").value;
    const sizes = { box: ["sx", "sy", "sz"], ball: ["sx"], file: [] }[shape];
    if (!valid(["name", ...sizes, "x", "y", "z"])) return;
    const name = find("name").value, place = values(["x", "y", "z"]);
    if (shape === "file") return ask(() => upload(name, place));
    const size = shape === "ball" ? Array(3).fill(values(sizes)[0]) : values(sizes);
    ask(() => trame.trigger("world_add", [name, shape, size, place]));
  }

  async function upload(name, [x, y, z]) {
    const file = find("file").files[0];
    if (!file) throw new Error("file: none is chosen; expected an STL file");
    const response = await fetch(`body/${encodeURIComponent(name)}?${new URLSearchParams({ x, y, z })}`, { method: "POST", body: file });
    if (!response.ok) throw new Error((await response.json().catch(() => ({}))).problem ?? `status ${response.status}`);
  }

  function begin(tools) {
    tools.innerHTML = TOOLS;
    find("move-confirm").addEventListener("click", move);
    find("remove").addEventListener("click", () => ask(() => trame.trigger("world_remove", [find("body").value])));
    find("add-confirm").addEventListener("click", add);
    find("body").addEventListener("change", update);
    find("drag").hidden = trame.state.get("title").client;
    find("shape").addEventListener("change", () => {
      const shape = find("shape").value;
      find("sizes").hidden = shape === "file";
      find("file-label").hidden = shape !== "file";
      for (const id of ["sy", "sz"]) find(id).parentElement.hidden = shape !== "box";
    });
    find("add").addEventListener("toggle", () => {
      const at = trame.state.get("world").rows.find((row) => row.at.length)?.at ?? [];
      ["x", "y", "z"].forEach((id, n) => { if (find(id).value === "") find(id).value = at[n] ?? ""; });
    });
  }

  function update() {
    const tools = document.querySelector(".world-tools"), world = trame.state.get("world");
    if (!tools || !world) return;
    if (!tools.firstElementChild) begin(tools);
    const select = find("body"), names = world.rows.map((row) => row.name);
    if ([...select.options].map((each) => each.value).join() !== names.join()) {
      const chosen = select.value;
      select.replaceChildren(...world.rows.map((row) => new Option(`${row.name} (${row.kind})`, row.name)));
      if (names.includes(chosen)) select.value = chosen;
    }
    const is = Boolean(world.rows.find((row) => row.name === select.value)?.added);
    if (find("remove").disabled === is) find("remove").disabled = !is;
  }

  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes("world")) queueMicrotask(update);
  });
  // The section may come later than its values.
  new MutationObserver(update).observe(document.body, { childList: true, subtree: true });
}
