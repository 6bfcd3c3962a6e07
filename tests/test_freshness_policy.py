"""All packages judge the freshness of a stamp alike: all of them call `freshness_of`."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from app.bridge.control.twist_allowance import allowance_of
from app.bridge.publishing.diagnostics import Diagnostics
from app.bridge.robot_description import FUTURE_TOLERANCE_NS, RobotSettings, pose_limits
from app.bridge.robots import JointFollower
from app.bridge.tf import Lookup
from app.case import TrackingFrame
from app.fixture import (
    FixtureDecision,
    LimiterParameters,
    MarginObservation,
    MarginState,
    Reason,
    constrain,
)
from app.geometry import (
    NS_PER_S,
    Freshness,
    FreshnessLimits,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    freshness_of,
)
from app.robot import robot_from_text
from app.scene import TransformWatchdog
from app.scene.shown_margin import shown_margin
from app.session import PoseRules, PoseTree, StepResult
from tests.bridge.robots.conftest import URDF
from tests.doubles import PARAMETERS, HeldMonitor, near

NOW_NS = 1_700_000_000 * NS_PER_S
STALE_NS = PARAMETERS.stale_after_ns
ROBOT = RobotSettings("arm", stale_after_ns=STALE_NS)
IDENTITY = Transform("tracker", "cautery", np.eye(3), np.zeros(3))


def sample(stamp_ns: int) -> TrackedTransform:
    return TrackedTransform(IDENTITY, Stamp(stamp_ns), TrackingStatus.OK)


def step(stamp_ns: int) -> StepResult:
    """A step at ``NOW_NS`` whose decision rests on samples of ``stamp_ns``."""
    proximity = near(9.0)
    decision = FixtureDecision(
        state=MarginState.NEGATIVE,
        reasons=(Reason.CLEAR,),
        proximity=proximity,
        margin=None,
        constraint=constrain(proximity, 1.0, frame="tumor"),
        hold=False,
        stamp=Stamp(stamp_ns),
        seq=1,
        constraint_is_current=True,
    )
    pose = Transform("tumor", "cautery_tip", np.eye(3), np.zeros(3))
    frame = TrackingFrame(Stamp(NOW_NS), (sample(stamp_ns),))
    return StepResult(0, frame, decision, pose, None, {}, None)


def used_by_pose_tree(stamp_ns: int) -> bool:
    tree = PoseTree(PoseRules(PARAMETERS.freshness_limits, ("cautery",)))
    tree.insert(TrackingFrame(Stamp(NOW_NS), (sample(stamp_ns),)))
    return tree.pose("tracker", "cautery").transform is not None


def used_by_monitor(stamp_ns: int) -> bool:
    decision = HeldMonitor(PARAMETERS).update(
        MarginObservation(
            now=Stamp(NOW_NS),
            stamp=Stamp(stamp_ns),
            proximity=near(9.0),
            problems=frozenset(),
            sigma_tre_mm=0.0,
            unchanged_ns=0,
        )
    )
    return decision.state is not MarginState.UNKNOWN


def shown_by_lamp(stamp_ns: int) -> bool:
    watchdog = TransformWatchdog(STALE_NS)
    watchdog.observe(sample(stamp_ns))
    (health,) = watchdog.check(NOW_NS)
    return health.freshness is Freshness.VALID


def shown_in_scene(stamp_ns: int) -> bool:
    shown = shown_margin(step(stamp_ns).decision, TransformWatchdog(STALE_NS), NOW_NS)
    return shown.state is not MarginState.UNKNOWN


def listed_as_tracked_in_diagnostics(stamp_ns: int) -> bool:
    report = Diagnostics().report(step(stamp_ns), STALE_NS)
    assert report is not None
    (tracking,) = (part for part in report.status if part.name == "marginguard: tracking")
    return tracking.message == "all tracked"


def allows_motion(stamp_ns: int) -> bool:
    return allowance_of(step(stamp_ns), PARAMETERS, 0, LimiterParameters()) is not None


def followed_by_joints(stamp_ns: int) -> bool:
    follower = JointFollower(robot_from_text(URDF), ROBOT)
    follower.take(["turn", "push"], [0.1, 0.2], stamp_ns)
    return not follower.state(NOW_NS).is_stale


def followed_with_one_current_joint(stamp_ns: int) -> bool:
    follower = JointFollower(robot_from_text(URDF), ROBOT)
    follower.take(["turn"], [0.1], NOW_NS)
    follower.take(["push"], [0.2], stamp_ns)
    return not follower.state(NOW_NS).is_stale


def looked_up_in_slicer(stamp_ns: int) -> bool:
    from ROS2Lib.tf2_nodes import vtkMRMLROS2Tf2LookupNode

    node = vtkMRMLROS2Tf2LookupNode()
    node.SetStaleAfterSeconds(STALE_NS / NS_PER_S)
    node._found = Lookup(IDENTITY, stamp_ns)
    node._owner = SimpleNamespace(now_ns=lambda: NOW_NS)  # TEST DOUBLE of a ROS node
    return node.GetState() == "valid"


STRICT = FreshnessLimits(STALE_NS)
OTHER_HOSTS = pose_limits(STALE_NS)
USERS: dict[Callable[[int], bool], FreshnessLimits] = {
    used_by_pose_tree: STRICT,
    used_by_monitor: STRICT,
    shown_by_lamp: STRICT,
    shown_in_scene: STRICT,
    listed_as_tracked_in_diagnostics: STRICT,
    allows_motion: STRICT,
    followed_by_joints: OTHER_HOSTS,
    followed_with_one_current_joint: OTHER_HOSTS,
    looked_up_in_slicer: OTHER_HOSTS,
}


@pytest.mark.parametrize("user", USERS, ids=lambda user: user.__name__)
@pytest.mark.parametrize(
    "age_ns",
    [
        -NS_PER_S,
        -STALE_NS - 1,
        -STALE_NS,
        -FUTURE_TOLERANCE_NS - 1,
        -FUTURE_TOLERANCE_NS,
        -1,
        0,
        1,
        STALE_NS,
        STALE_NS + 1,
        NS_PER_S,
    ],
)
def test_all_users_agree_with_the_policy(user, age_ns):
    stamp_ns = NOW_NS - age_ns
    is_valid = freshness_of(stamp_ns, NOW_NS, USERS[user]) is Freshness.VALID
    assert user(stamp_ns) == is_valid


def test_session_tolerates_no_stamp_ahead_and_followers_only_a_short_time():
    assert PARAMETERS.freshness_limits.future_tolerance_ns == 0
    assert FUTURE_TOLERANCE_NS == 50_000_000
    assert pose_limits(10).future_tolerance_ns == 10
