"""Dummy session step that warms up the renderer.

The first picture of a process takes twice as long as the next: libraries are loaded when they are
first used, and shaders are compiled for the driver.
"""

import numpy as np

from app.case import TrackingFrame
from app.fixture import (
    Constraint,
    FixtureDecision,
    MarginParameters,
    MarginState,
    Proximity,
    Reason,
    Witnesses,
)
from app.geometry import NS_PER_MS, Stamp, SurfaceMesh, TrackedTransform, TrackingStatus, Transform
from app.runtime import SessionContent
from app.session import StepResult

_DISTANCE_MM = 10.0
_STALE_NS = 200 * NS_PER_MS
_MARGINS = MarginParameters(
    stop_mm=1.0,
    warn_mm=5.0,
    k_tre=0.0,
    v_max_mm_s=0.0,
    stale_after_ns=_STALE_NS,
    release_samples=1,
    release_band_mm=0.0,
    frozen_after_ns=_STALE_NS,
)


def warmup_step() -> tuple[SessionContent, StepResult]:
    """A pyramid as tool above a pyramid as tumour, with closest points and a constraint plane."""
    above, tip, up = (0.0, 0.0, _DISTANCE_MM), np.zeros(3), np.array([0.0, 0.0, 1.0])
    nearest = Witnesses.single(_DISTANCE_MM, np.array(above), tip, up)
    plane = np.array([up])
    decision = FixtureDecision(
        state=MarginState.NEGATIVE,
        reasons=(Reason.CLEAR,),
        proximity=Proximity(_DISTANCE_MM, nearest, None),
        margin=None,
        constraint=Constraint(
            "tumor", plane, np.zeros(1), np.array([above]), np.zeros((1, 3)), hold=False
        ),
        hold=False,
        stamp=None,
        seq=1,
        constraint_is_current=True,
    )
    content = SessionContent(
        name="warm-up",
        tumor=_pyramid("tumor"),
        tool=_pyramid("tool_tip"),
        tip_frame="tool_tip",
        static_edges=(
            Transform.identity("needle", "tumor"),
            Transform.identity("tool", "tool_tip"),
        ),
        margins=_MARGINS,
    )
    stamp = Stamp(0)
    poses = (
        Transform.identity("tracker", "needle"),
        Transform("tracker", "tool", np.eye(3), np.array(above)),
    )
    samples = tuple(TrackedTransform(pose, stamp, TrackingStatus.OK) for pose in poses)
    step = StepResult(
        index=0,
        frame=TrackingFrame(stamp, samples),
        decision=decision,
        tumor_from_tip=None,
        virtual_fixture=None,
        links={},
        joints=None,
    )
    return content, step


def _pyramid(frame: str) -> SurfaceMesh:
    corners = np.array([[0, 0, 0], [1, 0, -3], [-1, 1, -3], [-1, -1, -3]], dtype=np.float64)
    return SurfaceMesh(frame, corners, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))
