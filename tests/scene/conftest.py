"""A small case for the scene: a ball as tumour, a rod as tool, an arm of two boxes."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest
from slicer import vtkMRMLScene

from app.case import TrackingFrame
from app.fixture import FixtureDecision, MarginState, Proximity, Reason, Witnesses
from app.geometry import Stamp, SurfaceMesh, TrackedTransform, TrackingStatus, Transform
from app.registration import DriftBound, given_registration
from app.robot import Joint, JointType, Link, Robot, Shape
from app.runtime import SessionContent
from app.scene import SceneApplication, load_scene
from app.session import RobotSetup, StepResult
from tests.doubles import PARAMETERS
from tests.scene.scene_content import set_poses

BOX_FACES = np.array(
    [
        [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
        [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
    ]
)  # fmt: skip


def posed(target, source, turn, place_mm):
    """A pose by its rotation vector in rad and its translation."""
    return Transform.from_rotation_vector(turn, place_mm, target=target, source=source)


def box(frame, low, high):
    (a, b, c), (d, e, f) = low, high
    around = [(a, b), (d, b), (d, e), (a, e)]
    vertices = [(x, y, z) for z in (c, f) for x, y in around]
    return SurfaceMesh(frame, np.array(vertices, dtype=float), BOX_FACES).require_closed(frame)


@pytest.fixture(scope="session")
def tumor():
    """An octahedron split three times onto a sphere of radius 12 mm."""
    points = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    triangles = points[
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    ]
    for _ in range(3):
        a, b, c = np.moveaxis(triangles, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        triangles = np.concatenate(
            [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
        triangles /= np.linalg.norm(triangles, axis=-1, keepdims=True)
    vertices, faces = np.unique(np.round(triangles.reshape(-1, 3), 9), axis=0, return_inverse=True)
    return SurfaceMesh("tumor", 12.0 * vertices, faces.reshape(-1, 3)).require_closed("tumour")


@pytest.fixture(scope="session")
def tool():
    return box("cautery_tip", (-1.0, -1.0, -60.0), (1.0, 1.0, 0.0))


@pytest.fixture(scope="session")
def arm():
    """Two links that turn about y and x; the second has two visuals of different colour."""
    base = Link(
        "base", (Shape(box("base", (-30, -30, 0), (30, 30, 40)), (0.1, 0.2, 0.6, 1), "box"),)
    )
    upper = Link(
        "upper", (Shape(box("upper", (-8, -8, 0), (8, 8, 90)), (0.8, 0.8, 0.8, 1), "box"),)
    )
    fore = Link(
        "fore_arm",
        (
            Shape(box("fore_arm", (-5, -5, 0), (5, 5, 70)), (0.0, 0.0, 1.0, 1), "box"),
            Shape(box("fore_arm", (-7, -7, 60), (7, 7, 66)), (1.0, 0.0, 1.0, 1), "box"),
        ),
    )
    joints = (
        revolute("shoulder", "base", "upper", (0, 0, 40), (0, 1, 0)),
        revolute("elbow", "upper", "fore_arm", (0, 0, 90), (1, 0, 0)),
    )
    return Robot("arm", (base, upper, fore), joints)


def revolute(name, parent, child, at_mm, axis):
    origin = Transform(parent, child, np.eye(3), np.array(at_mm, dtype=float))
    return Joint(name, JointType.REVOLUTE, origin, np.array(axis, dtype=float), -3.0, 3.0)


@pytest.fixture(scope="session")
def edges():
    """Edges as a tracker measures them: each sensor, the reference included, in its own frame."""
    tracker_from_reference = posed("tracker", "reference", [0.2, 0.5, 1.0], [300.0, 20.0, 10.0])
    reference_from_needle = posed("reference", "needle", [0.1, 0.0, 0.3], [40.0, 10.0, 60.0])
    reference_from_cautery = posed("reference", "cautery", [2.2, 0.3, 0.0], [42.0, 12.0, 65.0])
    return (
        tracker_from_reference,
        tracker_from_reference @ reference_from_needle,
        tracker_from_reference @ reference_from_cautery,
    )


@pytest.fixture(scope="session")
def fixed():
    return (
        posed("cautery", "cautery_tip", [0.0, 0.4, 0.0], [0.0, 5.0, 1.0]),
        posed("needle", "tumor", [0.0, 0.0, 0.2], [1.0, -2.0, 3.0]),
        posed("reference", "robot_base", [0.0, 0.0, 0.4], [-90.0, 30.0, -20.0]),
    )


@pytest.fixture(scope="session")
def fill(edges, fixed, tumor, tool, arm):
    """Puts the whole case, or all but the robot, into a scene, and returns it."""

    def put(scene, has_robot=True):
        set_poses(scene, edges, fixed)
        scene.add_tumor(tumor)
        scene.add_tool(tool)
        if has_robot:
            scene.add_robot("arm", arm, "robot_base")
        return scene

    return put


@pytest.fixture(scope="session")
def content(fixed, tumor, tool, arm):
    """The content of a session of the case; the arm's forearm holds the tool."""
    return SessionContent(
        name="case",
        tumor=tumor,
        tool=tool,
        tip_frame="cautery_tip",
        static_edges=fixed,
        margins=PARAMETERS,
        robot=RobotSetup(
            arm,
            "robot_base",
            "fore_arm",
            given_registration(fixed[2]),
            DriftBound(translation_mm=1.0, rotation_rad=0.1),
        ),
    )


@pytest.fixture(scope="session")
def make_step(edges, arm):
    """Makes a step of the session; the arm is stretched out unless ``links`` are given."""

    def make(
        state=MarginState.POSITIVE,
        distance_mm=-2.0,
        *,
        measured=edges,
        links=None,
        tumor_from_tip=None,
        stamp_ns=1,
    ):
        stamp = Stamp(stamp_ns)
        samples = tuple(TrackedTransform(edge, stamp, TrackingStatus.OK) for edge in measured)
        return StepResult(
            index=0,
            frame=TrackingFrame(stamp, samples),
            decision=build_decision(state, distance_mm)._replace(stamp=stamp),
            tumor_from_tip=tumor_from_tip,
            virtual_fixture=None,
            links=arm.forward_kinematics({}) if links is None else links,
            joints=None,
        )

    return make


def build_decision(state, distance_mm):
    proximity = None
    if distance_mm is not None:
        normal = np.array([0.0, 0.0, 1.0])
        surface = np.array([0.0, 0.0, 12.0])
        witnesses = Witnesses.single(distance_mm, surface + distance_mm * normal, surface, normal)
        proximity = Proximity(distance_mm, witnesses, None)
    return FixtureDecision(state, (Reason.INSIDE,), proximity, None, None, False, Stamp(1), 1)


@pytest.fixture(scope="session")
def decision():
    """A decision whose closest points lie on the tumour's +z axis."""
    return build_decision


@pytest.fixture
def application():
    return SceneApplication(vtkMRMLScene())


def loaded(path):
    """An application with the scene of a file."""
    application = SceneApplication(vtkMRMLScene())
    load_scene(application.scene, path)
    return application


@pytest.fixture(scope="session")
def example_urdfs():
    """UR5 (COLLADA surfaces) and Panda (mimic) of example-robot-data, a peer's test data."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the example-robot-data wheel is not installed")
    found = {f.name: Path(str(f.locate())) for f in files}
    return found["ur5_robot.urdf"], found["panda.urdf"]
