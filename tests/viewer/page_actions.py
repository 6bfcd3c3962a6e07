"""Actions on a page that covers itself while its server is late, as on a busy machine.

The cover lies over all parts of the page: it would get a click of the mouse or be in a picture, and
what is below it is not the present. All of these wait until the page is not covered.
"""

import re
from pathlib import Path
from typing import Any

from playwright.sync_api import Locator, Page, Position, expect

ANSWER = """([name, args]) => trame.trigger(name, args)
  .then(() => "done", (error) => error.message)"""
UNCOVERED = "body:not([data-lost]) #state-label"


def wait_until_uncovered(page: Page) -> None:
    """Wait for a page with current values."""
    page.wait_for_selector(UNCOVERED)


def read(page: Page, expression: str) -> Any:
    """Value of a JavaScript expression at a moment at which the page is not covered."""
    value = page.wait_for_function(f"() => !document.body.dataset.lost && [{expression}]")
    return value.json_value()[0]


def wait_for(page: Page, condition: str, arg: object = None) -> None:
    """Wait until a JavaScript expression of ``arg`` is true on a page that is not covered."""
    page.wait_for_function(f"arg => !document.body.dataset.lost && ({condition})", arg=arg)


def screenshot(part: Locator) -> bytes:
    """Picture of ``part`` without the page's cover."""
    while True:
        wait_until_uncovered(part.page)
        content = part.screenshot()
        if part.page.evaluate("!document.body.dataset.lost"):
            return content


# Playwright sends the events of a locator again if another element, as the cover, would get them.
def click_at(part: Locator, x: float, y: float) -> None:
    """Click in ``part`` at a place of the window."""
    part.click(position=_within(part, x, y))


def hover_at(part: Locator, x: float, y: float) -> None:
    """Move the pointer to a place of the window in ``part``."""
    part.hover(position=_within(part, x, y))


def drag(part: Locator, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag in ``part`` from one place of the window to another."""
    ends = _within(part, *begin), _within(part, *end)
    part.drag_to(part, source_position=ends[0], target_position=ends[1], steps=4)


def _within(part: Locator, x: float, y: float) -> Position:
    box = part.bounding_box()
    assert box is not None
    return Position(x=x - box["x"], y=y - box["y"])


def press(page: Page, *keys: str) -> None:
    """Press keys that no control of the page takes."""
    page.evaluate("document.activeElement.blur()")
    for key in keys:
        page.keyboard.press(key)


def show_frame(page: Page, frame: int) -> None:
    """Pause a replay at ``frame``, whatever frame other tests of its server have left."""
    page.evaluate("frame => trame.trigger('frame', [frame])", frame)
    expect(page.locator("#frame")).to_have_text(str(frame))
    wait_for(page, "trame.state.get('now').frame === arg && !trame.state.get('now').playing", frame)


def answer(page: Page, name: str, *args: object) -> str:
    """Problem of a command that the page sends, or ``done``."""
    return page.evaluate(ANSWER, [name, list(args)])


def resize(page: Page, width: int, height: int) -> None:
    """Change the size of the window."""
    page.set_viewport_size({"width": width, "height": height})


def choose(page: Page, mode: str, step: str = "") -> None:
    """Show a mode of the page, and while preparing a step of the workflow."""
    page.check(f'input[name="mode"][value="{mode}"]')
    if step:
        page.check(f"#step-{step}")


def confirm(page: Page, part: str) -> None:
    """Open the question of ``part`` and confirm it."""
    page.click(f"#{part} summary")
    page.click(f"#{part}-confirm")


def download(page: Page, button: str, name: str = "") -> Path:
    """The file that a click on ``button`` saves, by default with any name.

    Its name ends as that of the page's file, by which readers know its format.
    """
    with page.expect_download() as waiting:
        page.click(button)
    suggested = waiting.value.suggested_filename
    assert name in ("", suggested)
    path = Path(waiting.value.path())
    return path.rename(path.with_name(f"{path.name}_{suggested}"))


def accepted(kind, text=""):
    """Pattern of the text on an accepted request of the page, whose node has a random name."""
    return re.compile(rf"{kind} from the page \(/marginguard_page_\w+\) accepted{text}")
