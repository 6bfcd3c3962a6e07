// The alarm: two high tones, repeated while the tool is in the tumour, and once for a breach that lies
// between two pictures. A low tone, repeated more slowly, after a known state has become UNKNOWN.
// The distance tone, off until it is switched on, sounds nearer than the warning distance: the nearer
// the stop margin is, the faster it repeats.

const TONE_S = 0.18;
const ALARMS = {
  inside: { hertz: [880, 660], periodMs: 600 },
  unknown: { hertz: [330], periodMs: 3000 },
};

const DISTANCE = { hertz: 520, slowMs: 1200, fastMs: 150 };

// Time in ms between two distance tones; null where there is none.
export function distancePeriod(now) {
  if (now.state !== "WARNING" || !now.stop) return null;
  const number = (text) => Number(text.replace("\u2212", "-"));
  const [stop, warn] = [number(now.stop), number(now.warn)];
  const share = (number(now.distance) - stop) / Math.max(warn - stop, 0.1);
  return DISTANCE.fastMs + Math.min(Math.max(share, 0), 1) * (DISTANCE.slowMs - DISTANCE.fastMs);
}

export function soundAlarm(trame) {
  const context = new AudioContext();
  let muted = false;
  let known = false;
  let alarm = "";
  let breaches = 0;
  let timer = null;
  let distanceOn = false;
  let distanceTimer = null;

  // Counters for tests, which cannot record a tone.
  function count(name) {
    document.body.dataset[name] = String(Number(document.body.dataset[name] ?? 0) + 1);
  }

  function show() {
    const setting = muted ? "muted" : context.state === "running" ? "on" : "blocked";
    document.body.dataset.sound = setting;
    document.getElementById("sound")?.setAttribute("aria-pressed", String(muted));
    document.getElementById("distance-tone")?.setAttribute("aria-pressed", String(distanceOn));
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

  function ring(name) {
    count(`${name}Rung`);
    if (muted || context.state !== "running") return;
    count("tones");
    ALARMS[name].hertz.forEach((hertz, n) => tone(hertz, n * TONE_S));
  }

  // Sounds as long as the last values that arrived are near, and never while the page is covered.
  function beepDistance() {
    distanceTimer = null;
    const period = document.body.dataset.lost ? null : distancePeriod(trame.state.get("now"));
    if (!distanceOn || period === null) return;
    count("distanceRung");
    if (!muted && context.state === "running") {
      count("tones");
      tone(DISTANCE.hertz, 0);
    }
    distanceTimer = setTimeout(beepDistance, period);
  }

  // The alarm for this state. Before the first known state there is none.
  function alarmFor(now) {
    const isKnown = now.state !== "UNKNOWN" && !document.body.dataset.lost;
    known ||= isKnown;
    if (!isKnown) return known ? "unknown" : "";
    return now.state === "POSITIVE" ? "inside" : "";
  }

  function update() {
    const now = trame.state.get("now");
    const missed = now.breaches > breaches;
    breaches = now.breaches;
    if (distanceOn && distanceTimer === null) beepDistance();
    const next = alarmFor(now);
    if (next !== alarm) {
      clearInterval(timer);
      alarm = next;
      if (alarm) {
        ring(alarm);
        timer = setInterval(ring, ALARMS[alarm].periodMs, alarm);
      }
    }
    if (missed && alarm !== "inside") ring("inside");
  }

  async function resume() {
    if (context.state !== "running") await context.resume().catch(() => {});
    show();
  }

  window.marginguard = {
    mute() {
      muted = !muted;
      show();
    },
    toggleDistance() {
      distanceOn = !distanceOn;
      show();
      update();
    },
  };
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("#sound");
    const wasBlocked = document.body.dataset.sound === "blocked";
    resume();
    if (button && !wasBlocked) window.marginguard.mute();
    if (event.target.closest?.("#distance-tone")) window.marginguard.toggleDistance();
  });
  document.addEventListener("keydown", resume);
  context.addEventListener("statechange", show);
  breaches = trame.state.get("now").breaches;
  trame.state.addListener(({ type, keys }) => {
    if (type === "dirty-state" && keys.includes("now")) update();
  });
  show();
  update();
  return update;
}
