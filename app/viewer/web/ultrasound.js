// The ultrasound image, or the cut of a volume, with what is drawn on it. Image and lines are of one moment: they change together,
// when the image has arrived. An image that is not current is covered with the reason, unless the operator
// has frozen it: then it is labelled FROZEN.

const LATE_MS = 500; // an image that was named this long ago and has not arrived makes the shown one old
const NAMES = ["margin", "tumor", "tool", "closest"];

const TEMPLATE = `
  <div class="us-bar">
    <h2><span id="us-kind">Ultrasound</span> <span id="us-time"></span></h2>
    <label id="us-kinds">Image <select></select></label>
    <button id="us-freeze" type="button" aria-pressed="false" title="Keep this image">Freeze</button>
    <details id="us-depth" hidden><summary>Depth <span id="us-depth-used"></span></summary>
      <div><label>Depth <select id="us-depth-choice"></select></label>
      <p>Use another depth? Images that are stamped from now on are placed by its calibration. The ultrasound machine has to be at this depth.</p>
      <button id="us-depth-confirm" type="button">Use this depth</button>
      <p class="answer" id="us-depth-answer" role="status"></p></div></details>
    <label>Brightness <input id="us-brightness" type="range" min="0.4" max="2.5" step="0.05" value="1"></label>
  </div>
  <div class="us-stage">
    <svg id="us-image" role="img" aria-label="Image with tumour, stop margin and tool">
      <image preserveAspectRatio="none"/>
      <g class="us-items"></g>
      ${NAMES.map((name) => `<path class="us-${name}"/>`).join("")}
      <g class="us-edges"></g>
      <g class="us-tip"><path d="M-9 0H-3M3 0H9M0 -9V-3M0 3V9"/></g>
    </svg>
    <p id="us-problem" role="status"></p>
    <p id="us-frozen" hidden>FROZEN: not current</p>
  </div>
  <ul class="us-legend">
    <li class="us-tumor">tumour</li><li class="us-margin">stop margin</li><li class="us-tool">tool in the plane</li>
    <li class="us-closest">closest points</li>
  </ul>
  <p class="numbers" id="us-tip"></p>`;

const capital = (text) => text[0].toUpperCase() + text.slice(1);
const heading = (kind) => (kind === "ultrasound" ? "Ultrasound" : `Cut: ${kind}`);

function edge(letter, [x, y], width, height) {
  const text = document.createElementNS("http://www.w3.org/2000/svg", "text");
  text.textContent = letter;
  text.setAttribute("x", (x * width) / 100);
  text.setAttribute("y", (y * height) / 100);
  text.setAttribute("font-size", Math.max(width, height) / 20);
  return text;
}

