"""tf broadcasters and lookups of the ROS2 module against an rclpy process."""

import pytest
from slicer import vtkMRMLTransformNode

from app.geometry import MarginGuardError
from tests.slicer_module.ros2_values import shifted, x_mm
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow


class Events:
    """The x translation in mm at each TransformModifiedEvent of ``node``."""

    def __init__(self, node):
        self.x_mm = []
        node.AddObserver(vtkMRMLTransformNode.TransformModifiedEvent, self._on_modified)

    def _on_modified(self, caller, _):
        self.x_mm.append(x_mm(caller))


def test_66_mm_are_broadcast_and_looked_up_as_66_mm(node, peer, spin_until):
    broadcaster = node.CreateAndAddTf2BroadcasterNode("Parent", "Child")
    assert broadcaster.GetName() == "ros2:tf2broadcaster:ParentToChild"
    lookup = node.CreateAndAddTf2LookupNode("Parent", "Child")
    assert lookup.GetName() == "ros2:tf2lookup:ParentToChild"
    assert node.GetScene().GetFirstNodeByName(lookup.GetName()) is lookup
    assert lookup.IsA("vtkMRMLLinearTransformNode")
    events = Events(lookup)
    first = broadcaster.Broadcast(shifted(1.0))
    peer("listen", topic="/tf", type="tf2_msgs/msg/TFMessage")
    before_ns = node.now_ns()

    def arrived():
        assert broadcaster.Broadcast(shifted(66.0))
        at_peer = peer("has_edge", child="Child", x=0.066)
        is_shown = events.x_mm and events.x_mm[-1] == 66.0
        return at_peer and is_shown and lookup.GetState() == "valid"

    spin_until(arrived)
    assert first is True
    edge = peer("take", topic="/tf")[-1]["transforms"][0]
    assert (edge["header"]["frame_id"], edge["child_frame_id"]) == ("Parent", "Child")
    assert edge["transform"]["translation"] == {"x": 0.066, "y": 0.0, "z": 0.0}
    stamp = edge["header"]["stamp"]
    assert before_ns <= stamp["sec"] * 10**9 + stamp["nanosec"] <= node.now_ns()
    assert x_mm(lookup) == pytest.approx(66.0, abs=1e-9)
    assert 0.0 <= lookup.GetAgeSeconds() < DEADLINE_S


def test_each_new_sample_is_one_event(node, peer, spin_until):
    lookup = node.CreateAndAddTf2LookupNode("hall", "door")
    assert lookup.GetModifiedOnLookup() is True  # as in SlicerROS2
    lookup.SetModifiedOnLookup(False)
    events = Events(lookup)
    assert (lookup.GetState(), lookup.GetAgeSeconds()) == ("missing", None)
    assert lookup.IsStale()
    stamp_ns = peer("send_tf", edges=[["hall", "door", [0.25, 0.0, 0.0]]])
    spin_until(lambda: events.x_mm)
    assert lookup.GetStampNanoseconds() == stamp_ns
    assert lookup.GetAttribute("ros2.stamp_ns") == str(stamp_ns)
    for _ in range(5):
        node.Spin()
    assert events.x_mm == [250.0]
    lookup.SetModifiedOnLookup(True)
    node.Spin()
    assert events.x_mm == [250.0, 250.0]
    # The same pose with another stamp is a new sample, so the node is not stale.
    lookup.SetModifiedOnLookup(False)
    later_ns = peer("send_tf", edges=[["hall", "door", [0.25, 0.0, 0.0]]])
    spin_until(lambda: len(events.x_mm) == 3)
    assert lookup.GetStampNanoseconds() == later_ns > stamp_ns


