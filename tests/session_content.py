"""A small `SessionContent` for tests: a tetrahedron, a smaller one for a tool, a one-link robot."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from app.geometry import SurfaceMesh, Transform
from app.registration import DriftBound, RegistrationResult, given_registration
from app.robot import robot_from_text
from app.runtime import SessionContent
from app.session import RobotSetup
from tests.doubles import PARAMETERS

TETRAHEDRON = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
ONE_LINK_URDF = "<robot name='arm'><link name='base_link'/></robot>"


def one_link_content(robot_file: Path | None = None) -> SessionContent:
    """Content of a registered robot whose base frame and root link have different names."""
    registration = given_registration(
        Transform("reference", "robot_base", np.eye(3), [500.0, 0.0, -250.0])
    )
    return SessionContent(
        name="a small case",
        tumor=SurfaceMesh("tumor", TETRAHEDRON, FACES),
        tool=SurfaceMesh("cautery_tip", TETRAHEDRON / 10.0, FACES),
        tip_frame="cautery_tip",
        static_edges=(
            Transform("cautery", "cautery_tip", np.eye(3), [0.0, 0.0, 120.0]),
            Transform("needle", "tumor", np.eye(3), [1.0, 2.0, 3.0]),
            registration.transform,
        ),
        margins=PARAMETERS,
        robot=RobotSetup(
            robot=robot_from_text(ONE_LINK_URDF),
            base_frame="robot_base",
            tool_link="base_link",
            registration=registration,
            max_drift=DriftBound(5.0, 0.1),
        ),
        robot_file=robot_file,
    )


def registered(content: SessionContent, registration: RegistrationResult) -> SessionContent:
    """``content`` with another registration of its robot."""
    others = [e for e in content.static_edges if e.source != registration.transform.source]
    assert content.robot is not None
    return replace(
        content,
        robot=replace(content.robot, registration=registration),
        static_edges=(*others, registration.transform),
    )