export function showUltrasound(trame) {
  let part = null;
  let shown = 0; // the request that is on the page
  let asked = 0; // the last request
  let picture = null; // number of the image that is on the page
  let frozen = false;

  const find = (selector) => part.querySelector(selector);

  function cover(problem) {
    part.dataset.problem = problem ? "true" : "false";
    find("#us-problem").textContent = problem ? `NO CURRENT IMAGE: ${problem}` : "";
  }

  function drawItems(paths) {
    const items = trame.state.get("display_items").filter(({ length }) => length);
    const lines = items.map(({ name, color }) => {
      const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
      line.setAttribute("class", `us-${name}`);
      line.setAttribute("d", paths[name] ?? "");
      line.style.stroke = color;
      return line;
    });
    find("g.us-items").replaceChildren(...lines);
    const names = items.map(({ name, color }) => {
      const entry = Object.assign(document.createElement("li"), { id: `us-${name}-name`, textContent: `${name} in the plane` });
      entry.style.setProperty("--line", color);
      return entry;
    });
    for (const old of part.querySelectorAll(".us-legend [id]")) old.remove();
    find(".us-legend").append(...names);
  }

  function draw(values) {
    const { width, height } = values;
    const svg = find("#us-image");
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    for (const name of NAMES) find(`path.us-${name}`).setAttribute("d", values[name]);
    drawItems(values.items);
    const [x, y, mm] = values.tip ?? [];
    const tip = find("g.us-tip");
    tip.style.display = values.tip ? "" : "none";
    if (values.tip) tip.setAttribute("transform", `translate(${x} ${y}) scale(${Math.max(width, height) / 300})`);
    const side = Math.abs(mm) < 0.05 ? "in the plane" : `${Math.abs(mm).toFixed(1)} mm ${mm > 0 ? "in front of" : "behind"} the plane`;
    find("#us-tip").textContent = values.tip ? `Tip ${side}` : "Tool and tumour: not known";
    find("#us-time").textContent = values.time;
    const edges = [[3, 50], [97, 50], [50, 4], [50, 96]]; // left, right, above, below, in percent
    find("g.us-edges").replaceChildren(
      ...[...values.edges].map((letter, index) => edge(letter, edges[index], width, height)),
    );
  }

  async function update() {
    const values = trame.state.get("ultrasound");
    if (!part || !values || frozen) return;
    asked += 1;
    const request = asked;
    find("#us-kind").textContent = heading(values.kind);
    find("#us-kinds select").value = values.kind;
    if (values.problem) {
      shown = request;
      cover(values.problem);
      return;
    }
    if (values.number !== picture) {
      const sent = trame.state.get("ultrasound_image");
      if (sent?.number !== values.number) {
        cover("the image has not arrived");
        return;
      }
      const image = new Image();
      image.src = sent.src;
      setTimeout(() => {
        if (!frozen && shown < request) cover("the image is late");
      }, LATE_MS);
      try {
        await image.decode();
      } catch {
        return; // it is late, or a newer one has replaced it
      }
      if (frozen || request < shown) return;
      const { width, height } = values;
      const element = find("image");
      element.setAttribute("href", image.src);
      element.setAttribute("width", width);
      element.setAttribute("height", height);
      picture = values.number;
    }
    shown = request;
    draw(values);
    cover("");
    part.dataset.image = values.number;
  }

  function freeze() {
    frozen = !frozen;
    part.dataset.frozen = frozen;
    find("#us-freeze").setAttribute("aria-pressed", frozen);
    find("#us-frozen").hidden = !frozen;
    update();
  }

  function showDepth() {
    const depth = trame.state.get("image_depth");
    const offered = depth && trame.state.get("title").live && trame.state.get("role") !== "view";
    find("#us-depth").hidden = !offered;
    if (depth) find("#us-depth-used").textContent = `${depth.used} mm`;
  }

  function offerDepths() {
    let seen = null; // the depth that was in use when the question was opened
    const choice = find("#us-depth-choice");
    const answer = find("#us-depth-answer");
    find("#us-depth").addEventListener("toggle", () => {
      const { depths, used } = trame.state.get("image_depth");
      seen = used;
      answer.textContent = "";
      choice.replaceChildren(...depths.map((mm) => new Option(`${mm} mm`, mm, mm === used, mm === used)));
    });
    find("#us-depth-confirm").addEventListener("click", async () => {
      try {
        await trame.trigger("image_depth", [seen, Number(choice.value)]);
        find("#us-depth").open = false;
      } catch (error) {
        answer.textContent = error?.data?.exception ?? error?.message ?? String(error);
      }
    });
    showDepth();
  }

  function offerKinds() {
    const kinds = trame.state.get("title").images;
    const choice = find("#us-kinds select");
    choice.replaceChildren(...kinds.map((kind) => new Option(capital(kind), kind)));
    find("#us-kind").textContent = heading(kinds[0]);
    find("#us-kinds").hidden = kinds.length < 2 || trame.state.get("role") === "view";
    choice.addEventListener("change", () => {
      if (frozen) freeze();
      trame.trigger("image_kind", [choice.value]);
    });
  }

  function connect() {
    const found = document.querySelector("#ultrasound > div");
    if (!found || found === part) return;
    part = found;
    part.innerHTML = TEMPLATE;
    cover("waiting for the first image");
    offerKinds();
    offerDepths();
    find("#us-freeze").addEventListener("click", freeze);
    find("#us-brightness").addEventListener("input", (event) => {
      find("image").style.filter = `brightness(${event.target.value})`;
    });
    update();
  }

  trame.state.addListener(({ type, keys }) => {
    if (type !== "dirty-state") return;
    if (keys.includes("ultrasound")) update();
    if (part && keys.includes("image_depth")) showDepth();
  });
  new MutationObserver(connect).observe(document.body, { childList: true, subtree: true });
  connect();
}
