import json
from pathlib import Path

import numpy as np
import pytest

from app.files import read_landmarks
from app.files.landmarks import read_points
from app.geometry import InputError


def markups(folder: Path, **changes: object) -> Path:
    """Write a point list as 3D Slicer does: positions in LPS, one point not placed."""
    markup = {
        "type": "Fiducial",
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "controlPoints": [
            {"label": "F-1", "position": [-1.0, -2.0, 3.0], "positionStatus": "defined"},
            {"label": "F-2", "position": [10.0, 0.0, 0.5], "positionStatus": "defined"},
            {"label": "F-3", "position": [0.0, 0.0, 0.0], "positionStatus": "undefined"},
        ],
    } | changes
    path = folder / "points.mrk.json"
    path.write_text(json.dumps({"markups": [markup]}))
    return path


def test_markups_in_lps_are_converted_to_ras(tmp_path):
    found = read_landmarks(markups(tmp_path))
    assert list(found) == ["F-1", "F-2"]
    np.testing.assert_array_equal(found["F-1"], [1.0, 2.0, 3.0])
    again = read_landmarks(markups(tmp_path, coordinateSystem="RAS"))
    np.testing.assert_array_equal(again["F-1"], [-1.0, -2.0, 3.0])


def check_with_slicer(node, storage, path: Path) -> None:
    assert storage.ReadData(node)
    found = read_landmarks(path)
    assert list(found) == ["F-1", "F-2"]
    for index, (name, position) in enumerate(found.items()):
        assert node.GetNthControlPointLabel(index) == name
        np.testing.assert_allclose(node.GetNthControlPointPosition(index), position)


@pytest.mark.parametrize("axes", ["LPS", "RAS", None])
def test_markups_agree_with_slicer(tmp_path, slicer_node, axes):
    """Without a coordinate system a file is in LPS."""
    path = markups(tmp_path, coordinateSystem=axes)
    if axes is None:
        path.write_text(path.read_text().replace('"coordinateSystem": null, ', ""))
        assert "coordinateSystem" not in path.read_text()
    kinds = "vtkMRMLMarkupsFiducialNode", "vtkMRMLMarkupsJsonStorageNode"
    check_with_slicer(*slicer_node(*kinds, path), path)


FIDUCIALS = """\
# Markups fiducial file version = 4.11
# CoordinateSystem = {axes}
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
1,-1.0,-2.0,3.0,0.0,0.0,0.0,1.0,1,1,0,F-1,,
2,10.0,0.0,0.5,0.0,0.0,0.0,1.0,1,1,0,F-2,"a, b",
"""


@pytest.mark.parametrize("axes", ["LPS", "RAS", "0", "1"])
def test_fiducial_tables_agree_with_slicer(tmp_path, slicer_node, axes):
    path = tmp_path / "points.fcsv"
    path.write_text(FIDUCIALS.format(axes=axes))
    kinds = "vtkMRMLMarkupsFiducialNode", "vtkMRMLMarkupsFiducialStorageNode"
    check_with_slicer(*slicer_node(*kinds, path), path)


def test_malformed_tables_are_refused(tmp_path):
    path = tmp_path / "points.fcsv"
    good = FIDUCIALS.format(axes="LPS")
    for text, message in (
        (good.replace("LPS", "IJK"), "expected RAS or LPS"),
        (good.replace("# CoordinateSystem = LPS\n", ""), "is not a Slicer fiducial file"),
        (good.replace("id,x,y,z", "id,z,y,x"), "is not a Slicer fiducial file"),
        (good.replace("10.0", "ten"), "the row '2,ten,.*: 'ten' is not a number"),
        (good.replace("10.0", "1_0"), "'1_0' is not a number"),
        # A reader that continues to the next quotation mark would drop a point.
        (good.replace("F-1,,", '"F-1,,'), "row 1 is not a point"),
        (good.replace("F-1,,", "F" * 200_000), "row 1 is not a point: field larger"),
        (good.replace("10.0", "nan"), "'F-2' is at .*finite"),
        (good[: good.index("2,10.0")] + "2,1.0\n", "the row '2,1.0' is not a point"),
        (good[: good.index("1,-1.0")], "holds no landmarks"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_landmarks(path)


def test_points_may_have_empty_and_duplicate_names(tmp_path):
    points = [{"label": "", "position": [1.0, 2.0, 3.0]}] * 2
    path = markups(tmp_path, controlPoints=points)
    assert [(name, p.tolist()) for name, p in read_points(path)] == [("", [-1.0, -2.0, 3.0])] * 2
    with pytest.raises(InputError, match="landmark 0 has no name"):
        read_landmarks(path)


def test_yaml_landmarks_keep_the_order_of_the_file(tmp_path):
    path = tmp_path / "phantom.yaml"
    path.write_text(
        "landmarks:\n- {name: B, position_mm: [1, 2, 3]}\n- {name: A, position_mm: [4, 5, 6]}"
    )
    assert list(read_landmarks(path)) == ["B", "A"]


POINT = "{name: A, position_mm: [1, 2, 3]}"


@pytest.mark.parametrize(
    ("landmarks", "message"),
    [
        ("[]", "holds no landmarks"),
        ("[{name: A, position: [1, 2, 3]}]", "position is unknown"),
        ("[{name: A, position_mm: [1, 2]}]", "expected a list of 3 numbers"),
        (f"[{POINT}, {POINT}]", "occurs twice"),
    ],
)
def test_malformed_yaml_is_refused(tmp_path, landmarks, message):
    path = tmp_path / "phantom.yml"
    path.write_text(f"landmarks: {landmarks}")
    with pytest.raises(InputError, match=message):
        read_landmarks(path)


def test_malformed_markups_are_refused(tmp_path):
    for changes, message in (
        ({"coordinateSystem": "IJK"}, "expected RAS or LPS"),
        ({"coordinateUnits": "cm"}, "expected mm"),
        ({"controlPoints": []}, "holds no landmarks"),
        ({"controlPoints": [{"label": "A"}]}, "is not a Slicer markups file: KeyError 'position'"),
        ({"controlPoints": [{"label": "A", "position": None}]}, "is not a Slicer markups file"),
        ({"controlPoints": [{"label": "A", "position": "123"}]}, "expected a list of numbers"),
        (
            {"controlPoints": [{"label": "A", "position": [True, 2, 3]}]},
            "expected a list of numbers",
        ),
        ({"controlPoints": [{"label": "A", "position": [1, 2, 10**400]}]}, "too large"),
    ):
        with pytest.raises(InputError, match=message):
            read_landmarks(markups(tmp_path, **changes))
    path = tmp_path / "broken.mrk.json"
    twice = '{"markups": [{"coordinateSystem": "LPS", "coordinateSystem": "RAS"}]}'
    for text in ("{", "[]", '{"markups": []}', twice):
        path.write_text(text)
        with pytest.raises(InputError):
            read_landmarks(path)
    with pytest.raises(InputError, match="duplicate name among coordinateSystem"):
        read_landmarks(path)
    with pytest.raises(InputError, match="is not a landmark file"):
        read_landmarks(tmp_path / "points.csv")
