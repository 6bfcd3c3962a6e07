"""Advice on a state that is UNKNOWN: one sentence for each reason.

The cause is `Reason.text`, with the details of `StepResult.frames_problem`.
"""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from app.fixture import Reason

_TRACKER = "restart the tracker's program if this stays"

ADVICE: Mapping[Reason, str] = MappingProxyType(
    {
        Reason.MESH_MISSING: "give both a mesh in the configuration, then start again",
        Reason.MESH_NOT_CLOSED: "close the mesh: 'marginguard info' names the place",
        Reason.REGISTRATION_MISSING: "register the robot: 'marginguard register'",
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
    return ". ".join(_sentence(text) for text in list(texts)[:_MAX_SENTENCES])


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
