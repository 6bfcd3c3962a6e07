"""Another DDS implementation understands what we send, under discovery on this machine only."""

from tf2_msgs.msg import TFMessage

from app.bridge import messages
from app.bridge.node import RosNode
from app.bridge.topics import TF
from app.geometry import Stamp, Transform

START_NS = 1_700_000_000_000_000_001


def test_cyclone_dds_receives_tf_field_by_field(domain_id, start_cyclone):
    quarter_turn_about_z = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    transform = Transform("tumor", "virtual_fixture", quarter_turn_about_z, [1.0, 20.0, -300.0])
    with RosNode("speaker", domain_id=domain_id) as ros:
        publisher = ros.publisher(TF)
        listener = start_cyclone("virtual_fixture", "20")
        assert ros.wait_for_subscribers(TF, 1, timeout_s=30.0)
        for number in range(20):
            stamp = Stamp(START_NS + number)
            publisher.publish(TFMessage(transforms=[messages.transform_message(transform, stamp)]))
        received = listener.messages()
    assert [line["stamp_ns"] for line in received] == [START_NS + n for n in range(20)]
    assert {(line["parent"], line["child"]) for line in received} == {("tumor", "virtual_fixture")}
    for line in received:
        assert line["translation"] == [0.001, 0.02, -0.3]
        half = 0.5**0.5
        for value, wanted in zip(line["rotation"], [0.0, 0.0, half, half], strict=True):
            assert abs(value - wanted) < 1e-15
