"""ITK's HDF5 transforms, compared with h5py arithmetic and with SimpleITK as a second reader."""

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest
import SimpleITK
from scipy.spatial.transform import Rotation

from app.files import read_transform
from app.files.transforms import read_hdf5_matrices
from app.geometry import InputError

pytestmark = pytest.mark.slow

FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])


def rotation(seed: int) -> np.ndarray:
    return Rotation.random(rng=np.random.default_rng(seed)).as_matrix()


def itk_transform(seed: int) -> SimpleITK.AffineTransform:
    rng = np.random.default_rng(seed)
    transform = SimpleITK.AffineTransform(3)
    transform.SetMatrix(rotation(seed).ravel().tolist())
    transform.SetTranslation(rng.normal(0.0, 200.0, 3).tolist())
    transform.SetCenter(rng.normal(0.0, 50.0, 3).tolist())
    return transform


AFFINE = "AffineTransform_double_3_3"


def written(path: Path, kind: str = AFFINE, **changes: object) -> Path:
    """A file as ITK lays it out, written by h5py."""
    values = {
        "TransformParameters": np.append(rotation(3).ravel(), [1.0, 2.0, 3.0]),
        "TransformFixedParameters": np.zeros(3),
        **changes,
    }
    with h5py.File(path, "w") as file:
        group = file.create_group("TransformGroup/0")
        group["TransformType"] = [kind]
        for name, value in values.items():
            if value is not None:
                group[name] = value
    return path


def read(path: Path) -> np.ndarray:
    return read_transform(path, target="reference", source="needle").matrix


def read_all(paths: Sequence[Path]) -> list[np.ndarray]:
    """The matrices of several files, read by one process."""
    return read_hdf5_matrices([path.read_bytes() for path in paths], [path.name for path in paths])


def test_files_of_itk_equal_h5py_arithmetic(tmp_path):
    paths = [tmp_path / f"{seed}.h5" for seed in range(3)]
    for seed, path in enumerate(paths):
        SimpleITK.WriteTransform(itk_transform(seed), str(path))
    found = read_all(paths)
    for path, matrix in zip(paths, found, strict=True):
        with h5py.File(path) as file:
            numbers = file["TransformGroup/0/TransformParameters"][()]
            centre = file["TransformGroup/0/TransformFixedParameters"][()]
        stored = np.eye(4)
        stored[:3, :3] = numbers[:9].reshape(3, 3)
        stored[:3, 3] = numbers[9:] + centre - stored[:3, :3] @ centre
        expected = FLIP @ np.linalg.inv(stored) @ FLIP
        np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-9)


def test_simpleitk_maps_points_alike(tmp_path):
    """ITK maps a point of the parent, in LPS, to the node: the inverse of Slicer's matrix."""
    path = tmp_path / "t.h5"
    SimpleITK.WriteTransform(itk_transform(7), str(path))
    reader, matrix = SimpleITK.ReadTransform(str(path)), read(path)
    for point in np.random.default_rng(0).normal(0.0, 100.0, (20, 3)):
        in_node = np.linalg.inv(matrix) @ np.append(point, 1.0)
        mapped = reader.TransformPoint((FLIP[:3, :3] @ point).tolist())
        np.testing.assert_allclose(FLIP[:3, :3] @ mapped, in_node[:3], rtol=0, atol=1e-9)


def test_text_of_the_same_transform_gives_the_same_matrix(tmp_path):
    for name in ("t.h5", "t.tfm"):
        SimpleITK.WriteTransform(itk_transform(5), str(tmp_path / name))
    np.testing.assert_allclose(read(tmp_path / "t.h5"), read(tmp_path / "t.tfm"), atol=1e-9)


def test_misspelt_names_of_older_itk_are_read(tmp_path):
    new, old = written(tmp_path / "new.h5"), tmp_path / "old.h5"
    with h5py.File(new) as file:
        numbers = file["TransformGroup/0/TransformParameters"][()]
    written(
        old,
        TransformParameters=None,
        TransformFixedParameters=None,
        TranformParameters=numbers,
        TranformFixedParameters=np.zeros(3),
    )
    np.testing.assert_array_equal(*read_all([new, old]))


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        ("Euler3DTransform_double_3_3", {}, "holds Euler3DTransform_double_3_3; expected one Aff"),
        (AFFINE, {"TransformParameters": np.zeros(1000)},
         "has 1000 values; expected 64 or fewer"),
        (AFFINE, {"TransformParameters": np.append(np.diag([2.0, 2, 2]).ravel(), [0, 0, 0])},
         "not orthonormal"),
        (AFFINE, {"TransformParameters": np.full(12, np.nan)}, "finite"),
        (AFFINE, {"TransformParameters": [1, 2]}, "expected floating point"),
        (AFFINE, {"TransformParameters": h5py.ExternalLink("/etc/passwd", "/x")},
         "it has no TransformParameters"),
    ],
)  # fmt: skip
def test_other_content_is_refused(tmp_path, kind, changes, message):
    path = written(tmp_path / "x.h5", kind, **changes)
    with pytest.raises(InputError, match=message) as error:
        read(path)
    assert str(path) in str(error.value) and str(error.value).isprintable()


def test_damaged_file_is_named(tmp_path):
    """The process that reads may even end: the first file without an answer is the damaged one."""
    good = written(tmp_path / "good.h5").read_bytes()
    damaged = bytearray(good)
    damaged[96:400] = bytes(304)
    with pytest.raises(InputError, match="second"):
        read_hdf5_matrices([good, bytes(damaged), good], ["first", "second", "third"])


def test_process_that_ends_is_an_error_that_names_its_file():
    with pytest.raises(
        InputError, match="first cannot be read: the HDF5 library ended with status -11"
    ):
        read_hdf5_matrices([b""], ["first"], ask=lambda request: (-11, b""))


def test_missing_h5py_names_the_extra(tmp_path, monkeypatch):
    path = written(tmp_path / "x.h5")
    monkeypatch.setattr("app.files.extras.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"h5py is not installed: run `pip install .*\[hdf5\]"):
        read(path)
