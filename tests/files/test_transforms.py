import numpy as np
import pytest
import SimpleITK
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from app.files import check_transform_path, read_transform, write_transform
from app.geometry import InputError, Transform

TIP_TO_STYLUS = Transform.from_rotation_vector(
    [0.3, -0.7, 1.1], [12.5, -40.25, 77.0], target="stylus", source="stylus_tip"
)


LINEAR = "vtkMRMLLinearTransformNode", "vtkMRMLTransformStorageNode"


@pytest.fixture
def matrix4x4():
    return pytest.importorskip("vtkmodules.vtkCommonMath").vtkMatrix4x4()


@pytest.mark.parametrize("ending", [".tfm", ".txt"])
def test_slicer_reads_the_written_matrix(tmp_path, slicer_node, matrix4x4, ending):
    path = tmp_path / f"StylusTipToStylus{ending}"
    write_transform(path, TIP_TO_STYLUS, "pivot, 100 poses:\nsigma 0.1 mm")
    node, storage = slicer_node(*LINEAR, path)
    assert storage.ReadData(node), "Slicer refused the file"
    node.GetMatrixTransformToParent(matrix4x4)
    found = [[matrix4x4.GetElement(i, j) for j in range(4)] for i in range(4)]
    np.testing.assert_allclose(found, TIP_TO_STYLUS.matrix, atol=1e-12)


def test_file_of_slicer_with_a_centre_of_rotation_is_read(tmp_path, slicer_node, matrix4x4):
    path = tmp_path / "theirs.tfm"
    node, storage = slicer_node(*LINEAR, path)
    matrix4x4.DeepCopy(TIP_TO_STYLUS.matrix.ravel().tolist())
    node.SetMatrixTransformToParent(matrix4x4)
    assert storage.WriteData(node)
    assert "FixedParameters: 0 0 0" not in path.read_text(), "Slicer wrote no centre"
    back = read_transform(path, target="stylus", source="stylus_tip")
    np.testing.assert_allclose(back.matrix, TIP_TO_STYLUS.matrix, atol=1e-12)


def test_simple_itk_maps_points_by_the_written_matrix(tmp_path):
    """ITK stores the transform from the parent, in LPS."""
    path = tmp_path / "StylusTipToStylus.tfm"
    write_transform(path, TIP_TO_STYLUS)
    itk = SimpleITK.ReadTransform(str(path))
    flip = np.diag([-1.0, -1.0, 1.0])
    for at in np.random.default_rng(1).normal(0.0, 100.0, (10, 3)):
        found = flip @ itk.TransformPoint((flip @ TIP_TO_STYLUS.apply(at)).tolist())
        np.testing.assert_allclose(found, at, rtol=0, atol=1e-9)


@settings(max_examples=50)
@given(
    vector=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    shift=st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
    ending=st.sampled_from([".yaml", ".yml", ".tfm", ".txt"]),
)
def test_transform_survives_a_round_trip(tmp_path_factory, vector, shift, ending):
    path = tmp_path_factory.mktemp("transform") / f"t{ending}"
    pose = Transform.from_rotation_vector(vector, shift, target="a", source="b")
    write_transform(path, pose)
    back = read_transform(path, target="a", source="b")
    np.testing.assert_allclose(back.matrix, pose.matrix, atol=1e-9)
    assert (back.target, back.source) == ("a", "b")


def test_yaml_holds_frames_that_are_checked(tmp_path):
    path = tmp_path / "tip.yaml"
    write_transform(path, TIP_TO_STYLUS, "a note")
    document = yaml.safe_load(path.read_text())
    assert document["transform"] == "StylusTipToStylus"
    np.testing.assert_array_equal(np.reshape(document["matrix"], (4, 4)), TIP_TO_STYLUS.matrix)
    with pytest.raises(InputError, match="target is 'stylus'; expected 'probe'"):
        read_transform(path, target="probe", source="stylus_tip")


def test_sixteen_numbers_are_read_as_a_matrix(tmp_path):
    path = tmp_path / "matrix.txt"
    np.savetxt(path, TIP_TO_STYLUS.matrix)
    back = read_transform(path, target="stylus", source="stylus_tip")
    np.testing.assert_allclose(back.matrix, TIP_TO_STYLUS.matrix, atol=1e-12)


AFFINE = "#Insight Transform File V1.0\nTransform: AffineTransform_double_3_3\n"
UNTURNED = "Parameters: 1 0 0 0 1 0 0 0 1"


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.txt", "1 2 3", "has 3 numbers; expected 16"),
        ("a.txt", "1 " * 15 + "x", "'x' is not a number"),
        ("a.txt", "1 0 0 1_0 0 1 0 0 0 0 1 0 0 0 0 1", "'1_0' is not a number"),
        ("a.txt", "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1", "not orthonormal"),
        ("a.txt", "nan 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "not finite"),
        ("a.tfm", "#Insight Transform File V1.0\nTransform: BSpline\n", "holds BSpline"),
        ("a.tfm", "#Insight Transform File V1.0\n", "holds nothing"),
        ("a.tfm", f"{AFFINE}Parameters: 2 0 0 0 1 0 0 0 1 0 0 0\nFixedParameters: 0 0 0\n",
         "not orthonormal"),
        ("a.tfm", f"{AFFINE}{UNTURNED} 0 0 0\nFixedParameters: 0 0 0\n{UNTURNED} 9 9 9\n",
         "in 4 fields; .* no field twice"),
        ("a.tfm", f"{AFFINE}Parameters: 0 -1 0 1 0 0 0 0 1 0 0 0\nFixedParameters: 1e300 0 0\n",
         "the centre, FixedParameters, is .* expected coordinates of at most"),
        ("a.yaml", "matrix: [1, 2]", "2 values; expected a list of 16 numbers"),
        ("a.yaml", "matrx: 1", "matrx is unknown"),
    ],
)  # fmt: skip
def test_malformed_transform_is_refused(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_transform(path, target="a", source="b")


def test_unusable_paths_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"expected \.yaml, \.yml, \.tfm, \.txt"):
        check_transform_path(tmp_path / "pose.h5")
    for path in (tmp_path / "no" / "pose.tfm", tmp_path):
        with pytest.raises(InputError):
            check_transform_path(path)
    (tmp_path / "pose.tfm").mkdir()
    with pytest.raises(InputError, match="is a directory"):
        write_transform(tmp_path / "pose.tfm", TIP_TO_STYLUS)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_transform(tmp_path / "none.txt", target="a", source="b")


def test_earlier_file_is_replaced_without_leftovers(tmp_path):
    path = tmp_path / "pose.tfm"
    path.write_text("old")
    write_transform(path, TIP_TO_STYLUS)
    assert [entry.name for entry in tmp_path.iterdir()] == ["pose.tfm"]
    assert path.read_text().startswith("#Insight Transform File V1.0\n")
