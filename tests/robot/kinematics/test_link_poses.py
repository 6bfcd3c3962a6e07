"""Link poses as a read-only mapping."""

import numpy as np
import pytest

from app.robot.kinematics.link_poses import LinkPoses


def test_mapping_returns_the_pose_of_each_link() -> None:
    quarter = [[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0], [0.0] * 3 + [1.0]]
    poses = LinkPoses("base", {"base": 0, "arm": 1}, np.array([np.eye(4), quarter]))
    assert (list(poses), len(poses), "leg" in poses) == (["base", "arm"], 2, False)
    assert (poses["arm"].target, poses["arm"].source) == ("base", "arm")
    assert poses["arm"].apply([1.0, 0.0, 0.0]).tolist() == [1.0, 3.0, 3.0]
    assert {link: pose.translation_mm.tolist() for link, pose in poses.items()} == {
        "base": [0.0, 0.0, 0.0],
        "arm": [1.0, 2.0, 3.0],
    }
    with pytest.raises(ValueError, match="read-only"):
        poses["arm"].rotation[0, 0] = 1.0
    with pytest.raises(KeyError, match="leg"):
        poses["leg"]
