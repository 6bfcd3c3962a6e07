"""The states' colours and hatches for the page: a style sheet, and patterns for its plot."""

from app.fixture import MarginState

_HATCH_PATHS = {
    ".": "M3 3h2v2h-2z",
    "x": "M0 0L8 8M0 8L8 0",
    "/": "M0 8L8 0",
}
"""The SVG path, in a tile 8 wide and 8 high, of each character of matplotlib's hatches in use."""


def state_css() -> str:
    """The style sheet ``states.css``: two variables per state, and the box with its label."""
    variables = [
        f"--{state.name.lower()}: {state.display.color_hex}; "
        f"--on-{state.name.lower()}: {state.display.text_color_hex};"
        for state in MarginState
    ]
    boxes = [
        f'.state[data-state="{state.name}"] '
        f"{{ background: var(--{state.name.lower()}); color: var(--on-{state.name.lower()}); }}"
        for state in MarginState
    ]
    return "\n".join([":root {", *variables, "}", *boxes, ""])


def band_patterns() -> list[dict[str, str]]:
    """Of each state with a hatch its name, and the SVG path of a tile 8 wide and 8 high."""
    return [
        {"state": state.name, "path": _HATCH_PATHS[state.display.hatch[0]]}
        for state in MarginState
        if state.display.hatch
    ]
