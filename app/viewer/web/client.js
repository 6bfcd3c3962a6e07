// Draws the scene in the browser (`--render client`): vtk.js shows the values of the page's state.

const AREA = "scene";
const FLUSHED_MS = 3; // trame-vtk draws 1 ms after the last change of a part

export function drawHere(trame) {
  let draws = 0; // pictures that were begun: each one clears the graphics context
  let graphics = null;
  let view = null; // trame-vtk's component

  const { prototype } = window.WebGL2RenderingContext ?? { prototype: {} };
  const { clear } = prototype;
  prototype.clear = function clearCounted(mask) {
    graphics = this;
    draws += 1;
    return clear.call(this, mask);
  };
  trame.utils.marginguard = {
    setView: (component) => {
      view = component;
    },
  };

  const operates = () => trame.state.get("role") === "operate";
  const call = (method, ...args) => {
    if (operates()) trame.client.getConnection().getSession().call(method, [AREA, "page", ...args]).catch(() => {});
  };

  // The server frames the scene for the size of the picture.
  function sendSize(box) {
    const { width, height } = box.getBoundingClientRect();
    if (width && height) call("trame.rca.size", { w: width, h: height, p: window.devicePixelRatio || 1 });
  }

  // Moving the camera here ends its presets, as moving it on the server does.
  function releaseCamera(box, event) {
    const { width: w, height: h, left, bottom } = box.getBoundingClientRect();
    const at = { w, h, x: event.clientX - left, y: bottom - event.clientY };
    call("trame.rca.event", { type: "LeftButtonPress", ...at });
    call("trame.rca.event", { type: "LeftButtonRelease", ...at });
  }

  let box = null;
  function connectBox() {
    const found = document.getElementById("client-view");
    if (!found || found === box) return;
    box = found;
    new ResizeObserver(() => sendSize(box)).observe(box);
    box.addEventListener("pointerdown", (event) => releaseCamera(box, event), { capture: true });
    box.addEventListener("wheel", (event) => releaseCamera(box, event), { capture: true, passive: true });
  }

  return async function drawn() {
    await new Promise((resolve) => setTimeout(resolve, 0)); // Vue has changed the parts
    connectBox();
    const before = draws;
    const camera = trame.state.get("camera");
    // A preset's camera is the server's; setting it also draws.
    if (view && camera) view.setCamera(trame.state.get("look") ? camera : view.getCamera());
    for (let tries = 0; tries < 50 && draws === before; tries += 1) {
      await new Promise((resolve) => setTimeout(resolve, FLUSHED_MS));
    }
    if (!graphics || graphics.isContextLost() || draws === before) throw new Error("not drawn");
  };
}
