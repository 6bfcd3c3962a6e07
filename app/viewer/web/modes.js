// The mode of this page, and the step of the workflow that it shows: radio buttons, whose choice the style sheet reads.
// At first a replay is reviewed, a live session prepared, at its first step that is not done; a reload keeps the mode.

const KEPT = "marginguard mode";

export function chooseModes(trame) {
  const find = (name, value) => document.querySelector(`input[name="${name}"][value="${value}"]`);
  const isChosen = (name) => document.querySelector(`input[name="${name}"]:checked`);

  function begin() {
    const first = trame.state.get("title").live ? "prepare" : "review";
    const mode = find("mode", sessionStorage.getItem(KEPT) ?? first);
    if (mode && !isChosen("mode")) mode.checked = true;
    const rows = trame.state.get("workflow")?.rows ?? [];
    const step = find("step", rows.find((each) => each.state === "not done")?.name ?? rows[0]?.name);
    if (step && !isChosen("step")) step.checked = true;
  }
  document.addEventListener("change", ({ target }) => {
    if (target.name === "mode") sessionStorage.setItem(KEPT, target.value);
  });
  new MutationObserver(begin).observe(document.body, { childList: true, subtree: true });
  begin();
}
