// What an operator types: event notes, and in a live session the margins, the structures that are guarded, the recording
// and the lengths of items. The fields keep what is being typed while the values of the page change.

const NOTE = `
  <input id="note-text" type="text" maxlength="200" aria-label="Note on this moment" placeholder="note on this moment">
  <button id="note-add" type="button">Add note</button>
  <p id="note-answer" role="status"></p>`;
const MARGINS = `
  <details id="margins"><summary>Margins...</summary>
    <label>Stop, mm <input id="margins-stop" type="number" min="0" max="100" step="0.1"></label>
    <label>Warning, mm <input id="margins-warn" type="number" min="0" max="200" step="0.1"></label>
    <p>Change the margins? Smaller ones hold the robot, and apply when an operator re-arms.</p>
    <button id="margins-confirm" type="button">Change the margins</button>
    <p class="answer" id="margins-answer" role="status"></p></details>`;
const SWITCH = `
  <details id="switch"><summary>Switch...</summary>
    <label>Structure <select id="switch-name"></select></label>
    <label>Reason <input id="switch-reason" type="text" maxlength="200"></label>
    <p id="switch-question"></p>
    <button id="switch-confirm" type="button"></button>
    <p class="answer" id="switch-answer" role="status"></p></details>`;
const RECORD = `
  <details id="record"><summary>Start or stop...</summary>
    <label id="record-name-label">Name <input id="record-name" type="text" maxlength="64" pattern="[A-Za-z0-9][A-Za-z0-9_.\\-]*"
      placeholder="case and time"></label>
    <p id="record-question"></p>
    <button id="record-confirm" type="button"></button>
    <p class="answer" id="record-answer" role="status"></p></details>`;

const lengths = ({ name, title }) => [-5, -1, 1, 5]
  .map((mm) => `<button type="button" data-mm="${mm}" aria-label="${title} ${Math.abs(mm)} mm ${mm < 0 ? "shorter" : "longer"}">${mm > 0 ? "+" : "\u2212"}${Math.abs(mm)}</button>`)
  .join(" ") + `<p class="answer" id="${name}-answer" role="status"></p>`;

export function listenToOperator(trame) {
  const find = (id) => document.getElementById(id);
  let seen = null; // the margins that were shown when the question was opened

  async function send(answer, name, args) {
    try {
      await trame.trigger(name, args);
      find(answer).textContent = "";
      return true;
    } catch (error) {
      find(answer).textContent = error?.data?.exception ?? error?.message ?? String(error);
      return false;
    }
  }

  async function note() {
    const input = find("note-text");
    if (await send("note-answer", "note", [input.value])) input.value = "";
  }

  function connect() {
    const notes = document.querySelector(".note-tools");
    if (notes && !notes.firstElementChild) {
      notes.innerHTML = NOTE;
      find("note-add").addEventListener("click", note);
      find("note-text").addEventListener("keydown", (event) => {
        if (event.key === "Enter") note();
      });
    }
    for (const tools of document.querySelectorAll(".length-tools:empty")) {
      const item = trame.state.get("display_items").find(({ name }) => name === tools.parentElement.dataset.item);
      if (!item) continue;
      tools.innerHTML = lengths(item);
      for (const button of tools.querySelectorAll("button")) {
        button.addEventListener("click", () => send(`${item.name}-answer`, item.command, [Number(button.dataset.mm)]));
      }
    }
    const margins = document.querySelector(".margin-tools");
    if (margins && !margins.firstElementChild) {
      margins.innerHTML = MARGINS;
      find("margins").addEventListener("toggle", () => {
        seen = trame.state.get("now").margins;
        find("margins-answer").textContent = "";
        if (!seen) return;
        [find("margins-stop").value, find("margins-warn").value] = seen;
      });
      find("margins-confirm").addEventListener("click", async () => {
        const fields = [find("margins-stop"), find("margins-warn")];
        if (!seen || !fields.every((field) => field.value !== "" && field.reportValidity())) return;
        const values = fields.map((field) => Number(field.value));
        if (await send("margins-answer", "margins", [...seen, ...values])) find("margins").open = false;
      });
    }
    const switches = document.querySelector(".switch-tools");
    if (switches && !switches.firstElementChild) {
      switches.innerHTML = SWITCH;
      const name = find("switch-name"), reason = find("switch-reason");
      const isOff = () => name.selectedOptions[0]?.dataset.off === "true";
      const ask = () => {
        reason.required = !isOff();
        find("switch-question").textContent = isOff()
          ? "Guard this structure again?"
          : "Guard this structure no more? The robot is held until an operator re-arms.";
        find("switch-confirm").textContent = isOff() ? "Switch on" : "Switch off";
      };
      find("switch").addEventListener("toggle", () => {
        const further = trame.state.get("now").structures.slice(1); // the first is the tumour
        name.replaceChildren(...further.map((each) => {
          const option = new Option(each.off ? `${each.title}, off` : each.title, each.name);
          option.dataset.off = Boolean(each.off);
          return option;
        }));
        find("switch-answer").textContent = "";
        ask();
      });
      name.addEventListener("change", ask);
      find("switch-confirm").addEventListener("click", async () => {
        if (!name.value || !reason.reportValidity()) return;
        if (await send("switch-answer", "switch", [name.value, isOff(), reason.value])) {
          reason.value = "";
          find("switch").open = false;
        }
      });
    }
    const record = document.querySelector(".record-tools");
    if (record && !record.firstElementChild) {
      record.innerHTML = RECORD;
      let starts = true; // what the question was about when it was opened
      find("record").addEventListener("toggle", () => {
        starts = !trame.state.get("recording")?.active;
        find("record-answer").textContent = "";
        find("record-name-label").hidden = !starts;
        find("record-question").textContent = starts
          ? "Record every source of this session as a new case?"
          : "End this recording? Its case is then complete.";
        find("record-confirm").textContent = starts ? "Start recording" : "Stop recording";
      });
      find("record-confirm").addEventListener("click", async () => {
        const name = find("record-name");
        if (starts && !name.reportValidity()) return;
        if (await send("record-answer", "record", [starts, starts ? name.value : ""])) {
          name.value = "";
          find("record").open = false;
        }
      });
    }
  }
  new MutationObserver(connect).observe(document.body, { childList: true, subtree: true });
  connect();
}
