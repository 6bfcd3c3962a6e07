// Edits the contour: a click on the ultrasound image adds a point, dragging moves one, a click of the
// eraser removes those around it. Each change names this page and the revision that it shows: a change of
// what another page has changed meanwhile is refused, and its reason is shown here alone.

import { chosenTool, guardedTool, toolChoice } from "./tool_choice.js";

const AUTHOR = Math.random().toString(36).slice(2, 12);
const SVG = "http://www.w3.org/2000/svg";
// Pixels of the screen: radii of a point's grip and of its dot, and how far a click may slip.
const [GRIP, DOT, SLIP] = [13, 5, 3];

const TOOLS = `
  <div class="contour-image" role="group" aria-label="A click on the image">
    <button id="contour-add" type="button" aria-pressed="false" title="Click on the image to add a point, drag to move one">Add, move</button>
    <button id="contour-erase" type="button" aria-pressed="false" title="Click on the image to erase the points around it">Erase</button>
    <label>within <input id="contour-radius" type="number" min="0.5" max="30" step="0.5" value="2"> mm</label>
  </div>
  <label class="tool-choice" hidden><span>Touch with</span> ${toolChoice("touch")}</label>
  <div>
    <button id="contour-tip" type="button" title="Add a point at the tip of the tool">Point at the tip</button>
    <button id="contour-undo" type="button">Undo</button>
  </div>
  <label>Dilation, mm <input id="contour-dilation" type="number" min="0" max="20" step="0.5"></label>
  <label>Hydromark radius, mm <input id="contour-hydromark" type="number" min="0" max="20" step="0.5"
    title="Above 0 the points mark a clip of this radius, one or more; 0: they are on the tumour's surface"></label>
  <label>Error of the calibration, mm <input id="contour-calibration" type="number" min="0" max="5" step="0.1"
    title="Standard deviation of a point: calibration of the probe, or of the tool's tip"></label>
  <details id="contour-clear"><summary>Delete all...</summary>
    <p>Delete all points on all pages? Undo restores them.</p>
    <button id="contour-clear-confirm" type="button">Delete all points</button></details>
  <details id="contour-use"><summary>Use as the tumour...</summary>
    <p>Replace the tumour of this session by the contour? The robot is held until an operator re-arms.</p>
    <button id="contour-use-confirm" type="button">Replace the tumour</button></details>
  <div><button id="contour-stl" type="button">Save STL</button> <button id="contour-ply" type="button">Save PLY</button></div>
  <p id="contour-note" role="status"></p>`;

