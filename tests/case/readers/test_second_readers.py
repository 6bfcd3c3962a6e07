"""Recordings of trackers with images, read by SimpleITK or written by pynrrd."""

from collections.abc import Mapping
from pathlib import Path

import nrrd
import numpy as np
import pytest
import SimpleITK

from app.case import read_recording
from app.geometry import InputError
from tests.case.images.sequences import frame_fields, write_metafile

COUNT, WIDTH, HEIGHT = 6, 4, 3
FIELDS = frame_fields(COUNT, start_s=7417.5, period_s=0.05)
"""Header fields of frames at 20 Hz, as PLUS writes them."""
PIXELS = np.arange(COUNT * WIDTH * HEIGHT, dtype=np.uint8).reshape(COUNT, HEIGHT, WIDTH)


def metadata(path: Path) -> dict[str, str]:
    """The header as SimpleITK reads it."""
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
def test_metafile_has_the_values_that_simple_itk_reads(tmp_path, ending):
    path = write_metafile(tmp_path / f"probe{ending}", PIXELS, fields=FIELDS)
    header = metadata(path)
    pixels = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path)))
    np.testing.assert_array_equal(pixels, PIXELS)
    assert_read_as(path, header, COUNT, rounding=1e-8)


@pytest.mark.parametrize(
    ("name", "count"), [("ReferenceToRASCalibration", 93), ("SpinePhantomFreehand", 21)]
)
def test_real_metafile_has_the_values_that_simple_itk_reads(real_recording, name, count):
    path = real_recording(name)
    assert_read_as(path, metadata(path), count, rounding=5e-4)


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize("ending", [".igs.nrrd", ".igs.nhdr"])
def test_nrrd_of_pynrrd_is_read(tmp_path, ending, encoding):
    path = tmp_path / f"probe{ending}"
    nrrd.write(str(path), PIXELS.T, {**FIELDS, "encoding": encoding})
    header = {key: str(value) for key, value in nrrd.read_header(str(path)).items()}
    assert_read_as(path, header, COUNT, rounding=1e-8)


def test_nrrd_of_images_alone_is_no_recording(tmp_path):
    path = tmp_path / "probe.igs.nrrd"
    nrrd.write(str(path), PIXELS.T)
    with pytest.raises(InputError, match="is not a recording of a tracker"):
        list(read_recording(path, lambda note: None))
