// The timeline: zoom about the shown moment, and the values under the pointer. Zoomed, the track is wider than
// the plot, which scrolls; while the shown moment is in view it is kept there.

const MAX_ZOOM = 64;

export function showTimeline(trame) {
  let zoom = 1;
  const timeline = () => document.getElementById("timeline");
  const cursor = () => (trame.state.get("now").cursor ?? 1000) / 1000;

  function center() {
    const plot = timeline();
    if (!plot || zoom === 1) return;
    plot.scrollLeft = cursor() * plot.scrollWidth - plot.clientWidth / 2;
  }

  function setZoom(next) {
    zoom = Math.min(Math.max(next, 1), MAX_ZOOM);
    timeline()?.style.setProperty("--zoom", zoom);
    timeline()?.setAttribute("data-zoom", zoom);
    if (zoom > 1) timeline()?.setAttribute("tabindex", 0); // what scrolls can be focused
    center();
  }
  window.marginguard.zoom = (closer) => setZoom(closer ? zoom * 2 : zoom / 2);
  document.addEventListener("click", (event) => {
    const id = event.target.closest?.("#zoom-in, #zoom-out")?.id;
    if (id) window.marginguard.zoom(id === "zoom-in");
  });

  // Distance at a share of the width, by the drawn curve; null where it is not known.
  function distance(plot, share) {
    const x = 1000 * share;
    let before = null;
    for (const [, kind, px, py] of plot.curve.matchAll(/([ML])([\d.-]+) ([\d.-]+)/g)) {
      const point = { x: Number(px), y: Number(py) };
      if (point.x >= x) {
        if (kind === "M" || !before) return point.x - x < 0.5 ? toMm(plot, point.y) : null;
        const part = point.x > before.x ? (x - before.x) / (point.x - before.x) : 1;
        return toMm(plot, before.y + part * (point.y - before.y));
      }
      before = point;
    }
    return null;
  }
  const toMm = (plot, y) => plot.top_mm - (y / 100) * plot.mm;

  function hover(event) {
    const plot = trame.state.get("plot");
    const label = document.getElementById("hover");
    const track = event.target.closest?.(".track");
    if (!label) return;
    if (!track || !plot) {
      label.textContent = "";
      return;
    }
    const { left, width } = track.getBoundingClientRect();
    const share = Math.min(Math.max((event.clientX - left) / width, 0), 1);
    const live = trame.state.get("title").live;
    const seconds = live ? (share - 1) * plot.seconds : share * plot.seconds;
    const mm = distance(plot, share);
    const band = plot.bands.findLast((each) => each.x <= 1000 * share);
    const value = band?.state === "UNKNOWN" || mm === null ? "" : `: ${mm.toFixed(1)} mm`;
    label.textContent = `${seconds.toFixed(2)} s${value}, ${band?.label ?? "unknown"}`;
    const chart = track.closest(".chart").getBoundingClientRect();
    const half = label.offsetWidth / 2;
    label.style.left = `${Math.min(Math.max(event.clientX - chart.left, half), chart.width - half)}px`;
  }
  document.addEventListener("pointermove", hover);
  document.addEventListener("pointerleave", hover);

  trame.state.addListener(({ type, keys }) => {
    if (type !== "dirty-state" || !keys.includes("now") || zoom === 1) return;
    const plot = timeline();
    const at = cursor() * plot.scrollWidth - plot.scrollLeft;
    if (at < 0 || at > plot.clientWidth) center();
  });
}
