// The alarm: two tones while the tool is in the tumour, and once for a breach between two pictures.

const PERIOD_MS = 600;
const TONE_S = 0.18;

export function soundAlarm(trame) {
  const context = new AudioContext();
  let muted = false;
  let inside = false;
  let breaches = 0;
  let timer = null;

  function show() {
    const word = muted ? "muted" : context.state === "running" ? "on" : "blocked";
    document.body.dataset.sound = word;
    document.getElementById("sound")?.setAttribute("aria-pressed", String(muted));
  }

  function tone(hertz, after) {
    const begin = context.currentTime + after;
    const source = new OscillatorNode(context, { frequency: hertz, type: "square" });
    const volume = new GainNode(context, { gain: 0 });
    volume.gain.setValueAtTime(0, begin);
    volume.gain.linearRampToValueAtTime(0.2, begin + 0.01);
    volume.gain.linearRampToValueAtTime(0, begin + TONE_S);
    source.connect(volume).connect(context.destination);
    source.start(begin);
    source.stop(begin + TONE_S);
  }

  function ring() {
    document.body.dataset.alarm = String(Number(document.body.dataset.alarm ?? 0) + 1);
    if (muted || context.state !== "running") return;
    document.body.dataset.tones = String(Number(document.body.dataset.tones ?? 0) + 1);
    tone(880, 0);
    tone(660, TONE_S);
  }

  function listen() {
    const now = trame.state.get("now");
    const was = inside;
    inside = now.state === "POSITIVE";
    const missed = now.breaches > breaches;
    breaches = now.breaches;
    if (inside && !was) {
      ring();
      clearInterval(timer);
      timer = setInterval(ring, PERIOD_MS);
    } else if (!inside && was) {
      clearInterval(timer);
    } else if (missed && !inside) {
      ring();
    }
  }

  async function allow() {
    if (context.state !== "running") await context.resume().catch(() => {});
    show();
  }

  window.marginguard = {
    mute() {
      muted = !muted;
      show();
    },
  };
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("#sound");
    const wasBlocked = document.body.dataset.sound === "blocked";
    allow();
    if (button && !wasBlocked) window.marginguard.mute();
  });
  document.addEventListener("keydown", allow);
  context.addEventListener("statechange", show);
  breaches = trame.state.get("now").breaches;
  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes("now")) listen();
  });
  show();
  listen();
}
