// Buttons of the registration of the robot.

import { guide } from "./guided.js";
import { chosenTool, toolChoice } from "./tool_choice.js";

const TOOLS = `
  <label class="tool-choice" hidden><span>Touch with</span> ${toolChoice("touch")}</label>
  <div>
    <button id="registration-start" type="button" title="Detect the points at which the tip rests; another tool touches the tip of the robot">Register by touch</button>
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
  const send = guide(
    trame,
    "registration",
    TOOLS,
    (find, send) => {
      find("start").addEventListener("click", () => send("start", chosenTool("touch")));
      find("restore").addEventListener("click", () => send("restore"));
    },
    ({ phase, can_restore }) => ({ start: phase !== "recording", restore: can_restore }),
  );
  // The rows are drawn anew with each fit.
  document.addEventListener("click", (event) => {
    const point = event.target.closest?.("[data-remove-point]");
    if (point) send("remove", point.dataset.removePoint);
  });
}
