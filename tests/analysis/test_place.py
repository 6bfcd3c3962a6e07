import numpy as np
import pytest

from app.analysis.place import checked_axes, direction_name, principal_direction, tool_part
from app.geometry import InputError

FLIPPED = np.diag([-1.0, -1.0, 1.0])
"""The tumour's axes are left, posterior and superior."""


@pytest.mark.parametrize(
    ("direction", "axes", "name", "side"),
    [
        ((1.0, 0.0, 0.0), None, "+x", "+x"),
        ((0.1, -2.0, 1.2), None, "-y+z", "-y"),
        ((1.0, 0.0, 0.0), np.eye(3), "right", "right"),
        ((1.0, 0.0, 0.0), FLIPPED, "left", "left"),
        ((0.0, -2.0, 1.2), FLIPPED, "anterior-superior", "anterior"),
        ((0.0, 0.0, 0.0), None, "", ""),
    ],
)
def test_direction_is_named_by_its_axes(direction, axes, name, side):
    assert direction_name(np.array(direction), axes) == name
    assert principal_direction(np.array(direction), axes) == side


@pytest.mark.parametrize("matrix", [np.eye(4), np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3)])
def test_axes_that_are_no_rotation_are_refused(matrix):
    with pytest.raises(InputError, match="expected"):
        checked_axes(matrix)


def test_part_of_the_tool_depends_on_the_distance_from_its_tip():
    assert tool_part(np.array([0.0, 0.0, -1.0])) == "tip"
    assert tool_part(np.array([2.0, 0.0, -19.0])) == "shaft"
    assert tool_part(np.full(3, np.nan)) == ""
