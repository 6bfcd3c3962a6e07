// Watchdog of the page. After the server has stopped, the last picture looks like a tool that is held
// still: without a heartbeat the page covers itself in grey with a message.

const HEARTBEAT_TIMEOUT_MS = 1000;
// A request and its reply pass through both queues: what arrives is no older than the last request
// that was answered. Drawing may delay a reply.
const REPLY_TIMEOUT_MS = 2000;
const AREA = "scene";

// `drawn`, on a page that draws the scene itself, resolves when the newest values are drawn, and
// rejects if they are not: the picture is then late.
export function watchServer(trame, onChange, drawn) {
  const session = trame.client.getConnection().getSession();
  const began = performance.now();
  let heard = began; // the last heartbeat
  let answered = began; // when the last answered request was sent
  let complete = began; // the last time at which no picture was missing
  let last = 0; // the number of the last picture received
  let connected = true;

  const cover = document.createElement("div");
  cover.id = "lost";
  cover.setAttribute("role", "alert");
  cover.innerHTML = "<strong></strong><span></span><button type='button'>Reload</button>";
  cover.querySelector("button").addEventListener("click", () => window.location.reload());
  document.body.append(cover);

  function showCover(title, detail) {
    if ((document.body.dataset.lost ?? "") === title) return;
    if (title) {
      cover.querySelector("strong").textContent = title;
      cover.querySelector("span").textContent = detail;
      document.body.dataset.lost = title;
    } else {
      delete document.body.dataset.lost;
    }
    onChange();
  }

  function check() {
    const now = performance.now();
    if (!connected) showCover("CONNECTION LOST", "This page is no longer live.");
    else if (last === 0) showCover("CONNECTING", "Waiting for the first picture.");
    else if (now - heard > HEARTBEAT_TIMEOUT_MS) showCover("CONNECTION LOST", "The server does not answer.");
    else if (now - answered > REPLY_TIMEOUT_MS) showCover("PICTURE LATE", "The data that arrive are old.");
    else if (now - complete > HEARTBEAT_TIMEOUT_MS) showCover("PICTURE LATE", "Pictures do not arrive in time.");
    else showCover("", "");
  }

  function acknowledge() {
    if (!connected) return;
    const sentAt = performance.now();
    const onReply = () => {
      answered = Math.max(answered, sentAt);
    };
    // `check` reports a missing reply.
    session.call("marginguard.seen", [last]).then(onReply, () => {});
  }

  // A page that may not operate sends nothing to the picture's area, and has an image in its place.
  function showPicture(picture) {
    const image = document.getElementById("picture");
    if (!image) return;
    const shown = image.src;
    image.src = URL.createObjectURL(new Blob([picture.content], { type: picture.meta.type }));
    if (shown) URL.revokeObjectURL(shown);
  }

  session.subscribe("marginguard.beat", ([beat]) => {
    heard = performance.now();
    if (last >= beat.number) complete = heard;
    acknowledge();
    check();
  });
  session.subscribe("trame.rca.topic.stream", ([picture]) => {
    if (picture.name !== AREA) return;
    const received = () => {
      last = picture.meta.number;
      document.body.dataset.picture = last;
      complete = performance.now();
      acknowledge();
      check();
    };
    if (drawn) return void drawn().then(received, () => {});
    showPicture(picture);
    return received();
  });
  const onLost = () => {
    connected = false;
    check();
  };
  trame.client.onConnectionClose(onLost);
  trame.client.onConnectionError(onLost);
  setInterval(check, 100);
  document.addEventListener("visibilitychange", check);
  check();
  document.body.dataset.watched = ""; // until then the style sheet covers the page
}
