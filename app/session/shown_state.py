"""Display of a decision: that of its state, or that of a tool inside the stop margin.

Inside the stop margin the state is WARNING, as at the warning distance, but the constraint forbids
approach. It is shown by a symbol and a label of its own, and by inverted colours: its dark ground
differs in luminance from the ground of every state, also for colour-blind users.
"""

from dataclasses import dataclass

from app.fixture import FixtureDecision, MarginState, Reason

STOP = "STOP"
"""Key of the display of a tool inside the stop margin."""


@dataclass(frozen=True, slots=True)
class ShownState:
    """Key for style sheets, symbol, label, and colours as ``#rrggbb`` of ground and text."""

    key: str
    symbol: str
    label: str
    ground_hex: str
    text_hex: str


def _of(state: MarginState) -> ShownState:
    display = state.display
    return ShownState(
        state.name, display.symbol, display.label, display.color_hex, display.text_color_hex
    )


_STOP_GROUND = "#1a1300"

SHOWN_STATES = {
    **{state.name: _of(state) for state in MarginState},
    STOP: ShownState(STOP, "!!", "STOP", _STOP_GROUND, MarginState.WARNING.display.color_hex),
}
"""By key: the names of `MarginState`, and `STOP`."""


def shown_state(decision: FixtureDecision) -> ShownState:
    """The display of ``decision``."""
    is_stopped = Reason.STOP_DISTANCE in decision.reasons
    if decision.state is MarginState.WARNING and is_stopped:
        return SHOWN_STATES[STOP]
    return SHOWN_STATES[decision.state.name]