def test_old_pose_is_stale_and_shows_its_age(node, peer, spin_until):
    lookup = node.CreateAndAddTf2LookupNode("shelf", "box")
    lookup.SetStaleAfterSeconds(2.0)
    peer("send_tf", edges=[["shelf", "box", [0.1, 0.0, 0.0]]], age_s=60.0)
    spin_until(lambda: lookup.GetState() != "missing")
    assert (lookup.GetState(), lookup.GetAttribute("ros2.state")) == ("stale", "stale")
    assert lookup.IsStale()
    assert 60.0 <= lookup.GetAgeSeconds() < 60.0 + DEADLINE_S
    peer("send_tf", edges=[["shelf", "box", [0.1, 0.0, 0.0]]])
    lookup.SetStaleAfterSeconds(DEADLINE_S)
    spin_until(lambda: lookup.GetState() == "valid")
    assert not lookup.IsStale()
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(MarginGuardError, match="expected more than 0"):
            lookup.SetStaleAfterSeconds(wrong)


def test_fresh_parent_does_not_hide_a_stale_child(node, peer, spin_until):
    lookup = node.CreateAndAddTf2LookupNode("cart", "tip")
    edges = [["arm", "tip", [0.0, 0.0, 0.1]], ["cart", "arm", [0.1, 0.0, 0.0]]]
    peer("send_tf", edges=edges, age_s=5.0)
    spin_until(lambda: lookup.GetState() == "stale")
    peer("send_tf", edges=[["cart", "arm", [0.2, 0.0, 0.0]]])
    other = node.CreateAndAddTf2LookupNode("cart", "arm")
    other.SetStaleAfterSeconds(DEADLINE_S)
    spin_until(lambda: other.GetState() == "valid" and x_mm(other) == pytest.approx(200.0))
    assert lookup.GetState() == "stale"


def insert(node, parent, child, stamp_ns, *, static=False):
    """Insert a transform as the ROS thread does on reception."""
    node.buffer.insert(parent, child, stamp_ns, (5.0, 0, 0, 0, 0, 0, 1), static=static)


def test_disconnected_static_path_is_stale(node):
    lookup = node.CreateAndAddTf2LookupNode("room", "desk")
    insert(node, "room", "desk", 0, static=True)
    node.Spin()
    assert (lookup.GetState(), lookup.GetAgeSeconds()) == ("valid", 0.0)
    insert(node, "barn", "desk", node.now_ns())
    node.Spin()
    assert (lookup.GetState(), lookup.GetAttribute("ros2.state")) == ("stale", "stale")
    assert "no path between 'room'" in lookup.GetProblem()


def test_pose_moved_by_the_user_is_reset_by_the_next_spin(node):
    """A static transform has no next sample, so the node must be reset without one."""
    lookup = node.CreateAndAddTf2LookupNode("yard", "gate")
    lookup.SetModifiedOnLookup(False)
    insert(node, "yard", "gate", 0, static=True)
    node.Spin()
    placed = x_mm(lookup)
    events = Events(lookup)
    lookup.SetMatrixTransformToParent(shifted(99.0))
    node.Spin()
    node.Spin()
    assert lookup.GetState() == "valid"
    assert events.x_mm == [99.0, placed]


def test_pose_becomes_stale_without_spin(node, monkeypatch):
    lookup = node.CreateAndAddTf2LookupNode("loft", "trunk")
    stamp_ns = 10**18
    monkeypatch.setattr(node, "now_ns", lambda: stamp_ns + 500_000_000)  # a TEST DOUBLE of a clock
    insert(node, "loft", "trunk", stamp_ns)
    node.Spin()
    assert lookup.GetState() == "valid"
    monkeypatch.setattr(node, "now_ns", lambda: stamp_ns + 500_000_001)
    assert lookup.IsStale()
    assert lookup.GetState() == "stale"


def test_looked_up_pose_is_broadcast_with_its_own_stamp(node, spin_until):
    lookup = node.CreateAndAddTf2LookupNode("yard", "bike")
    node.CreateAndAddTf2BroadcasterNode("copy", "of_bike").ObserveTransformNode(lookup)
    copy = node.CreateAndAddTf2LookupNode("copy", "of_bike")
    stamps = iter(range(1_000_000_007, 10**12))

    def arrived():
        insert(node, "yard", "bike", next(stamps))
        return copy.GetStampNanoseconds() is not None

    spin_until(lambda: arrived() and x_mm(copy) == pytest.approx(5.0))
    assert 1_000_000_007 <= copy.GetStampNanoseconds() < 10**12
    assert copy.GetState() == "stale"


