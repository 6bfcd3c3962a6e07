// Plots of a report: zoom by dragging, the wheel or keys, values at the cursor. Without it, and on
// paper, each figure shows its static picture.
"use strict";

(() => {
  const INK = getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
  const HEIGHT = 380;
  const STRIP = 16; // height of the band of states, in CSS pixels
  const SMALLEST_S = 0.05;
  const LABEL = 14; // height of the name of a line, in CSS pixels
  const NAME_PX = 11;
  const GAP = 12; // between the plot and the names of its lines, in CSS pixels

  const figures = document.querySelectorAll("figure.plot");
  for (const figure of figures) show(figure);

  function show(figure) {
    const plot = JSON.parse(figure.querySelector("script").textContent);
    const times = running(plot.times_ms).map((ms) => ms / 1000);
    const columns = plot.series.map((each) =>
      each.values.map((value) => (value === null ? null : value / plot.scale)),
    );
    const first = times[0];
    const last = times[times.length - 1];
    const chart = figure.querySelector(".chart");
    const state = {
      label: "state",
      stroke: "transparent",
      points: { show: false },
      value: (u, value, series, index) => (index === null ? "" : bandAt(plot.bands, times[index])),
    };
    const options = {
      width: chart.clientWidth || figure.clientWidth - 20,
      height: HEIGHT,
      padding: [STRIP + 6, GAP + namesWidth(plot.lines), 0, 0],
      cursor: { sync: { key: "report" }, drag: { x: true, y: false } },
      scales: { x: { time: false }, y: { range: (u, low, high) => limits(plot, low, high) } },
      axes: [
        { label: plot.x_label, stroke: INK, grid: { show: false } },
        { label: plot.y_label, stroke: INK, size: 60, grid: { stroke: `${INK}1a` } },
      ],
      series: [
        { label: "time", value: (u, value) => (value === null ? "" : `${value.toFixed(3)} s`) },
        ...plot.series.map((each) => ({
          label: each.label,
          stroke: each.color,
          width: each.width,
          dash: each.dash || undefined,
          points: { show: false },
          value: (u, value) => (value === null ? "-" : value.toFixed(plot.digits) + plot.unit),
        })),
        ...(plot.bands.length ? [state] : []),
      ],
      hooks: {
        drawClear: [(u) => drawBands(u, plot.bands)],
        draw: [(u) => drawLines(u, plot.lines)],
      },
    };
    figure.classList.add("live");
    options.width = chart.clientWidth;
    const data = [times, ...columns];
    if (plot.bands.length) data.push(times.map(() => null));
    const u = new uPlot(options, data, chart);
    u.over.addEventListener("wheel", (event) => wheel(u, event, first, last), { passive: false });
    tools(figure.querySelector(".tools"), u, plot.marks, first, last);
    new ResizeObserver(() => {
      if (chart.clientWidth) u.setSize({ width: chart.clientWidth, height: HEIGHT });
    }).observe(chart);
  }

  function running(steps) {
    let sum = 0;
    return steps.map((step) => (sum += step));
  }

  function limits(plot, low, high) {
    if (plot.y_limits) return plot.y_limits;
    if (low === null) return [0, plot.y_top];
    const top = Math.min(high, plot.y_top);
    const bottom = Math.min(low, plot.lines.length ? 0 : low);
    const room = 0.06 * Math.max(top - bottom, 0.1);
    return [bottom - room, Math.max(top, bottom + 0.1) + room];
  }

  function bandAt(bands, time) {
    const found = bands.find((band) => band.from <= time && time < band.to);
    return found ? found.label : bands[bands.length - 1].label;
  }

  function drawBands(u, bands) {
    const { ctx } = u;
    const ratio = devicePixelRatio;
    const { left, top, width, height } = u.bbox;
    ctx.save();
    ctx.font = `bold ${11 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    for (const band of bands) {
      const start = Math.max(u.valToPos(band.from, "x", true), left);
      const end = Math.min(u.valToPos(band.to, "x", true), left + width);
      if (end <= start) continue;
      ctx.fillStyle = band.color;
      ctx.globalAlpha = 0.16;
      ctx.fillRect(start, top, end - start, height);
      ctx.globalAlpha = 1;
      ctx.fillRect(start, top - (STRIP + 2) * ratio, end - start, STRIP * ratio);
      if (ctx.measureText(band.label).width + 6 * ratio < end - start) {
        ctx.fillStyle = band.text_color;
        ctx.fillText(band.label, (start + end) / 2, top - (STRIP / 2 + 2) * ratio);
      }
    }
    ctx.restore();
  }

  function nameFont(ratio) {
    return `${NAME_PX * ratio}px system-ui, sans-serif`;
  }

  function namesWidth(lines) {
    const ctx = document.createElement("canvas").getContext("2d");
    ctx.font = nameFont(1);
    return Math.max(0, ...lines.map((line) => Math.ceil(ctx.measureText(line.label).width)));
  }

  function drawLines(u, lines) {
    const { ctx } = u;
    const ratio = devicePixelRatio;
    const { left, top, width, height } = u.bbox;
    const right = left + width;
    ctx.save();
    ctx.font = nameFont(ratio);
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    const shown = lines
      .map((line) => ({ line, y: u.valToPos(line.value, "y", true) }))
      .filter(({ y }) => y >= top && y <= top + height)
      .sort((a, b) => a.y - b.y);
    ctx.lineWidth = 1.2 * ratio;
    for (const { line, y } of shown) {
      ctx.strokeStyle = line.color;
      ctx.setLineDash(line.value === 0 ? [] : [6 * ratio, 4 * ratio]);
      ctx.beginPath();
      ctx.moveTo(left, y);
      ctx.lineTo(right, y);
      ctx.stroke();
    }
    ctx.setLineDash([]);
    const wished = shown.map(({ y }) => y + 0.5 * LABEL * ratio);
    const places = spread(wished, LABEL * ratio, top + LABEL * ratio);
    shown.forEach(({ line, y }, index) => {
      ctx.fillStyle = ctx.strokeStyle = line.color;
      ctx.fillText(line.label, right + (GAP - 2) * ratio, places[index]);
      ctx.lineWidth = ratio;
      ctx.beginPath();
      ctx.moveTo(right, y);
      ctx.lineTo(right + (GAP - 4) * ratio, places[index] - 0.5 * LABEL * ratio);
      ctx.stroke();
    });
    ctx.restore();
  }

  // As `spread` of app/report/time_plot.py; `wished` increases.
  function spread(wished, step, top) {
    const places = [...wished];
    for (let k = places.length - 2; k >= 0; k--) {
      places[k] = Math.min(places[k], places[k + 1] - step);
    }
    let limit = top;
    return places.map((place) => {
      const found = Math.max(place, limit);
      limit = found + step;
      return found;
    });
  }

  function zoom(u, from, to, first, last) {
    const span = Math.min(Math.max(to - from, SMALLEST_S), last - first);
    const start = Math.min(Math.max(from, first), last - span);
    u.setScale("x", { min: start, max: start + span });
  }

  function wheel(u, event, first, last) {
    event.preventDefault();
    const { min, max } = u.scales.x;
    const factor = event.deltaY < 0 ? 0.8 : 1.25;
    const at = u.posToVal(event.offsetX, "x");
    zoom(u, at - (at - min) * factor, at + (max - at) * factor, first, last);
  }

  function tools(place, u, marks, first, last) {
    const button = (text, action) => {
      const made = document.createElement("button");
      made.type = "button";
      made.textContent = text;
      made.addEventListener("click", action);
      place.append(made);
    };
    const around = (factor) => {
      const { min, max } = u.scales.x;
      const middle = (min + max) / 2;
      const half = ((max - min) / 2) * factor;
      zoom(u, middle - half, middle + half, first, last);
    };
    button("whole time", () => zoom(u, first, last, first, last));
    button("+", () => around(0.5));
    button("\u2212", () => around(2));
    for (const mark of marks) {
      button(mark.label, () => zoom(u, mark.from - 1, mark.to + 1, first, last));
    }
    place.append("Drag or turn the wheel to zoom, double-click for the whole time.");
  }
})();
