import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slicer import vtkMRMLScene

from app.geometry import Freshness, Stamp, TrackedTransform, TrackingStatus, Transform
from app.scene import MarginGuardScene, SceneError, TransformHealth, TransformWatchdog
from app.scene.convert import world_matrix
from tests.scene.scene_content import set_poses

pytestmark = pytest.mark.slow

MS = 1_000_000


def seen(source, at_ms, target="tracker"):
    return TrackedTransform(
        Transform(target, source, np.eye(3), np.full(3, float(at_ms))),
        Stamp(at_ms * MS),
        TrackingStatus.OK,
    )


def lost(source, at_ms):
    return TrackedTransform.lost("tracker", source, Stamp(at_ms * MS), TrackingStatus.MISSING)


def words(watchdog, now_ms):
    return {each.name: each.freshness.value for each in watchdog.check(now_ms * MS)}


def test_transform_is_missing_then_valid_then_stale():
    watchdog = TransformWatchdog(200 * MS)
    watchdog.expect("tracker", "cautery")
    assert watchdog.check(0) == (TransformHealth("CauteryToTracker", Freshness.MISSING, None),)
    watchdog.observe(seen("cautery", 1000))
    for now_ms, freshness in (
        (1000, Freshness.VALID),
        (1200, Freshness.VALID),
        (1201, Freshness.STALE),
        (999, Freshness.STALE),  # from the future: its clock cannot be trusted
    ):
        assert watchdog.check(now_ms * MS) == (
            TransformHealth("CauteryToTracker", freshness, (now_ms - 1000) * MS),
        )


def test_lost_sample_is_missing_with_the_age_of_the_last_good_sample():
    watchdog = TransformWatchdog(200 * MS)
    watchdog.observe(seen("cautery", 1000))
    watchdog.observe(lost("cautery", 1020))
    (health,) = watchdog.check(1050 * MS)
    assert health == TransformHealth("CauteryToTracker", Freshness.MISSING, 50 * MS)
    assert health.text == "CauteryToTracker: missing, 0.1 s"
    watchdog.observe(seen("cautery", 990))  # late, and ignored
    assert words(watchdog, 1050) == {"CauteryToTracker": "missing"}
    watchdog.observe(seen("cautery", 1060))
    assert words(watchdog, 1060) == {"CauteryToTracker": "valid"}


def test_moving_parent_does_not_hide_a_stale_child():
    scene = MarginGuardScene(vtkMRMLScene(), stale_after_ns=200 * MS)
    watchdog = scene.watchdog
    tip = seen("cautery_tip", 0, target="cautery")
    watchdog.observe(tip)
    for now_ms in range(0, 500, 20):
        cautery = seen("cautery", now_ms, target="reference")
        watchdog.observe(cautery)
        set_poses(scene, [cautery.transform, tip.transform])
    # The child was drawn at a new place at each step, and its node notified its observers.
    assert world_matrix(scene.tree.node("cautery_tip"))[0, 3] == 480.0
    assert words(watchdog, 480) == {"CauteryTipToCautery": "stale", "CauteryToReference": "valid"}


def test_restart_forgets_samples_and_keeps_watching():
    watchdog = TransformWatchdog(200 * MS)
    watchdog.observe(seen("cautery", 9000))
    watchdog.observe(lost("needle", 9000))
    watchdog.restart()
    assert words(watchdog, 9000) == {"CauteryToTracker": "missing", "NeedleToTracker": "missing"}
    watchdog.observe(seen("cautery", 10))
    assert words(watchdog, 20)["CauteryToTracker"] == "valid"


@given(st.lists(st.tuples(st.integers(0, 200), st.booleans())), st.integers(0, 500))
def test_transform_is_valid_only_if_its_newest_sample_is_good_and_fresh(samples, now_ms):
    """In any order, as over UDP; of two samples with one stamp the lost one counts."""
    watchdog = TransformWatchdog(200 * MS)
    watchdog.expect("tracker", "cautery")
    for at_ms, good in samples:
        watchdog.observe(seen("cautery", at_ms) if good else lost("cautery", at_ms))
    is_valid = words(watchdog, now_ms)["CauteryToTracker"] == "valid"
    newest = max((at_ms for at_ms, _ in samples), default=0)
    good = bool(samples) and all(good for at_ms, good in samples if at_ms == newest)
    assert is_valid == (good and 0 <= now_ms - newest <= 200)


def test_one_stamp_from_the_future_does_not_hide_later_samples():
    watchdog = TransformWatchdog(200 * MS)
    watchdog.observe(seen("cautery", 3_600_000))
    (health,) = watchdog.check(1000 * MS)
    assert health.text == "CauteryToTracker: stale, 3599.0 s ahead"
    watchdog.observe(seen("cautery", 1020))
    assert words(watchdog, 1020) == {"CauteryToTracker": "valid"}
    watchdog.observe(seen("cautery", 500))  # no way to look fresh
    assert words(watchdog, 1020) == {"CauteryToTracker": "stale"}


@pytest.mark.parametrize("stale_after_ns", [0, -1])
def test_stale_limit_not_above_zero_is_refused(stale_after_ns):
    with pytest.raises(
        SceneError, match=f"stale_after_ns is {stale_after_ns}; expected more than 0"
    ):
        TransformWatchdog(stale_after_ns)
