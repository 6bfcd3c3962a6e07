// A robot along its way as surfaces that turn, with a slider for the time. Orthographic. Without it,
// and on paper, the figure shows three pictures.
"use strict";

(() => {
  const { axes, button, bytes, dot, follow, levels, zoomButtons } = Turning;
  const SCENE = 0.95; // share of half the picture that the scene reaches at zoom 1

  for (const figure of document.querySelectorAll("figure.motion")) show(figure);

  function show(figure) {
    const canvas = figure.querySelector("canvas");
    const context = canvas.getContext("2d");
    if (!context) return;
    const scene = read(JSON.parse(figure.querySelector("script").textContent));
    const [slider, reading] = ["input", ".reading"].map((each) => figure.querySelector(each));
    const view = { ...scene.start, zoom: 1 };
    let waiting = false;
    let began = null; // time at which the motion that plays would have begun, in ms

    const update = () => {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame((now) => {
        waiting = false;
        if (began !== null) play(now);
        draw(context, scene, view, Number(slider.value), canvas.clientWidth, canvas.clientHeight);
        reading.textContent = slider.ariaValueText = describe(scene, Number(slider.value));
      });
    };
    const play = (now) => {
      const after = scene.times_s.findIndex((time) => time > (now - began) / 1000);
      slider.value = after < 0 ? scene.times_s.length - 1 : Math.max(after - 1, 0);
      if (after < 0) pause();
      else requestAnimationFrame(update);
    };
    const pause = () => {
      began = null;
      toggle.textContent = "play";
    };
    const reset = () => {
      Object.assign(view, scene.start, { zoom: 1 });
      update();
    };
    figure.classList.add("live");
    const tools = figure.querySelector(".tools");
    const toggle = button(tools, "play", "play", () => {
      if (began !== null) return pause();
      const at = Number(slider.value);
      const from = at === scene.times_s.length - 1 ? 0 : scene.times_s[at];
      began = performance.now() - 1000 * from;
      toggle.textContent = "pause";
      update();
    });
    const zoom = follow(canvas, view, update, { reset, hover: () => {}, useCross: () => {} });
    zoomButtons(tools, reset, zoom);
    slider.addEventListener("input", () => {
      pause();
      update();
    });
  }

  function read(data) {
    const bodies = data.bodies.map((body) => ({
      vertices: Float64Array.from(new Int16Array(bytes(body.vertices)), (v) => v * body.vertex_mm),
      faces: new Uint16Array(bytes(body.faces)),
      color: levels(body.color),
    }));
    return { ...data, bodies };
  }

  function draw(context, scene, view, number, width, height) {
    const directions = axes(view);
    const scale = (SCENE * 0.5 * Math.min(width, height) * view.zoom) / scene.reach;
    const faces = [];
    scene.bodies.forEach((body, index) => {
      const moves = index < scene.poses[0].length;
      const pose = moves ? scene.poses[number][index] : [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
      addFaces(faces, scene, body, pose, directions, 1);
      if (moves && number < scene.poses.length - 1) {
        addFaces(faces, scene, body, scene.poses[scene.poses.length - 1][index], directions, scene.ghost);
      }
    });
    faces.sort((a, b) => a.depth - b.depth);
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.fillStyle = scene.paper;
    context.fillRect(0, 0, width, height);
    context.lineWidth = 0.7;
    context.lineJoin = "round";
    for (const { corners, color, opacity } of faces) {
      context.globalAlpha = opacity;
      context.fillStyle = context.strokeStyle = color;
      context.beginPath();
      for (const [x, y] of corners) context.lineTo(0.5 * width + scale * x, 0.5 * height - scale * y);
      context.closePath();
      context.fill();
      if (opacity === 1) context.stroke(); // closes the seams between neighbours
    }
    context.globalAlpha = 1;
  }

  // Adds the faces of a body at the 3 x 4 matrix `pose`: right, up and depth of their corners in mm.
  function addFaces(faces, scene, body, pose, { right, up, towards }, opacity) {
    const points = [];
    for (let v = 0; v < body.vertices.length; v += 3) {
      const place = [0, 4, 8].map(
        (row, k) => dot(pose.slice(row, row + 3), body.vertices.subarray(v, v + 3)) + pose[row + 3] - scene.center[k],
      );
      points.push([right, up, towards].map((direction) => dot(place, direction)));
    }
    for (let f = 0; f < body.faces.length; f += 3) {
      const corners = [0, 1, 2].map((k) => points[body.faces[f + k]]);
      const [a, b, c] = corners;
      const [p, q] = [b, c].map((each) => each.map((value, k) => value - a[k]));
      const normal = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
      const facing = Math.abs(normal[2]) / Math.max(Math.hypot(...normal), 1e-12);
      const shade = body.color.map((level) => Math.round(level * (scene.ambient + scene.direct * facing)));
      faces.push({ corners, color: `rgb(${shade.join(" ")})`, opacity, depth: a[2] + b[2] + c[2] });
    }
  }

  function describe(scene, number) {
    const time = `${scene.times_s[number].toFixed(2)} s`;
    const distances = scene.distances_mm[number].map((each) => each ?? Infinity);
    const nearest = distances.indexOf(Math.min(...distances));
    if (!Number.isFinite(distances[nearest])) return time;
    return `${time}: ${scene.structures[nearest]} is nearest, ${distances[nearest].toFixed(2)} mm`;
  }
})();
