// The coverage of the tumour as a surface that turns: drag, touch, keys, wheel; the value at the
// pointer. Orthographic, about the surface's centroid. Without it, and on paper, the figure shows
// its six views.
"use strict";

(() => {
  const { axes, button, bytes, dot, follow, levels, zoomButtons } = Turning;
  const SURFACE = 0.78; // share of half the picture that the surface reaches at zoom 1
  const LABELS = 0.92; // where the letters of the sides are
  const MARK = 9; // radius of a breach's mark, in CSS pixels

  for (const figure of document.querySelectorAll("figure.coverage")) show(figure);

  function show(figure) {
    const canvas = figure.querySelector("canvas");
    const context = canvas.getContext("2d");
    if (!context) return;
    const surface = read(JSON.parse(figure.querySelector("script").textContent));
    const reading = figure.querySelector(".reading");
    const view = { ...surface.start, zoom: 1 };
    let pointer = null; // in CSS pixels of the canvas; null: the cross in its middle
    let drawn = null;
    let waiting = false;

    const update = () => {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => {
        waiting = false;
        drawn = project(surface, view, canvas.clientWidth, canvas.clientHeight);
        draw(context, surface, drawn, pointer === null && document.activeElement === canvas);
        const text = describe(surface, drawn, pointer || [drawn.middle[0], drawn.middle[1]]);
        if (reading.textContent !== text) reading.textContent = text;
      });
    };
    const look = (from) => {
      pointer = null;
      Object.assign(view, { azimuth: from.azimuth, elevation: from.elevation });
      update();
    };
    const reset = () => {
      view.zoom = 1;
      look(surface.start);
    };
    figure.classList.add("live");
    const hover = (at) => {
      pointer = at;
      update();
    };
    const zoom = follow(canvas, view, update, { reset, hover, useCross: () => (pointer = null) });
    canvas.addEventListener("focus", update);
    canvas.addEventListener("blur", update);
    buttons(figure.querySelector(".tools"), surface, look, zoom, reset);
  }

  function read(data) {
    const vertices = Float64Array.from(
      new Int16Array(bytes(data.vertices)),
      (value) => value * data.vertex_mm,
    );
    const faces = new Uint16Array(bytes(data.faces));
    const nearest = Array.from(new Uint16Array(bytes(data.nearest)), (value) =>
      value === data.farther ? Infinity : value * data.nearest_mm,
    );
    const classes = nearest.map((value) => {
      const found = data.within_mm.findIndex((within) => value <= within + 1e-9);
      return found < 0 ? data.within_mm.length : found;
    });
    const normals = new Float64Array(faces.length);
    let reach = 0;
    for (let v = 0; v < vertices.length; v += 3) {
      reach = Math.max(reach, Math.hypot(vertices[v], vertices[v + 1], vertices[v + 2]));
    }
    for (let f = 0; f < faces.length; f += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => vertices.subarray(3 * faces[f + k]));
      const p = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
      const q = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
      const n = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
      const length = Math.max(Math.hypot(...n), 1e-12);
      for (let k = 0; k < 3; k++) normals[f + k] = n[k] / length;
    }
    const colors = data.colors.map(levels);
    return { ...data, vertices, faces, nearest, classes, normals, reach, colors };
  }

  function project(surface, view, width, height) {
    const { right, up, towards } = axes(view);
    const half = 0.5 * Math.min(width, height);
    const scale = (SURFACE * half * view.zoom) / surface.reach;
    const middle = [0.5 * width, 0.5 * height];
    const place = (point) => [
      middle[0] + scale * dot(point, right),
      middle[1] - scale * dot(point, up),
      dot(point, towards),
    ];
    const points = [];
    for (let v = 0; v < surface.vertices.length; v += 3) {
      points.push(place(surface.vertices.subarray(v, v + 3)));
    }
    const facing = [];
    for (let face = 0; 3 * face < surface.faces.length; face++) {
      const light = dot(surface.normals.subarray(3 * face, 3 * face + 3), towards);
      if (light <= 0) continue;
      const corners = [0, 1, 2].map((k) => points[surface.faces[3 * face + k]]);
      facing.push({ face, light, corners, depth: corners[0][2] + corners[1][2] + corners[2][2] });
    }
    facing.sort((a, b) => a.depth - b.depth);
    const drawn = { facing, middle, half, width, height, right, up, towards };
    drawn.marks = surface.breaches
      .map((breach) => ({ breach, at: place(breach.place) }))
      .filter(({ at }) => {
        const front = nearestAt(drawn, at);
        return front === null || front.depth <= at[2] + 0.1 * surface.reach;
      });
    return drawn;
  }

  // The face at a place of the picture that is nearest to the reader, and its depth there.
  function nearestAt(drawn, [x, y]) {
    let found = null;
    for (const { face, corners } of drawn.facing) {
      const [a, b, c] = corners;
      const area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
      const u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area;
      const v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area;
      if (!(u >= 0 && v >= 0 && u + v <= 1)) continue;
      const depth = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]);
      if (found === null || depth > found.depth) found = { face, depth };
    }
    return found;
  }

  function draw(context, surface, drawn, cross) {
    const ratio = devicePixelRatio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = surface.paper;
    context.fillRect(0, 0, drawn.width, drawn.height);
    context.lineJoin = "round";
    const sides = surface.sides.map((side) => ({ side, front: dot(side.axis, drawn.towards) > 0 }));
    for (const { side, front } of sides) if (!front) letter(context, surface, drawn, side);
    context.lineWidth = 0.7;
    for (const { face, light, corners } of drawn.facing) {
      const level = surface.ambient + surface.direct * light;
      const color = surface.colors[surface.classes[face]].map((part) => Math.round(part * level));
      context.fillStyle = context.strokeStyle = `rgb(${color.join(" ")})`;
      context.beginPath();
      for (const [x, y] of corners) context.lineTo(x, y);
      context.closePath();
      context.fill();
      context.stroke(); // closes the seams between neighbours
    }
    for (const { side, front } of sides) if (front) letter(context, surface, drawn, side);
    for (const { breach, at } of drawn.marks) mark(context, surface, breach.number, at);
    if (cross) crossAt(context, surface, drawn.middle);
  }

  function letter(context, surface, drawn, side) {
    const radius = LABELS * drawn.half;
    const [x, y] = [dot(side.axis, drawn.right), dot(side.axis, drawn.up)];
    const length = Math.hypot(x, y);
    if (length < 0.35) return; // it would hide what is in the middle
    context.font = "bold 15px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 4;
    context.strokeStyle = surface.paper;
    context.fillStyle = surface.ink;
    const place = [drawn.middle[0] + radius * x, drawn.middle[1] - radius * y];
    context.strokeText(side.letter, ...place);
    context.fillText(side.letter, ...place);
  }

  function mark(context, surface, number, [x, y]) {
    context.beginPath();
    context.arc(x, y, MARK, 0, 2 * Math.PI);
    context.lineWidth = 2;
    context.fillStyle = surface.paper;
    context.strokeStyle = surface.ink;
    context.fill();
    context.stroke();
    context.font = "bold 11px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = surface.ink;
    context.fillText(number, x, y + 0.5);
  }

  function crossAt(context, surface, [x, y]) {
    for (const [width, color] of [[4, surface.paper], [1.5, surface.ink]]) {
      context.lineWidth = width;
      context.strokeStyle = color;
      context.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        context.moveTo(x + 5 * dx, y + 5 * dy);
        context.lineTo(x + 12 * dx, y + 12 * dy);
      }
      context.stroke();
    }
  }

  function describe(surface, drawn, at) {
    const shown = surface.sides
      .map((side) => [dot(side.axis, drawn.towards), side.word])
      .filter(([share]) => share > 0.38)
      .sort((a, b) => b[0] - a[0])
      .map(([, word]) => word);
    const from = `From ${shown.join(" ")}`;
    const found = nearestAt(drawn, at);
    if (found === null) return `${from}: not on the tumour`;
    const value = surface.nearest[found.face];
    const far = surface.within_mm[surface.within_mm.length - 1];
    const text = value === Infinity ? `farther than ${far} mm` : `${value.toFixed(2)} mm`;
    const marks = drawn.marks.filter((each) => Math.hypot(each.at[0] - at[0], each.at[1] - at[1]) <= MARK);
    return `${from}: ${[text, ...marks.map((each) => each.breach.label)].join(", ")}`;
  }

  function buttons(place, surface, look, zoom, reset) {
    zoomButtons(place, reset, zoom);
    for (const side of surface.sides) button(place, side.letter, `from ${side.word}`, () => look(side));
    for (const breach of surface.breaches) button(place, breach.label, breach.label, () => look(breach));
  }
})();
