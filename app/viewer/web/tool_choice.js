// The choice of the tracked tool that is calibrated, or that points are touched with: a list in a label
// of the class tool-choice, which is hidden with one tool. Lists of one `name` have the same choice on this page.

export function toolChoice(name) {
  return `<select data-tool="${name}"></select>`;
}

// The tool that the margin is computed for.
export function guardedTool() {
  return window.trame.state.get("tools")[0];
}

export function chosenTool(name) {
  return document.querySelector(`select[data-tool="${name}"]`)?.value || guardedTool();
}

export function chooseTools(trame) {
  const chosen = {};

  function update() {
    const tools = trame.state.get("tools");
    for (const select of document.querySelectorAll("select[data-tool]")) {
      const label = select.closest("label");
      if (label.hidden === tools.length > 1) label.hidden = !label.hidden;
      if (select.options.length === tools.length) continue;
      select.replaceChildren(...tools.map((tool) => new Option(tool)));
      select.value = chosen[select.dataset.tool] ?? tools[0] ?? "";
    }
  }

  document.addEventListener("change", ({ target }) => {
    const name = target.dataset?.tool;
    if (!name) return;
    chosen[name] = target.value;
    for (const select of document.querySelectorAll(`select[data-tool="${name}"]`)) select.value = target.value;
  });
  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes("tools")) queueMicrotask(update);
  });
  // The sections may come later than the value.
  new MutationObserver(update).observe(document.body, { childList: true, subtree: true });
}
