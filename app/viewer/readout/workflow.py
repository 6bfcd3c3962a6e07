"""The steps of a case as values of the page."""

from typing import Any

from app.runtime import RecordingStatus
from app.viewer.steps.view_state import ViewState
from app.workflow import CalibrationStatus, WorkflowState, next_step, workflow_steps

_MAX_CHARS = 140


def workflow_values(
    shown: ViewState | None,
    *,
    is_live: bool,
    has_images: bool,
    calibration: CalibrationStatus | None,
    recording: RecordingStatus | None,
) -> dict[str, Any] | None:
    """Each step with what it needs, has and lacks; None before the first moment of a session."""
    if shown is None:
        return None
    steps = workflow_steps(
        shown.step,
        shown.content,
        is_live=is_live,
        silent=shown.silent,
        has_images=has_images,
        calibration=calibration,
        recording=recording,
    )
    following = next_step(steps)
    needed = [each for each in steps if each.is_needed]
    done = sum(each.state is WorkflowState.DONE for each in needed)
    return {
        "count": f"{done} of {len(needed)} done",
        "next": "" if following is None else _shortened(f"{following.name}: {following.problem}"),
        "rows": [
            {
                "name": each.name.value,
                "state": each.state.value,
                "symbol": each.symbol,
                "needs": each.needs,
                "has": each.has,
                "problem": each.problem,
            }
            for each in steps
        ],
    }


def _shortened(text: str) -> str:
    return text if len(text) <= _MAX_CHARS else f"{text[:_MAX_CHARS]} ..."
