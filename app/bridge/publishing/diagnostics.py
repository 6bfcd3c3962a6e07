"""Diagnostics of a session: state, reasons, ages and lost poses as ``diagnostic_msgs``."""

from collections.abc import Callable, Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from app.bridge.messages import diagnostic_status, header_message
from app.bridge.publishing.markers import margin_text
from app.fixture import MarginState
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    Freshness,
    FreshnessLimits,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    freshness_of_stamp,
)
from app.session import StepResult

LEVEL_OF_STATE = {
    MarginState.NEGATIVE: DiagnosticStatus.OK,
    MarginState.WARNING: DiagnosticStatus.WARN,
    MarginState.POSITIVE: DiagnosticStatus.ERROR,
    MarginState.UNKNOWN: DiagnosticStatus.STALE,
}
PERIOD_NS = NS_PER_S


class Diagnostics:
    """Reports once per second of session time and at every change.

    A change is another state or other reasons, or a problem of the robot or of the frames or a
    playback that appears or ends, or another state of another tool. ``counts`` returns the counters
    of a live source, ``definition_problems`` texts about nodes with other definitions of our
    messages.
    """

    def __init__(
        self,
        counts: Callable[[], Mapping[str, int]] | None = None,
        definition_problems: Callable[[], Sequence[str]] = tuple,
    ) -> None:
        self._counts = counts
        self._definition_problems = definition_problems
        self._samples: dict[tuple[str, str], TrackedTransform] = {}
        self._lost: dict[tuple[str, str], int] = {}
        self._last_ns: int | None = None
        self._last_key: object = None

    def report(self, step: StepResult, stale_after_ns: int) -> DiagnosticArray | None:
        """Report that is due after ``step``; None if none is due.

        A pose older than ``stale_after_ns`` is reported as stale, whatever its status is.
        """
        for sample in step.frame.poses:
            edge = (sample.target, sample.source)
            self._samples[edge] = sample
            lost = sample.status is not TrackingStatus.OK
            self._lost[edge] = self._lost.get(edge, 0) + lost
        now = step.frame.stamp
        problems = tuple(self._definition_problems())
        # Compare only whether there is a problem: its text may contain numbers that change.
        key = (
            step.decision.state,
            step.decision.reasons,
            bool(step.robot_problem),
            bool(step.frames_problem),
            bool(step.playback),
            problems,
            tuple(each.state for each in step.tools),
        )
        elapsed_ns = None if self._last_ns is None else now.ns - self._last_ns
        if key == self._last_key and elapsed_ns is not None and 0 <= elapsed_ns < PERIOD_NS:
            return None
        self._last_ns, self._last_key = now.ns, key
        status = [_margin_status(step), self._tracking_status(step, stale_after_ns)]
        if step.joints is not None or step.robot_problem:
            status.append(_robot_status(step))
        if step.tools:
            status.append(_tools_status(step))
        if self._counts is not None:
            level, message = DiagnosticStatus.OK, "counts since the start"
            if step.playback:
                level, message = DiagnosticStatus.WARN, f"PLAYBACK: {step.playback}"
            status.append(diagnostic_status("source", level, message, self._counts()))
        if problems:
            text = "; ".join(problems)
            status.append(diagnostic_status("messages", DiagnosticStatus.ERROR, text, {}))
        return DiagnosticArray(header=header_message("", now), status=status)

    def _tracking_status(self, step: StepResult, stale_after_ns: int) -> DiagnosticStatus:
        now = step.frame.stamp
        limits = FreshnessLimits(stale_after_ns)
        lost, stale, values = [], [], {}
        for (target, source), sample in self._samples.items():
            edge = f"{target} -> {source}"
            if freshness_of_stamp(sample.stamp, now, limits) is not Freshness.VALID:
                stale.append(edge)
            elif sample.status is not TrackingStatus.OK:
                lost.append(edge)
            values[f"{edge}: status"] = sample.status.name
            values[f"{edge}: age_ms"] = _age_ms(now, sample.stamp)
            values[f"{edge}: lost samples"] = str(self._lost[target, source])
        level, texts = DiagnosticStatus.OK, []
        if lost:
            level, texts = DiagnosticStatus.WARN, [f"lost: {', '.join(lost)}"]
        if stale:
            level, texts = DiagnosticStatus.STALE, [f"stale: {', '.join(stale)}", *texts]
        if not self._samples:
            level, texts = DiagnosticStatus.STALE, ["nothing was tracked so far"]
        if step.frames_problem:
            level, texts = max(level, DiagnosticStatus.WARN), [step.frames_problem, *texts]
        return diagnostic_status("tracking", level, "; ".join(texts) or "all tracked", values)


def _margin_status(step: StepResult) -> DiagnosticStatus:
    decision = step.decision
    values = {
        "state": decision.state.name,
        "reasons": ", ".join(str(reason) for reason in decision.reasons),
        "hold": str(decision.hold).lower(),
        "step": str(step.index),
        "single_source": str(step.single_source).lower(),
    }
    if decision.stamp is not None:
        values["age_ms"] = _age_ms(step.frame.stamp, decision.stamp)
    if decision.proximity is not None:
        values["signed_distance_mm"] = f"{decision.proximity.signed_distance_mm:.3f}"
    if decision.margin is not None:
        values["applied_stop_mm"] = f"{decision.margin.total_mm:.3f}"
    return diagnostic_status(
        "margin", LEVEL_OF_STATE[decision.state], margin_text(decision), values
    )


def _tools_status(step: StepResult) -> DiagnosticStatus:
    level = DiagnosticStatus.WARN if step.warnings else DiagnosticStatus.OK
    message = "; ".join(step.warnings) or "apart"
    return diagnostic_status("tools", level, message, {each.name: each.text for each in step.tools})


def _robot_status(step: StepResult) -> DiagnosticStatus:
    """Joint states; without them a drift of the registration is not detected."""
    values = {}
    if step.joints is not None:
        values["age_ms"] = _age_ms(step.frame.stamp, step.joints.stamp)
    level = DiagnosticStatus.WARN if step.robot_problem else DiagnosticStatus.OK
    return diagnostic_status("joints", level, step.robot_problem or "received", values)


def _age_ms(now: Stamp, stamp: Stamp) -> str:
    return f"{stamp.age_ns(now) / NS_PER_MS:.1f}"
