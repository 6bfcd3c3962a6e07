"""``marginguard record`` refuses bad input before it writes anything."""

import pytest

from app.cli.main import main

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("topic", ["", "tf", "/", "/tf/", "/a b", "/1a", "/tf\n"])
def test_invalid_topic_is_refused(tmp_path, capsys, topic):
    assert main(["record", "-o", str(tmp_path / "new"), "--topics", "/tf", topic]) == 2
    assert (
        f"--topics is {topic!r}; expected a topic that begins with '/'" in capsys.readouterr().err
    )
    assert list(tmp_path.iterdir()) == []


def test_name_that_ros_refuses_leaves_no_case(domain_id, project_root, tmp_path, capsys):
    config = project_root / "data" / "live_example" / "live.yaml"
    command = ["record", "-o", str(tmp_path / "new"), "--config", str(config)]
    assert main([*command, "--namespace", "a b"]) == 2
    assert "namespace" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
