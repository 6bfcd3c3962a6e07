// Buttons of the calibration of a tool.

import { guide } from "./guided.js";
import { chosenTool, guardedTool, toolChoice } from "./tool_choice.js";

const TOOLS = `
  <label class="tool-choice" hidden><span>Calibrate</span> ${toolChoice("calibrated")}</label>
  <div>
    <button id="calibration-pivot" type="button" title="Record poses while the tip rests in a divot">Start pivot</button>
    <button id="calibration-spin" type="button" title="Record poses while the tool rotates about its shaft">Start spin</button>
    <button id="calibration-stop" type="button">Stop</button>
    <button id="calibration-discard" type="button">Discard</button>
  </div>
  <details id="calibration-use"><summary>Use this calibration...</summary>
    <p>Replace the tip of this tool in the session? After that of the ${guardedTool()} the robot is held until an operator re-arms.</p>
    <button id="calibration-use-confirm" type="button">Use the calibration</button></details>
  <details id="calibration-undo"><summary>Undo the calibration...</summary>
    <p>Use the tip from before the last calibration? After that of the ${guardedTool()} the robot is held until an operator re-arms.</p>
    <button id="calibration-undo-confirm" type="button">Use the tip from before</button></details>
  <div><a class="button" id="calibration-save" href="tip.yaml" download="tip.yaml" title="The tip in use, for tip_from of a live.yaml">Save the tip</a></div>
  <p id="calibration-answer" role="status"></p>`;

export function calibrateTool(trame) {
  const kinds = ["pivot", "spin"];
  guide(
    trame,
    "calibration",
    TOOLS,
    (find, send) => {
      for (const kind of kinds) find(kind).addEventListener("click", () => send("start", kind, chosenTool("calibrated")));
      find("save").addEventListener("click", async (event) => {
        const tool = chosenTool("calibrated");
        if (tool === guardedTool()) return;
        event.preventDefault();
        const answer = await fetch(`${tool}.yaml`);
        if (!answer.ok) return void (find("answer").textContent = await answer.text());
        const link = Object.assign(document.createElement("a"), { download: `${tool}.yaml` });
        link.href = URL.createObjectURL(await answer.blob());
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
      });
    },
    ({ phase }) => Object.fromEntries(kinds.map((kind) => [kind, phase !== "recording"])),
  );
}