export function editContour(trame) {
  const operates = trame.state.get("role") === "operate";
  const { live, ultrasound } = trame.state.get("title");
  let mode = ""; // what a click on the image does: "", "add", "erase"
  let dragged = null; // the point whose grip is held: n, x, y, begin, moved, isBeside
  let cross = null; // place of the cross that the keys move

  const values = () => trame.state.get("contour");
  const find = (id) => document.getElementById(id);

  function note(text) {
    if (find("contour-note")) find("contour-note").textContent = text;
  }

  async function send(name, ...args) {
    try {
      await trame.trigger(name, args);
      note("");
    } catch (error) {
      note(error?.data?.exception ?? error?.message ?? String(error));
    }
  }
  // A change of what this page shows.
  const change = (name, ...args) => send(name, AUTHOR, values().revision, ...args);

  async function save(ending) {
    const answer = await fetch(`contour.${ending}?revision=${values().revision}`);
    if (!answer.ok) return note(await answer.text());
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await answer.blob());
    link.download = `contour.${ending}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
    return note(`saved contour.${ending}`);
  }

  const image = () => document.querySelector("#us-image");
  const shownImage = () => Number(document.querySelector("#ultrasound > div")?.dataset.image ?? -1);

  // Column and row of a pointer, 0 at the centre of the first pixel; null outside the image.
  function pixelAt(event) {
    const svg = image();
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const { width, height } = svg.viewBox.baseVal;
    return x >= 0 && y >= 0 && x <= width && y <= height ? [x - 0.5, y - 0.5] : null;
  }

  function use([x, y]) {
    if (mode === "add") send("contour_add", AUTHOR, shownImage(), x, y);
    else change("contour_erase", shownImage(), x, y, Number(find("contour-radius").value));
  }

  function setMode(next) {
    mode = mode === next ? "" : next;
    find("contour-add").setAttribute("aria-pressed", mode === "add");
    find("contour-erase").setAttribute("aria-pressed", mode === "erase");
    const svg = image();
    if (!svg) return;
    svg.dataset.contour = mode;
    if (mode) {
      svg.tabIndex = 0;
      svg.setAttribute("role", "application");
      svg.setAttribute("aria-label", "Ultrasound image: arrow keys move the cross, enter adds a point or erases");
    } else {
      cross = null;
      svg.removeAttribute("tabindex");
      svg.setAttribute("role", "img");
      svg.setAttribute("aria-label", "Ultrasound image with tumour, stop margin and tool");
    }
    draw();
  }

  function press(event) {
    if (!mode || event.button !== 0) return;
    const place = pixelAt(event);
    if (!place) return;
    const number = Number(event.target.dataset?.point);
    event.preventDefault();
    image().focus({ preventScroll: true });
    if (mode === "add" && number) {
      dragged = { n: number, x: place[0] + 0.5, y: place[1] + 0.5, begin: place, moved: false };
      dragged.isBeside = apart(place, values().points.find((each) => each.n === number)) > DOT;
      image().setPointerCapture(event.pointerId);
    } else {
      use(place);
    }
  }

  function drag(event) {
    const place = dragged && pixelAt(event);
    if (!place) return;
    const [x, y] = [place[0] + 0.5, place[1] + 0.5];
    if (!dragged.moved && apart(dragged.begin, { x, y }) < SLIP) return;
    Object.assign(dragged, { x, y, moved: true });
    draw();
  }

  // Pixels of the screen between a place of `pixelAt` and a point of the contour.
  function apart([x, y], point) {
    return Math.hypot(x + 0.5 - point.x, y + 0.5 - point.y) * (image().getScreenCTM()?.a || 1);
  }

  function release() {
    if (!dragged) return;
    const { n, x, y, begin, moved, isBeside } = dragged;
    // It stays at its new place until the server has answered.
    if (moved) return change("contour_move", n, x - 0.5, y - 0.5).then(forget);
    forget();
    if (isBeside) use(begin); // a click beside a point, not a drag of it
  }

  function forget() {
    dragged = null;
    draw();
  }

  const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

  function key(event) {
    if (!mode || event.ctrlKey || event.metaKey || event.altKey) return;
    const { width, height } = image().viewBox.baseVal;
    cross ??= [Math.round(width / 2), Math.round(height / 2)];
    const step = STEPS[event.key];
    if (step) {
      const by = event.shiftKey ? 10 : 1;
      cross = [
        Math.min(Math.max(cross[0] + by * step[0], 0), width - 1),
        Math.min(Math.max(cross[1] + by * step[1], 0), height - 1),
      ];
    } else if (event.key === "Enter" || event.key === " ") {
      use(cross);
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation(); // these keys do not play the recording now
    draw();
  }

  function element(name, attributes) {
    const made = document.createElementNS(SVG, name);
    for (const [key_, value] of Object.entries(attributes)) made.setAttribute(key_, value);
    return made;
  }

  function draw() {
    const svg = image();
    const contour = values();
    if (!svg || !contour) return;
    let group = svg.querySelector("#us-contour");
    if (!group) {
      group = element("g", { id: "us-contour" });
      svg.append(group);
      document.querySelector(".us-legend").insertAdjacentHTML("beforeend", '<li class="us-contour">contour</li>');
      if (operates) {
        svg.addEventListener("pointerdown", press);
        svg.addEventListener("pointermove", drag);
        svg.addEventListener("pointerup", release);
        svg.addEventListener("pointercancel", forget);
        svg.addEventListener("keydown", key);
      }
    }
    const shown = shownImage();
    const unit = 1 / (svg.getScreenCTM()?.a || 1); // one pixel of the screen
    const parts = [];
    if (contour.image === shown && contour.cut) parts.push(element("path", { class: "us-cut", d: contour.cut }));
    for (const point of contour.points) {
      if (point.image !== shown) continue;
      const { x, y } = dragged?.n === point.n ? dragged : point;
      parts.push(element("circle", { class: "us-hit", cx: x, cy: y, r: GRIP * unit, "data-point": point.n }));
      parts.push(element("circle", { class: "us-point", cx: x, cy: y, r: DOT * unit }));
    }
    if (cross) {
      const [x, y] = [cross[0] + 0.5, cross[1] + 0.5];
      const arm = 12 * unit;
      parts.push(element("path", { class: "us-cross", d: `M${x - arm} ${y}H${x + arm}M${x} ${y - arm}V${y + arm}` }));
    }
    group.replaceChildren(...parts);
  }

  function show(id, value) {
    const input = find(id);
    if (document.activeElement !== input) input.value = value ?? "";
  }

  function update() {
    const contour = values();
    if (!contour) return;
    const tools = document.querySelector(".contour-tools");
    if (tools && !tools.firstElementChild) connect(tools);
    if (tools) {
      // With another tool the answer says what is missing.
      find("contour-tip").disabled = !contour.tip && chosenTool("touch") === guardedTool();
      find("contour-undo").disabled = !contour.undo;
      for (const id of ["contour-stl", "contour-ply"]) find(id).disabled = !contour.computed || (!contour.points.length && !contour.text);
      show("contour-dilation", contour.dilation);
      show("contour-hydromark", contour.hydromark);
      show("contour-calibration", contour.calibration);
    }
    draw();
  }

  function connect(tools) {
    tools.innerHTML = TOOLS;
    tools.querySelector(".contour-image").hidden = !ultrasound;
    find("contour-use").hidden = !live;
    const confirmed = (id, name) => {
      find(`${id}-confirm`).addEventListener("click", () => {
        find(id).open = false;
        change(name);
      });
    };
    confirmed("contour-clear", "contour_delete_all");
    confirmed("contour-use", "contour_accept");
    find("contour-add").addEventListener("click", () => setMode("add"));
    find("contour-erase").addEventListener("click", () => setMode("erase"));
    find("contour-tip").addEventListener("click", () => send("contour_tip", AUTHOR, chosenTool("touch")));
    find("contour-undo").addEventListener("click", () => change("contour_undo"));
    find("contour-stl").addEventListener("click", () => save("stl"));
    find("contour-ply").addEventListener("click", () => save("ply"));
    for (const name of ["dilation", "hydromark", "calibration"]) {
      const input = find(`contour-${name}`);
      input.addEventListener("change", () => {
        if (input.value !== "" && input.reportValidity()) change(`contour_${name}`, Number(input.value));
      });
    }
  }

  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes("contour")) queueMicrotask(update);
  });
  // The section and the image may come later than their values.
  new MutationObserver((changes) => {
    const own = changes.every(({ target }) => target.closest?.("#us-contour, .contour-tools"));
    if (!own) update();
  }).observe(document.body, { childList: true, subtree: true, attributes: true, attributeFilter: ["data-image"] });
}
