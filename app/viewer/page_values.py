"""Values of the page beside the picture."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from app.case import ENERGY_DEVICE, Activation
from app.fixture import FixtureDecision, MarginState, Proximity, Reason
from app.geometry import ANATOMICAL_WORDS, NS_PER_MS, Freshness
from app.hold import SeenHold
from app.runtime import (
    GUARDED_TOOL,
    OperatorRequest,
    RecordingStatus,
    SessionContent,
    TipDirections,
    tools_of,
)
from app.scene.shown_margin import TransformHealth
from app.session import (
    HOLD,
    SHOWN_STATES,
    SINGLE_SOURCE,
    ShownState,
    StepResult,
    StructureStep,
    ToolDistance,
    advice_text,
    banner_states,
    governing_name,
    margin_display,
    moment_text,
    named,
    structure_title,
)
from app.viewer.view_state import ViewState


def reason_text(state: MarginState, reasons: tuple[Reason, ...]) -> str:
    """Text of the worst reason for ``state``; of all faults while it is UNKNOWN.

    `Reason.LATCHED` is left out: the page shows the hold separately.
    """
    listed = [reason for reason in reasons if reason is not Reason.LATCHED]
    listed = [r for r in listed if r.is_fault] if state is MarginState.UNKNOWN else listed[:1]
    return "; ".join(reason.text for reason in listed)


def distance_text(signed_distance_mm: float | None) -> str:
    """The distance in mm with one decimal and a minus sign; a dash for None."""
    if signed_distance_mm is None:
        return "\N{EN DASH}"
    return f"{signed_distance_mm:.1f}".replace("-", "\N{MINUS SIGN}")


_SILENT = "Look at the terminal in which this page was started, and start it again"
"""Advice for a session that has ended or sends nothing."""


def readout(shown: ViewState | None) -> dict[str, Any]:
    """Return label, reasons, distance, trend, breaches, margins, lamps, playback and hold.

    Of a hold also its causes, newest first; the last request to change a live session, with its
    outcome. ``state`` is that of the margin, also while the label is that of a hold.
    """
    if shown is None:
        return dict(_NOTHING)
    decision = shown.step.decision
    latched = Reason.LATCHED in decision.reasons
    governing = governing_name(shown.step)
    margin = margin_display(decision)
    if decision.state is MarginState.POSITIVE:
        margin = replace(margin, label=named(margin.label, governing))
    display, beside = banner_states(margin, latched=latched)
    causes = shown.step.hold_causes[::-1] if decision.hold else ()
    advice = advice_text(decision.reasons) if decision.state is MarginState.UNKNOWN else ""
    why = shown.silent or _why(display, causes) or named(_reasons(shown.step), governing)
    return (
        _NOTHING
        | _look(display)
        | _margins(decision, shown.content)
        | {
            "state": decision.state.name,
            "beside": None if beside is None else _look(beside),
            "why": why,
            "todo": _SILENT if shown.silent else advice,
            "distance": distance_text(shown.distance_mm),
            "trend": str(shown.trend),
            "hold": latched,
            "rearm": _rearm(shown.seen, decision.state),
            "breaches": shown.breaches,
            "history": _history(shown),
            "margins": [shown.content.margins.stop_mm, shown.content.margins.warn_mm],
            "registration": _registration(shown.content),
            "lamps": [_lamp(lamp, silent=bool(shown.silent)) for lamp in shown.lamps],
            "playback": shown.step.playback,
            "single": SINGLE_SOURCE if shown.step.single_source else "",
            "causes": [
                {"short": shortened(cause, _MAX_CAUSE_CHARS), "full": cause} for cause in causes
            ],
            "moment": moment_text(shown.step.frame.stamp.ns, shown.elapsed_s),
            "request": _request(shown.request),
            "activation": _activation(shown),
            "structures": _structures(shown),
            "tools": _tools(shown),
        }
    )


def _look(display: ShownState) -> dict[str, str]:
    return {"shown": display.key, "symbol": display.symbol, "label": display.label}


_NOTHING: dict[str, Any] = {
    **_look(SHOWN_STATES[MarginState.UNKNOWN.name]),
    "state": MarginState.UNKNOWN.name,
    "beside": None,
    "why": "nothing has been measured yet",
    "todo": "",
    "distance": distance_text(None),
    "trend": "",
    "hold": False,
    "rearm": None,
    "breaches": 0,
    "history": "",
    "margins": None,
    "stop": "",
    "warn": "",
    "terms": [],
    "tre": "",
    "registration": {"verdict": "", "ok": False, "numbers": ""},
    "lamps": [],
    "playback": "",
    "single": "",
    "causes": [],
    "moment": "",
    "request": None,
    "activation": None,
    "structures": [],
    "tools": [],
}
"""Values before the first step."""


def _structures(shown: ViewState) -> list[dict[str, str | bool]]:
    """Each of several structures, unknown while the session is silent; then those that are off."""
    found: list[dict[str, str | bool]] = []
    for each in shown.step.structures:
        decision = each.decision
        is_known = not shown.silent and decision.state is not MarginState.UNKNOWN
        display = margin_display(decision) if is_known else SHOWN_STATES[MarginState.UNKNOWN.name]
        title = structure_title(each.name)
        found.append(
            {
                "name": each.name,
                "title": title,
                "role": str(each.role),
                "shown": display.key,
                "symbol": display.symbol,
                "label": "INSIDE" if display.key == MarginState.POSITIVE.name else display.label,
                "distance": _measured(each, decision.proximity)
                if is_known
                else distance_text(None),
                "governs": each is shown.step.governing,
                "off": "",
            }
        )
    return found + [
        {"name": name, "title": structure_title(name), "shown": "OFF", "off": reason}
        for name, reason in shown.step.off.items()
    ]


def _tools(shown: ViewState) -> list[dict[str, str]]:
    """Each other tool, unknown while the session is silent."""
    found = []
    for each in shown.step.tools:
        state = MarginState.UNKNOWN if shown.silent else each.state
        is_known = state is not MarginState.UNKNOWN
        found.append(
            {
                "title": structure_title(each.name),
                "warning": "" if shown.silent else each.warning,
                **_look(SHOWN_STATES[state.name]),
                "distance": _measured(each, each.proximity) if is_known else distance_text(None),
            }
        )
    return found


def _measured(measured: StructureStep | ToolDistance, proximity: Proximity | None) -> str:
    if measured.at_least_mm is not None:
        return f"\N{GREATER-THAN OR EQUAL TO} {math.floor(measured.at_least_mm)}"
    return distance_text(None if proximity is None else proximity.signed_distance_mm)


_MAX_CAUSE_CHARS = 60
"""Length of a cause in the list; the question that ends a hold has all of each."""


def shortened(text: str, max_chars: int) -> str:
    """The first words of ``text``; with an ellipsis if there are more."""
    if len(text) <= max_chars:
        return text
    return f"{text[:max_chars].rsplit(' ', 1)[0]} \N{HORIZONTAL ELLIPSIS}"


def _why(banner: ShownState, causes: Sequence[str]) -> str:
    """The newest cause, if ``banner`` is that of a hold; else empty."""
    newest = causes[0] if causes else "an earlier fault"
    return shortened(newest, _MAX_CAUSE_CHARS) if banner.key == HOLD else ""


def _reasons(step: StepResult) -> str:
    """The reasons of ``step``; while the state is UNKNOWN with the frames that cause it."""
    decision = step.decision
    text = reason_text(decision.state, decision.reasons)
    is_unknown = decision.state is MarginState.UNKNOWN
    return f"{text} ({step.frames_problem})" if is_unknown and step.frames_problem else text


def _history(shown: ViewState) -> str:
    """The breaches so far, which stay after the tool has left the tumour; empty without one."""
    text = shown.breach_list.text
    if not text:
        return ""
    now = "clear now, " if shown.step.decision.state is MarginState.NEGATIVE else ""
    return f"{now}{text}"


def _rearm(seen: SeenHold | None, state: MarginState) -> dict[str, int | str] | None:
    """Arguments of the command that ends the displayed hold; None if it would be refused."""
    if seen is None or seen.nonce == 0 or state is MarginState.UNKNOWN:
        return None
    return {"seq": seen.seq, "nonce": str(seen.nonce)}  # JavaScript's numbers have 53 bits


def _request(request: OperatorRequest | None) -> dict[str, str | bool] | None:
    return None if request is None else {"line": request.line, "accepted": request.accepted}


def _activation(shown: ViewState) -> dict[str, str] | None:
    """The activation; unknown while the session is silent, None where it is not told."""
    told = shown.step.frame.activation
    if told is None:
        return None
    state = Activation.UNKNOWN if shown.silent else told
    return {
        "name": ENERGY_DEVICE.name,
        "title": ENERGY_DEVICE.title,
        "state": state.value,
        "symbol": state.symbol,
        "label": state.label,
    }


def _margins(decision: FixtureDecision, content: SessionContent) -> dict[str, Any]:
    """The applied margins with their terms; empty while there is no distance."""
    margin = decision.margin
    if margin is None or decision.state is MarginState.UNKNOWN:
        return {}
    return {
        "stop": f"{margin.total_mm:.1f}",
        "warn": f"{margin.warn_total_mm:.1f}",
        "terms": [
            {"name": name, "stop": f"{stop_mm:.2f}", "warn": f"{warn_mm:.2f}"}
            for name, stop_mm, warn_mm in (
                ("as set", margin.stop_mm, margin.warn_mm),
                (_UNCERTAINTY, margin.tre_mm, margin.tre_mm),
                (_AGE, margin.age_mm, margin.age_mm),
                ("applied", margin.total_mm, margin.warn_total_mm),
            )
        ],
        "tre": _tre(margin.tre_mm, content),
    }


_UNCERTAINTY = "k\N{MIDDLE DOT}\N{GREEK SMALL LETTER SIGMA}: registration, tumour, tip"
_AGE = "v\N{MIDDLE DOT}age of the poses"


def _tre(tre_mm: float, content: SessionContent) -> str:
    """The terms of the margins from registration, tumour and tip; only known uncertainties."""
    sigmas = {"tumour": content.tumor_sigma_mm, "calibration": content.tip_sigma_mm}
    stated = [
        f"{name} \N{GREEK SMALL LETTER SIGMA} {sigma:.2f} mm"
        for name, sigma in sigmas.items()
        if sigma > 0.0
    ]
    if stated:
        sigma_at_tip = f"k\N{MIDDLE DOT}\N{GREEK SMALL LETTER SIGMA} at the tip {tre_mm:.2f} mm"
        return f"{sigma_at_tip} ({', '.join(stated)})"
    if content.registration is None:
        return ""
    if content.registration.covariance is None:
        return "adds nothing to the margins"
    return f"k\N{MIDDLE DOT}TRE at the tip {tre_mm:.2f} mm"


def _registration(content: SessionContent) -> dict[str, str | bool]:
    """The verdict on the registration, and its numbers."""
    result = content.registration
    if content.robot is None:
        return {"ok": True, "verdict": "no robot", "numbers": ""}
    if result is None:
        return {"ok": False, "verdict": "missing", "numbers": ""}
    numbers = [f"{len(result.used)} points"] if len(result.used) else []
    numbers += [] if result.fre_mm is None else [f"FRE {result.fre_mm:.2f} mm"]
    numbers += ["uncertainty not known"] if result.covariance is None else []
    verdict = "accepted" if result.accepted else "refused"
    return {"ok": result.accepted, "verdict": verdict, "numbers": ", ".join(numbers)}


def _lamp(lamp: TransformHealth, *, silent: bool) -> dict[str, str]:
    # Without new data the ages do not advance: no lamp may stay "valid".
    stopped = silent and lamp.freshness is Freshness.VALID
    light = Freshness.STALE if stopped else lamp.freshness
    age = "" if silent else _age(lamp.age_ns)
    return {"name": lamp.name, "light": light.value, "age": age}


def _age(age_ns: int | None) -> str:
    if age_ns is None:
        return "never"
    milliseconds = age_ns / NS_PER_MS
    return f"{milliseconds:.0f} ms" if milliseconds < 1000.0 else f"{milliseconds / 1000.0:.1f} s"


def recording_values(status: RecordingStatus | None) -> dict[str, object] | None:
    """Values of the last recording; None before the first."""
    if status is None:
        return None
    minutes, seconds = divmod(int(status.duration_s), 60)
    return {
        "active": status.active,
        "time": f"{minutes}:{seconds:02d}",
        "messages": f"{status.messages} messages",
        "lost": status.lost_text,
        "is_lossy": bool(status.lost),
        "folder": str(status.folder),
        "waiting": ", ".join(status.waiting),
        "problem": status.problem,
    }


def item_values(shown: ViewState | None) -> dict[str, Any]:
    """The display items, and the tools with a tip that a page lets its user choose from."""
    if shown is None:
        return {"display_items": [], "tools": [GUARDED_TOOL]}
    items = [
        {
            "name": each.name,
            "title": each.declared.title,
            "heading": each.declared.heading,
            "length": "" if each.is_pointer else each.text,
            "tip": each.text if each.is_pointer else "",
            "command": each.declared.command,
            "color": "#" + "".join(f"{round(255 * part):02x}" for part in each.declared.color),
        }
        for each in shown.content.items
    ]
    return {"display_items": items, "tools": list(tools_of(shown.content))}


_PAIRS = ("R", "L", "A", "P", "S", "I")


def direction_values(directions: TipDirections, shown: ViewState | None) -> list[dict[str, str]]:
    """Distances of the tip to the stop margin in the six anatomical directions.

    Empty while the state is UNKNOWN or there is no surface.
    """
    if shown is None:
        return []
    found = directions.at(shown.step, shown.content, shown.margin_surface)
    return [
        {
            "letter": letter,
            "word": ANATOMICAL_WORDS[letter],
            "mm": distance_text(found[letter]),
            "inside": "inside" if (found[letter] or 0.0) < 0.0 else "",
        }
        for letter in _PAIRS
        if found
    ]
