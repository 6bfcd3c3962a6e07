"""The states' colours and hatches for the page: a style sheet, and patterns for its plot."""

from app.fixture import MarginState
from app.session import SHOWN_STATES

_HATCH_PATHS = {
    ".": "M3 3h2v2h-2z",
    "x": "M0 0L8 8M0 8L8 0",
    "/": "M0 8L8 0",
}
"""The SVG path, in a tile 8 wide and 8 high, of each character of matplotlib's hatches in use."""


def state_css() -> str:
    """The style sheet ``states.css``: two variables per state, and the box with its label."""
    variables = [
        f"--{key.lower()}: {shown.ground_hex}; --on-{key.lower()}: {shown.text_hex};"
        for key, shown in SHOWN_STATES.items()
    ]
    boxes = [
        f'.state[data-state="{key}"] '
        f"{{ background: var(--{key.lower()}); color: var(--on-{key.lower()}); }}"
        for key in SHOWN_STATES
    ]
    return "\n".join([":root {", *variables, "}", *boxes, ""])


def band_patterns() -> list[dict[str, str]]:
    """The name of each state with a hatch, and the SVG path of a tile 8 wide and 8 high."""
    return [
        {"state": state.name, "path": _HATCH_PATHS[state.display.hatch[0]]}
        for state in MarginState
        if state.display.hatch
    ]
