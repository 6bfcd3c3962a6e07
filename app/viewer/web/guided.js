// What the buttons of every guided recording have in common. Each command names the revision that this page
// shows: a change of what another page has changed meanwhile is refused, and its reason is shown here alone.

// `name` is that of the page's value, of the commands and of the elements. `connect(find, send)` sets up the other
// buttons in `markup`; `shown(values)` says by name which elements are shown.
export function guide(trame, name, markup, connect, shown) {
  const values = () => trame.state.get(name);
  const find = (part) => document.getElementById(`${name}-${part}`);

  async function send(command, ...args) {
    let answer = "";
    try {
      await trame.trigger(`${name}_${command}`, [values().revision, ...args]);
    } catch (error) {
      answer = error?.data?.exception ?? error?.message ?? String(error);
    }
    if (find("answer")) find("answer").textContent = answer;
  }

  function begin(tools) {
    tools.innerHTML = markup;
    connect(find, send);
    for (const command of ["stop", "discard"]) find(command).addEventListener("click", () => send(command));
    for (const command of ["use", "undo"]) {
      find(`${command}-confirm`).addEventListener("click", () => {
        find(command).open = false;
        send(command);
      });
    }
  }

  function update() {
    const tools = document.querySelector(`.${name}-tools`);
    const now = values();
    if (!tools || !now) return;
    if (!tools.firstElementChild) begin(tools);
    const all = {
      stop: now.phase === "recording",
      discard: now.phase !== "idle",
      use: now.can_use,
      undo: now.can_undo && now.phase === "idle",
      ...shown(now),
    };
    for (const [part, is] of Object.entries(all)) {
      const element = find(part);
      if (element.hidden === is) element.hidden = !is;
      if (!is && element.open) element.open = false;
    }
  }

  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes(name)) queueMicrotask(update);
  });
  // The section may come later than its values.
  new MutationObserver(update).observe(document.body, { childList: true, subtree: true });
  return send;
}
