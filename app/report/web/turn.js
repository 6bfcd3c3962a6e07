// What figures share that the reader turns: the axes of the picture, and turning by pointer and keys.
"use strict";

const Turning = (() => {
  const DEGREES_PER_PIXEL = 0.5;
  const DEGREES_PER_KEY = 10;
  const ZOOM_STEP = 1.25;
  const MAX_ZOOM = 8;

  // The axes of the picture in right, anterior and superior, or in x, y and z.
  function axes(view) {
    const [a, e] = [view.azimuth, view.elevation].map((degrees) => (degrees * Math.PI) / 180);
    return {
      right: [-Math.cos(a), Math.sin(a), 0],
      up: [-Math.sin(a) * Math.sin(e), -Math.cos(a) * Math.sin(e), Math.cos(e)],
      towards: [Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), Math.sin(e)],
    };
  }

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  function point(canvas, turn, zoom, hover) {
    const held = new Map();
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const spread = () => {
      const [a, b] = [...held.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, place(event));
      hover(place(event));
    });
    canvas.addEventListener("pointermove", (event) => {
      const [before, now] = [held.get(event.pointerId), place(event)];
      if (before && held.size === 1) {
        turn(...[0, 1].map((k) => (now[k] - before[k]) * DEGREES_PER_PIXEL));
      }
      const apart = held.size === 2 ? spread() : 0;
      if (before) held.set(event.pointerId, now);
      if (before && apart > 0) zoom(spread() / apart);
      hover(now);
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(kind, (event) => held.delete(event.pointerId));
    }
    canvas.addEventListener(
      "wheel",
      (event) => {
        // At the end of the zoom the wheel scrolls the page.
        if (zoom(event.deltaY < 0 ? ZOOM_STEP : 1 / ZOOM_STEP)) event.preventDefault();
      },
      { passive: false },
    );
  }

  function press(canvas, turn, zoom, reset, useCross) {
    const actions = {
      ArrowRight: () => turn(DEGREES_PER_KEY, 0),
      ArrowLeft: () => turn(-DEGREES_PER_KEY, 0),
      ArrowDown: () => turn(0, DEGREES_PER_KEY),
      ArrowUp: () => turn(0, -DEGREES_PER_KEY),
      "+": () => zoom(ZOOM_STEP),
      "=": () => zoom(ZOOM_STEP),
      "-": () => zoom(1 / ZOOM_STEP),
      0: reset,
    };
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in actions)) return;
      event.preventDefault();
      useCross();
      actions[event.key]();
    });
  }

  // Lets the reader turn and zoom `view`, which `update` draws, also in another size. Returns the zoom.
  function follow(canvas, view, update, { reset, hover, useCross }) {
    const turn = (right, down) => {
      view.azimuth = (view.azimuth + right) % 360;
      view.elevation = Math.min(Math.max(view.elevation + down, -90), 90);
      update();
    };
    const zoom = (factor) => {
      const before = view.zoom;
      view.zoom = Math.min(Math.max(before * factor, 1), MAX_ZOOM);
      update();
      return view.zoom !== before;
    };
    point(canvas, turn, zoom, hover);
    press(canvas, turn, zoom, reset, useCross);
    new ResizeObserver(() => {
      if (!canvas.clientWidth) return;
      canvas.width = Math.round(canvas.clientWidth * devicePixelRatio);
      canvas.height = Math.round(canvas.clientHeight * devicePixelRatio);
      update();
    }).observe(canvas);
    return zoom;
  }

  function zoomButtons(place, reset, zoom) {
    button(place, "reset", "reset", reset);
    button(place, "+", "zoom in", () => zoom(ZOOM_STEP));
    button(place, "\u2212", "zoom out", () => zoom(1 / ZOOM_STEP));
  }

  const bytes = (text) => Uint8Array.from(atob(text), (each) => each.charCodeAt(0)).buffer;
  const levels = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));

  function button(place, text, name, action) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    if (name !== text) made.setAttribute("aria-label", name);
    made.addEventListener("click", action);
    place.append(made);
    return made;
  }

  return { axes, button, bytes, dot, follow, levels, zoomButtons };
})();
