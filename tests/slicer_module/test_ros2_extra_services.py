"""Services of rosbag2's player and of turtlesim, served by a process with rclpy alone."""

import pytest

from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

pytest.importorskip("rosbag2_interfaces", reason="pip install ./interfaces_extra")

SERVED = {
    "Burst": ({"num_messages": 5}, {"actually_burst": 3}),
    "GetRate": ({}, {"rate": 1.5}),
    "IsPaused": ({}, {"paused": True}),
    "Pause": ({}, {}),
    "PlayNext": ({}, {"success": True}),
    "Resume": ({}, {}),
    "Seek": ({"time": {"sec": 7, "nanosec": 8}}, {"success": True}),
    "SetRate": ({"rate": 2.0}, {"success": True}),
    "Snapshot": ({}, {"success": True}),
    "SplitBagfile": ({}, {}),
    "TogglePaused": ({}, {}),
}


def test_player_answers_every_service(logic, node, peer):
    for kind, (request, reply) in SERVED.items():
        name = f"/rosbag2_player/{kind.lower()}"
        package = f"rosbag2_interfaces/srv/{kind}"
        peer("serve", name=name, type=package, reply=reply)
        client = node.CreateAndAddServiceClientNode(kind, name)
        assert client.GetROSType() == package
        assert client.SendAsyncRequest(request) == 1
        assert logic.WaitForServiceResponse(client, DEADLINE_S), client.GetLastError()
        response = client.GetLastResponse()
        for field, value in reply.items():
            getter = "".join(part.capitalize() for part in field.split("_"))
            assert getattr(response, f"Get{getter}")() == value
        assert peer("requests", name=name) == [{**peer("blank", type=package), **request}]
        assert node.RemoveAndDeleteServiceClientNode(name)


def test_request_is_filled_in_by_its_accessors(logic, node, peer):
    peer("serve", name="/seek", type="rosbag2_interfaces/srv/Seek", reply={"success": True})
    client = node.CreateAndAddServiceClientNode("vtkMRMLROS2ServiceClientSeekNode", "/seek")
    request = client.CreateBlankRequest()
    assert request.GetClassName() == "vtkRosbag2InterfacesSeekRequest"
    request.GetTime().SetSec(12)
    client.SendAsyncRequest(request)
    assert logic.WaitForServiceResponse(client, DEADLINE_S)
    assert client.GetLastResponse().GetSuccess() is True
    assert peer("requests", name="/seek") == [{"time": {"sec": 12, "nanosec": 0}}]
