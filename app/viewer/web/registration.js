// Buttons of the registration of the robot. Each command names the revision that this page shows: a change of
// what another page has changed meanwhile is refused, and its reason is shown here alone.

const TOOLS = `
  <div>
    <button id="registration-start" type="button" title="Detect the points at which the tip of the tool rests">Register by touch</button>
    <button id="registration-stop" type="button">Stop</button>
    <button id="registration-restore" type="button">Restore the removed point</button>
    <button id="registration-discard" type="button">Discard</button>
  </div>
  <details id="registration-use"><summary>Use this registration...</summary>
    <p>Replace the registration of the robot? The robot is held until an operator re-arms.</p>
    <button id="registration-use-confirm" type="button">Use the registration</button></details>
  <details id="registration-undo"><summary>Undo the registration...</summary>
    <p>Use the registration from before? The robot is held until an operator re-arms.</p>
    <button id="registration-undo-confirm" type="button">Use the one from before</button></details>
  <p id="registration-answer" role="status"></p>`;

export function registerRobot(trame) {
  const values = () => trame.state.get("registration");
  const find = (id) => document.getElementById(id);

  async function send(name, ...args) {
    let answer = "";
    try {
      await trame.trigger(name, [values().revision, ...args]);
    } catch (error) {
      answer = error?.data?.exception ?? error?.message ?? String(error);
    }
    if (find("registration-answer")) find("registration-answer").textContent = answer;
  }

  // The rows are drawn anew with each fit.
  document.addEventListener("click", (event) => {
    const point = event.target.closest?.("[data-remove-point]");
    if (point) send("registration_remove", point.dataset.removePoint);
  });

  function connect(tools) {
    tools.innerHTML = TOOLS;
    for (const name of ["start", "stop", "restore", "discard"]) {
      find(`registration-${name}`).addEventListener("click", () => send(`registration_${name}`));
    }
    for (const name of ["use", "undo"]) {
      find(`registration-${name}-confirm`).addEventListener("click", () => {
        find(`registration-${name}`).open = false;
        send(`registration_${name}`);
      });
    }
  }

  function update() {
    const tools = document.querySelector(".registration-tools");
    const registration = values();
    if (!tools || !registration) return;
    if (!tools.firstElementChild) connect(tools);
    const { phase } = registration;
    const shown = {
      start: phase !== "recording",
      stop: phase === "recording",
      restore: registration.restore,
      discard: phase !== "idle",
      use: registration.ready,
      undo: registration.undo && phase === "idle",
    };
    for (const [name, is] of Object.entries(shown)) {
      const part = find(`registration-${name}`);
      if (part.hidden === is) part.hidden = !is;
      if (!is && part.open) part.open = false;
    }
  }

  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes("registration")) queueMicrotask(update);
  });
  // The section may come later than its values.
  new MutationObserver(update).observe(document.body, { childList: true, subtree: true });
}
