// Buttons of the calibration of the tool. Each command names the revision that this page shows: a change of
// what another page has changed meanwhile is refused, and its reason is shown here alone.

const TOOLS = `
  <div>
    <button id="calibration-pivot" type="button" title="Record poses while the tip rests in a divot">Start pivot</button>
    <button id="calibration-spin" type="button" title="Record poses while the tool rotates about its shaft">Start spin</button>
    <button id="calibration-stop" type="button">Stop</button>
    <button id="calibration-discard" type="button">Discard</button>
  </div>
  <details id="calibration-use"><summary>Use this calibration...</summary>
    <p>Replace the tip of the tool in this session? The robot is held until an operator re-arms.</p>
    <button id="calibration-use-confirm" type="button">Use the calibration</button></details>
  <details id="calibration-undo"><summary>Undo the calibration...</summary>
    <p>Use the tip from before the last calibration? The robot is held until an operator re-arms.</p>
    <button id="calibration-undo-confirm" type="button">Use the tip from before</button></details>
  <div><a class="button" id="calibration-save" href="tip.yaml" download="tip.yaml" title="The tip in use, for tool.tip_from of a live.yaml">Save the tip</a></div>
  <p id="calibration-answer" role="status"></p>`;

export function calibrateTool(trame) {
  const values = () => trame.state.get("calibration");
  const find = (id) => document.getElementById(id);

  async function send(name, ...args) {
    let answer = "";
    try {
      await trame.trigger(name, [values().revision, ...args]);
    } catch (error) {
      answer = error?.data?.exception ?? error?.message ?? String(error);
    }
    if (find("calibration-answer")) find("calibration-answer").textContent = answer;
  }

  function connect(tools) {
    tools.innerHTML = TOOLS;
    for (const kind of ["pivot", "spin"]) {
      find(`calibration-${kind}`).addEventListener("click", () => send("calibration_start", kind));
    }
    for (const name of ["stop", "discard"]) {
      find(`calibration-${name}`).addEventListener("click", () => send(`calibration_${name}`));
    }
    for (const name of ["use", "undo"]) {
      find(`calibration-${name}-confirm`).addEventListener("click", () => {
        find(`calibration-${name}`).open = false;
        send(`calibration_${name}`);
      });
    }
  }

  function update() {
    const tools = document.querySelector(".calibration-tools");
    const calibration = values();
    if (!tools || !calibration) return;
    if (!tools.firstElementChild) connect(tools);
    const { phase } = calibration;
    for (const kind of ["pivot", "spin"]) find(`calibration-${kind}`).hidden = phase === "recording";
    find("calibration-stop").hidden = phase !== "recording";
    find("calibration-discard").hidden = phase === "idle";
    const shown = { use: calibration.ready, undo: calibration.undo && phase === "idle" };
    for (const [name, is] of Object.entries(shown)) {
      const part = find(`calibration-${name}`);
      if (part.hidden === is) part.hidden = !is;
      if (!is) part.open = false;
    }
  }

  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes("calibration")) queueMicrotask(update);
  });
  // The section may come later than its values.
  new MutationObserver(update).observe(document.body, { childList: true, subtree: true });
}
