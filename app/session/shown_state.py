"""Display of a decision, and advice on a state that is UNKNOWN.

Inside the stop margin the state is WARNING, as at the warning distance, but the constraint forbids
approach. It is shown by a symbol and a label of its own, and by inverted colours: its dark ground
differs in luminance from the ground of every state, also for colour-blind users. The cause of an
advice is `Reason.text`, with the details of `StepResult.frames_problem`.

A latched hold is a state of the banner: a green CLEAR above it would say "go" and "stop" at once.
It has the dark ground of STOP, text in another colour, and a striped edge.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from app.fixture import FixtureDecision, MarginState, Reason
from app.session.step_result import StepResult
from app.session.structure import StructureStep

STOP = "STOP"
"""Key of the display of a tool inside the stop margin."""
HOLD = "HOLD"
"""Key of the display of a hold that lasts until a re-arm."""


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
    HOLD: ShownState(HOLD, "\N{BLACK SQUARE}", "HOLD", "#0e1a3c", "#ffffff"),
}
"""By key: the names of `MarginState`, `STOP` and `HOLD`."""


def margin_display(decision: FixtureDecision) -> ShownState:
    """The display of the margin of ``decision``, whether it is on hold or not."""
    is_stopped = Reason.STOP_DISTANCE in decision.reasons
    if decision.state is MarginState.WARNING and is_stopped:
        return SHOWN_STATES[STOP]
    return SHOWN_STATES[decision.state.name]


def governing_name(step: StepResult) -> str:
    """The governing structure in words; empty for the tumour."""
    governing = step.governing
    if governing is None or governing is step.structures[0]:
        return ""
    return structure_title(governing.name)


def structure_title(name: str) -> str:
    """The name of a structure in words."""
    return "tumour" if name == "tumor" else name.replace("_", " ")


def structure_line(structure: StructureStep) -> str:
    """Name, state and distance of a structure, as ``chest wall: CLOSE, 3.1 mm``.

    A far one is ``at least 52 mm`` away.
    """
    decision = structure.decision
    display, proximity = margin_display(decision), decision.proximity
    label = "INSIDE" if decision.state is MarginState.POSITIVE else display.label
    line = f"{structure_title(structure.name)}: {label}"
    if structure.at_least_mm is not None:
        return f"{line}, at least {math.floor(structure.at_least_mm)} mm"
    if decision.state is MarginState.UNKNOWN or proximity is None:
        return line
    return f"{line}, {proximity.signed_distance_mm:.1f} mm"


def off_line(name: str, reason: str) -> str:
    """Line on a structure that is switched off, as ``chest wall: OFF, not in the field``."""
    return f"{structure_title(name)}: OFF, {reason}"


def named(text: str, structure: str) -> str:
    """``text``, which is on the tumour, for the ``structure`` in words; as it is for empty."""
    if not structure:
        return text
    found = text.replace("tumour", structure)
    found = found.replace("IN TUMOUR", f"IN {structure.upper()}")
    return found if found != text else f"{text} ({structure})"


def banner_states(margin: ShownState, *, latched: bool) -> tuple[ShownState, ShownState | None]:
    """The display of a banner and the smaller one beside it: ``margin`` and a ``latched`` hold.

    The worse one is first: IN TUMOUR and UNKNOWN are worse than a hold, all others are better.
    Without a hold there is nothing beside.
    """
    hold = SHOWN_STATES[HOLD]
    if not latched:
        return margin, None
    is_worse = margin.key in (MarginState.POSITIVE.name, MarginState.UNKNOWN.name)
    return (margin, hold) if is_worse else (hold, margin)


_TRACKER = "restart the tracker's program if this stays"

ADVICE: Mapping[Reason, str] = MappingProxyType(
    {
        Reason.MESH_MISSING: "give both a mesh in the configuration, then start again",
        Reason.MESH_NOT_CLOSED: "close the mesh: 'marginguard info' names the place",
        Reason.REGISTRATION_MISSING: "register the robot: 'marginguard calibrate robot-base'",
        Reason.REGISTRATION_REFUSED: (
            "register again, with landmarks that are further apart and dwells that are steady"
        ),
        Reason.REGISTRATION_DRIFT: (
            "stop the robot; check that its base, the tool and the sensors are fixed, "
            "then register again"
        ),
        Reason.SECOND_SENDER: "end the second program that sends it, then re-arm",
        Reason.CONTRADICTION: (
            "look for metal near the tracker, a loose sensor and a bent tool; calibrate the tool "
            "again"
        ),
        Reason.IMPLAUSIBLE: "hold the tool still in view; look for metal and for a loose sensor",
        Reason.REDUNDANCY_LOST: "check that the driver of the robot runs and sends its joints",
        Reason.CLOCK_JUMPED_BACK: f"wait for the next poses; {_TRACKER}",
        Reason.FUTURE_STAMP: (
            "synchronise the clocks of both machines, or set 'clock: estimate' in live.yaml"
        ),
        Reason.NOT_FINITE: _TRACKER,
        Reason.NOT_RIGID: f"check the calibration of the tracked tools; {_TRACKER}",
        Reason.INVALID: "bring tool and sensors into the tracker's view; look for metal",
        Reason.MISSING: (
            "bring tool and sensors into the tracker's view; check that the tracker runs and "
            "that the names of its frames are those of the configuration"
        ),
        Reason.STALE: "check that the tracker runs, and the cable or network to it",
        Reason.FROZEN: _TRACKER,
        Reason.STARTING: "wait; bring tool and tumour sensor into the tracker's view",
        Reason.RECOVERING: "wait a moment with the tool in view",
        Reason.LATCHED: "find the cause, then end the hold: 're-arm'",
    }
)
"""Every fault, and the hold."""

_MAX_SENTENCES = 2


def advice_text(reasons: Iterable[Reason]) -> str:
    """Advice on the worst faults among ``reasons``, worst first; empty without a fault."""
    texts = dict.fromkeys(ADVICE[reason] for reason in reasons if reason.is_fault)
    return ". ".join(text[:1].upper() + text[1:] for text in list(texts)[:_MAX_SENTENCES])
