"""Recordings of trackers with images, read by SimpleITK or written by pynrrd."""

from collections.abc import Callable, Mapping
from pathlib import Path

import nrrd
import numpy as np
import pytest
import SimpleITK

from app.case import read_recording
from app.geometry import InputError
from tests.case.images.sequences import frame_fields

COUNT, WIDTH, HEIGHT = 6, 4, 3
PIXELS = np.arange(COUNT * WIDTH * HEIGHT, dtype=np.uint8).reshape(COUNT, HEIGHT, WIDTH)


def fields() -> dict[str, str]:
    """Header fields of frames at 20 Hz, as PLUS writes them."""
    return frame_fields(COUNT, start_s=7417.5, period_s=0.05)


def metafile(path: Path) -> Path:
    """``.igs.mha`` with its pixels, or ``.igs.mhd`` with a file beside it."""
    header = {
        "ObjectType": "Image",
        "NDims": "3",
        "BinaryData": "True",
        "CompressedData": "False",
        "ElementSpacing": "1 1 1",
        "DimSize": f"{WIDTH} {HEIGHT} {COUNT}",
        "ElementType": "MET_UCHAR",
        **fields(),
        "ElementDataFile": "LOCAL" if path.suffix == ".mha" else "pixels.raw",
    }
    text = "".join(f"{key} = {value}\n" for key, value in header.items()).encode()
    path.write_bytes(text + (PIXELS.tobytes() if path.suffix == ".mha" else b""))
    (path.parent / "pixels.raw").write_bytes(PIXELS.tobytes())
    return path


def by_simple_itk(path: Path) -> dict[str, str]:
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(str(path))
    reader.ReadImageInformation()
    return {key: reader.GetMetaData(key) for key in reader.GetMetaDataKeys()}


def assert_read_as(path: Path, header: Mapping[str, str], count: int, *, rounding: float) -> None:
    """Every pose of every frame equals that of ``header``, within its printed digits."""
    notes: list[str] = []
    frames = list(read_recording(path, notes.append))
    assert (len(frames), notes) == (count, [])
    for n, frame in enumerate(frames):
        time_s = float(header[f"Seq_Frame{n:04d}_Timestamp"])
        assert abs(frame.stamp.ns - time_s * 1e9) < 1000  # rounding of a double at 7417 s
        for sample in frame.poses:
            key = f"Seq_Frame{n:04d}_{sample.source.capitalize()}ToTrackerTransform"
            expected = np.array(header[key].split(), dtype=float).reshape(4, 4)
            assert (sample.status.name, sample.target) == (header[f"{key}Status"], "tracker")
            assert sample.transform is not None
            np.testing.assert_array_equal(sample.transform.translation_mm, expected[:3, 3])
            # The reader projects the printed, rounded matrix to the nearest rotation.
            np.testing.assert_allclose(sample.transform.matrix, expected, rtol=0, atol=rounding)


@pytest.mark.parametrize("ending", [".igs.mha", ".igs.mhd"])
def test_metafile_has_the_values_that_simple_itk_reads(tmp_path: Path, ending: str) -> None:
    path = metafile(tmp_path / f"probe{ending}")
    header = by_simple_itk(path)
    pixels = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path)))
    np.testing.assert_array_equal(pixels, PIXELS)
    assert_read_as(path, header, COUNT, rounding=1e-8)


@pytest.mark.parametrize(
    ("name", "count"), [("ReferenceToRASCalibration", 93), ("SpinePhantomFreehand", 21)]
)
def test_real_metafile_has_the_values_that_simple_itk_reads(
    real_recording: Callable[[str], Path], name: str, count: int
) -> None:
    path = real_recording(name)
    assert_read_as(path, by_simple_itk(path), count, rounding=5e-4)


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize("ending", [".igs.nrrd", ".igs.nhdr"])
def test_nrrd_of_pynrrd_is_read(tmp_path: Path, ending: str, encoding: str) -> None:
    path = tmp_path / f"probe{ending}"
    nrrd.write(str(path), PIXELS.T, {**fields(), "encoding": encoding})
    header = {key: str(value) for key, value in nrrd.read_header(str(path)).items()}
    assert_read_as(path, header, COUNT, rounding=1e-8)


def test_nrrd_of_images_alone_is_no_recording(tmp_path: Path) -> None:
    path = tmp_path / "probe.igs.nrrd"
    nrrd.write(str(path), PIXELS.T)
    with pytest.raises(InputError, match="is not a recording of a tracker"):
        list(read_recording(path, lambda note: None))
