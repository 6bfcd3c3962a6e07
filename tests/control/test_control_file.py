"""``control.yaml`` of an earlier version."""

import pytest
import yaml

from app.control.control_file import CONTROL, read_control
from app.files.document import Section
from app.geometry import InputError


def test_pose_of_the_tumour_of_an_earlier_version_is_refused_with_its_source(project_root):
    file = project_root / "data" / "worlds" / "lumpectomy" / "control.yaml"
    values = yaml.safe_load(file.read_text())
    assert read_control(Section(values, "control.yaml:", CONTROL, file.parent)).arm == values["arm"]
    values["tumor"] = {"frame": "needle", "pose": {"matrix": [1, 0, 0, 0] * 4}}
    message = "^control.yaml: tumor is gone; expected the tumour's pose from the guard's constraint"
    with pytest.raises(InputError, match=message):
        Section(values, "control.yaml:", CONTROL, file.parent)
