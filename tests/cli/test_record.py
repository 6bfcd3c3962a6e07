"""``marginguard record`` refuses bad input before it writes anything."""

import pytest

from tests.cli.command import refused, run

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("topic", ["", "tf", "/", "/tf/", "/a b", "/1a", "/tf\n"])
def test_invalid_topic_is_refused(tmp_path, topic):
    error = refused("record", "-o", tmp_path / "new", "--topics", "/tf", topic)
    assert f"--topics is {topic!r}; expected a topic that begins with '/'" in error
    assert list(tmp_path.iterdir()) == []


def test_name_that_ros_refuses_leaves_no_case(domain_id, project_root, tmp_path):
    config = project_root / "data" / "live_example" / "live.yaml"
    options = ("-o", tmp_path / "new", "--config", config, "--namespace", "a b")
    assert "namespace" in run("record", *options, status=2).err
    assert list(tmp_path.iterdir()) == []
