// The page's own watch over the server. A picture that stands still after the server has died looks
// like a tool that is held still: when no heartbeat comes, the page itself turns grey and says so.

const PATIENCE_MS = 1000;
// A question and its answer pass through all that is queued both ways: what comes here is no older
// than the last question that was answered. Drawing may hold an answer up for a while.
const ANSWER_MS = 2000;
const AREA = "stage";

export function watchServer(trame, onChange) {
  // Not randomUUID: a page that came by plain http from another machine does not have it.
  const page = crypto.getRandomValues(new Uint32Array(4)).join("-");
  const session = trame.client.getConnection().getSession();
  const began = performance.now();
  let heard = began; // the last heartbeat
  let answered = began; // when the last question that has an answer was asked
  let complete = began; // the last time that no picture was missing
  let last = 0; // the number of the last picture here
  let connected = true;

  const cover = document.createElement("div");
  cover.id = "lost";
  cover.setAttribute("role", "alert");
  cover.innerHTML = "<strong></strong><span></span><button type='button'>Reload</button>";
  cover.querySelector("button").addEventListener("click", () => window.location.reload());
  document.body.append(cover);

  function say(words, more) {
    if ((document.body.dataset.lost ?? "") === words) return;
    if (words) {
      cover.querySelector("strong").textContent = words;
      cover.querySelector("span").textContent = more;
      document.body.dataset.lost = words;
    } else {
      delete document.body.dataset.lost;
    }
    onChange();
  }

  function judge() {
    const now = performance.now();
    if (!connected) say("CONNECTION LOST", "Nothing here is live any more.");
    else if (last === 0) say("CONNECTING", "Waiting for the first picture.");
    else if (now - heard > PATIENCE_MS) say("CONNECTION LOST", "The server does not answer.");
    else if (now - answered > ANSWER_MS) say("PICTURE LATE", "What arrives here is old.");
    else if (now - complete > PATIENCE_MS) say("PICTURE LATE", "Pictures do not arrive in time.");
    else say("", "");
  }

  function tell() {
    if (!connected) return;
    const asked = performance.now();
    const note = () => {
      answered = Math.max(answered, asked);
    };
    // Without an answer `judge` speaks.
    session.call("marginguard.seen", [page, last]).then(note, () => {});
  }

  session.subscribe("marginguard.beat", ([beat]) => {
    heard = performance.now();
    if (last >= beat.number) complete = heard;
    tell();
    judge();
  });
  session.subscribe("trame.rca.topic.stream", ([picture]) => {
    if (picture.name !== AREA) return;
    last = picture.meta.number;
    document.body.dataset.picture = last;
    complete = performance.now();
    tell();
    judge();
  });
  const lose = () => {
    connected = false;
    judge();
  };
  trame.client.onConnectionClose(lose);
  trame.client.onConnectionError(lose);
  setInterval(judge, 100);
  document.addEventListener("visibilitychange", judge);
  judge();
  document.body.dataset.watched = ""; // until here the style sheet covers the page
}
