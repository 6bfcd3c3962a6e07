// The keyboard: space plays, arrows step, Home and End seek, n and p go
// to the next and the previous breach, digits choose the camera, ? shows help,
// m mutes, d switches the distance tone, s saves the picture, + and - zoom the
// timeline.

export function listenToKeys(trame) {
  const operates = trame.state.get("role") === "operate";
  const replay = !trame.state.get("title").live;

  // The next breach after the frame that is shown, or the last one before it.
  function goToBreach(forward) {
    const { frame } = trame.state.get("now");
    const frames = trame.state.get("breaches").rows.map((breach) => breach.frame);
    const found = forward ? frames.find((each) => each > frame) : frames.findLast((each) => each < frame);
    return found === undefined ? undefined : trame.trigger("frame", [found]);
  }

  document.addEventListener("click", (event) => {
    const id = event.target.closest?.("#breach-next, #breach-previous")?.id;
    if (id) goToBreach(id === "breach-next");
  });

  function help() {
    const dialog = document.getElementById("help");
    if (dialog.open) dialog.close();
    else dialog.showModal();
  }
  document.addEventListener("click", (event) => {
    if (event.target.closest?.("#help-button")) help();
  });

  function handle(event) {
    if (event.key === "?") return help();
    if (event.key.toLowerCase() === "m") return window.marginguard.mute();
    if (event.key.toLowerCase() === "d") return window.marginguard.toggleDistance();
    if (event.key.toLowerCase() === "s") return document.getElementById("screenshot").click();
    if (event.key === "+" || event.key === "-") return window.marginguard.zoom(event.key === "+");
    if (!operates) return undefined;
    const looks = trame.state.get("looks");
    if (event.key >= "1" && event.key <= String(looks.length)) {
      return trame.trigger("look", [looks[Number(event.key) - 1]]);
    }
    if (!replay) return undefined;
    if (event.key === " ") return trame.trigger("play");
    if (event.key === "ArrowLeft") return trame.trigger("step", [event.shiftKey ? -25 : -1]);
    if (event.key === "ArrowRight") return trame.trigger("step", [event.shiftKey ? 25 : 1]);
    const key = event.key.toLowerCase();
    if (key === "n" || key === "p") return goToBreach(key === "n");
    if (event.key === "Home") return trame.trigger("seek", [0]);
    if (event.key === "End") return trame.trigger("seek", [1]);
    return undefined;
  }

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const at = event.target;
    // Sliders, lists and buttons handle these keys themselves.
    if (at.matches?.("input[type=range], input[type=radio], input[type=text], input[type=number], select")) return;
    if (event.key === " " && at.matches?.("button, a, input, summary")) return;
    // The values are behind the help: keys do not change them unseen.
    if (document.getElementById("help")?.open && event.key !== "?") return;
    if (event.key === " " || event.key.startsWith("Arrow")) event.preventDefault();
    // A key that is held down repeats steps only.
    if (!event.repeat || event.key.startsWith("Arrow")) handle(event);
  });
}