def test_disconnected_frames_are_missing_with_a_reason(node):
    lookup = node.CreateAndAddTf2LookupNode("nowhere", "never")
    node.Spin()
    assert lookup.GetState() == "missing"
    assert "'nowhere' is unknown" in lookup.GetProblem()


def test_observed_transform_is_broadcast_on_every_change(node, peer, spin_until):
    moved = node.GetScene().AddNewNodeByClass("vtkMRMLLinearTransformNode", "moved")
    broadcaster = node.CreateAndAddTf2BroadcasterNode("bench", "vice")
    lookup = node.CreateAndAddTf2LookupNode("bench", "vice")
    broadcaster.ObserveTransformNode(moved)
    assert broadcaster.GetNodeReference("ObservedTransform") is moved
    count = broadcaster.GetNumberOfBroadcasts()
    positions_mm = iter(range(1, 10_000))

    def arrived():
        moved.SetMatrixTransformToParent(shifted(float(next(positions_mm))))
        return lookup.GetState() == "valid"

    spin_until(arrived)
    assert broadcaster.GetNumberOfBroadcasts() == count + round(x_mm(moved))
    broadcaster.ObserveTransformNode(None)
    moved.SetMatrixTransformToParent(shifted(5.0))
    assert broadcaster.GetNumberOfBroadcasts() < count + next(positions_mm)
    sheared = shifted(0.0)
    sheared.SetElement(0, 1, 0.5)
    with pytest.raises(MarginGuardError, match="rotation"):
        broadcaster.Broadcast(sheared)


def test_broadcast_with_a_stamp_keeps_it(node, spin_until):
    broadcaster = node.CreateAndAddTf2BroadcasterNode("table", "pen")
    lookup = node.CreateAndAddTf2LookupNode("table", "pen")
    stamps = iter(range(1_000_000_007, 10**12))

    def arrived():
        broadcaster.Broadcast(shifted(1.0), next(stamps))
        return lookup.GetStampNanoseconds() is not None

    spin_until(arrived)
    assert 1_000_000_007 <= lookup.GetStampNanoseconds() < next(stamps)
    assert lookup.GetState() == "stale"


@pytest.mark.parametrize("role", ["Lookup", "Broadcaster"])
def test_tf_node_is_unique_per_edge_and_removable_by_frames_or_id(node, role):
    create = getattr(node, f"CreateAndAddTf2{role}Node")
    get = getattr(node, f"GetTf2{role}NodeByParentChild")
    get_by_id = getattr(node, f"GetTf2{role}NodeByID")
    remove = getattr(node, f"RemoveAndDeleteTf2{role}Node")
    before = node.GetScene().GetNumberOfNodes()
    made = create("a", "b")
    assert (made.GetParentID(), made.GetChildID()) == ("a", "b")
    assert get("a", "b") is get_by_id(made.GetID()) is made
    assert create("a", "b") is None
    assert get("b", "a") is None
    assert create("a", "no frame") is None
    assert (remove("a", "b"), remove("a", "b"), remove("x", "y")) == (True, False, False)
    made = create("a", "b")
    identifier = made.GetID()
    assert (remove(identifier), remove(identifier)) == (True, False)
    assert node.GetScene().GetNumberOfNodes() == before


def test_removed_lookup_is_stale_and_keeps_its_pose(node, peer, spin_until):
    lookup = node.CreateAndAddTf2LookupNode("shed", "rake")
    peer("send_tf", edges=[["shed", "rake", [0.5, 0.0, 0.0]]])
    spin_until(lambda: lookup.GetStampNanoseconds() is not None)
    node.RemoveAndDeleteTf2LookupNode("shed", "rake")
    assert lookup.IsStale()
    assert lookup.GetAgeSeconds() is None
    assert x_mm(lookup) == pytest.approx(500.0)
    node.GetScene().AddNode(lookup)
    assert lookup.AddToROS2Node(node.GetID(), "shed", "spade")
    assert lookup.GetState() == "missing"  # no sample of that edge has been received
