// Repairs two elements of trame for users who zoom or who hear the page: the picture's image has no
// text of its own, and the page's viewport forbids to enlarge it.

export function makeAccessible() {
  document.querySelector("meta[name=viewport]")?.setAttribute("content", "width=device-width, initial-scale=1");
  const describe = () => {
    for (const image of document.querySelectorAll("img.image-display-area:not([alt])")) {
      image.alt = "The scene: tool, tumour and robot";
    }
  };
  new MutationObserver(describe).observe(document.body, { childList: true, subtree: true });
  describe();
}
