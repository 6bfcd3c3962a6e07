"""A moment of nothing in particular, to be drawn before there is one that counts.

The first picture of a process takes twice as long as the next: what draws it is loaded piece by
piece, and compiled for the driver.
"""

import numpy as np

from app.fixture import Constraint, FixtureDecision, MarginState, Proximity, Reason, Witnesses
from app.geometry import SurfaceMesh, Transform
from app.scene import Moment

_AHEAD_MM = 10.0


def rehearsal() -> Moment:
    """A tool that is a small pyramid, above a tumour that is another, behind its plane."""
    above, tip, up = (0.0, 0.0, _AHEAD_MM), np.zeros(3), np.array([0.0, 0.0, 1.0])
    nearest = Witnesses.single(_AHEAD_MM, np.array(above), tip, up)
    plane = np.array([up])
    return Moment(
        decision=FixtureDecision(
            state=MarginState.NEGATIVE,
            reasons=(Reason.CLEAR,),
            proximity=Proximity(_AHEAD_MM, nearest, None),
            margin=None,
            constraint=Constraint(
                "tumor", plane, np.zeros(1), np.array([above]), np.zeros((1, 3)), hold=False
            ),
            hold=False,
            stamp=None,
            seq=1,
            constraint_is_current=True,
        ),
        tumor=_pyramid("tumor"),
        tool=_pyramid("tool_tip"),
        tip_frame="tool_tip",
        measured=(
            Transform.identity("tracker", "needle"),
            Transform("tracker", "tool", np.eye(3), np.array(above)),
        ),
        fixed=(Transform.identity("needle", "tumor"), Transform.identity("tool", "tool_tip")),
    )


def _pyramid(frame: str) -> SurfaceMesh:
    corners = np.array([[0, 0, 0], [1, 0, -3], [-1, 1, -3], [-1, -1, -3]], dtype=np.float64)
    return SurfaceMesh(frame, corners, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))
