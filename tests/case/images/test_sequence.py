"""Images of sequences as SimpleITK and pynrrd decode them, and their corners by plain matrices."""

from pathlib import Path

import nrrd
import numpy as np
import pytest
import SimpleITK
from numpy.typing import NDArray

from app.case import ImageSequence, read_image_calibration
from app.case.images.image_layout import ORIENTATIONS
from app.geometry import ImageCalibration, ImageStatus, image_corners
from tests.case.images.sequences import (
    PROBE_FROM_IMAGE,
    frame_fields,
    some_pixels,
    write_metafile,
    write_nrrd,
)

PROBE = ImageCalibration("probe", PROBE_FROM_IMAGE)
PLUS_CONFIG = "PlusDeviceSet_SpinePhantomFreehandReconstructionOnly.xml"


def by_simple_itk(path: Path) -> tuple[NDArray[np.generic], dict[str, str]]:
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(str(path))
    pixels = SimpleITK.GetArrayFromImage(reader.Execute())
    return pixels, {key: reader.GetMetaData(key) for key in reader.GetMetaDataKeys()}


def assert_decoded(path: Path, expected: NDArray[np.generic]) -> None:
    """All images of ``path`` in order, then some of them in another order."""
    with ImageSequence(path) as sequence:
        assert len(sequence) == len(expected)
        for image in sequence:
            assert image.pixels is not None
            assert image.pixels.dtype == expected.dtype
            np.testing.assert_array_equal(image.pixels, expected[image.number])
        last = len(expected) - 1
        for number in (0, last, last // 2, min(last, last // 2 + 1), min(last, 1), last):
            np.testing.assert_array_equal(sequence.image(number).pixels, expected[number])


def assert_corners(path, header, matrix, calibration):
    """Corners in ``reference`` against a product of the printed matrices, solved by NumPy."""
    with ImageSequence(path) as sequence:
        right, below = sequence.size[0] - 1, sequence.size[1] - 1
        pixels = np.array([(0, 0), (right, 0), (right, below), (0, below)], dtype=float)
        pixels = np.column_stack([pixels, np.zeros(4), np.ones(4)])
        for number in range(len(sequence)):
            probe, reference = (
                np.array(
                    header[f"Seq_Frame{number:04d}_{name}ToTrackerTransform"].split(), dtype=float
                ).reshape(4, 4)
                for name in ("Probe", "Reference")
            )
            expected = np.linalg.solve(reference, probe @ matrix @ pixels.T)[:3].T
            pose = sequence.pose(number, calibration, "reference")
            assert (pose.matrix is not None, pose.problem) == (True, "")
            np.testing.assert_allclose(
                image_corners(pose.matrix, *sequence.size), expected, rtol=0, atol=1e-6
            )


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("ending", [".igs.mha", ".igs.mhd"])
@pytest.mark.parametrize(
    ("kind", "channels"), [("uint8", 1), ("uint16", 1), ("int16", 1), ("uint8", 3)]
)
def test_metafile_has_the_pixels_that_simple_itk_decodes(
    tmp_path, ending, compressed, big_endian, kind, channels
):
    path = write_metafile(
        tmp_path / f"probe{ending}",
        some_pixels(kind=kind, channels=channels),
        compressed=compressed,
        big_endian=big_endian,
    )
    pixels, _ = by_simple_itk(path)
    np.testing.assert_array_equal(pixels, some_pixels(kind=kind, channels=channels))
    assert_decoded(path, pixels)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(("kind", "channels"), [("uint8", 1), ("int16", 1), ("uint8", 3)])
def test_nrrd_has_the_pixels_that_pynrrd_decodes(tmp_path, compressed, kind, channels):
    path = write_nrrd(
        tmp_path / "x.igs.nrrd", some_pixels(kind=kind, channels=channels), compressed=compressed
    )
    assert_decoded(path, nrrd.read(str(path), index_order="C")[0])


def test_many_compressed_images_are_read_in_any_order(tmp_path):
    pixels = some_pixels(count=300, rows=40, columns=50)
    path = write_metafile(tmp_path / "x.igs.mha", pixels, compressed=True)
    order = np.random.default_rng(1).permutation(300)[:60]
    with ImageSequence(path) as sequence:
        for number in order.tolist():
            np.testing.assert_array_equal(sequence.image(number).pixels, pixels[number])


def test_spine_phantom_has_the_pixels_and_corners_of_independent_programs(
    real_recording, shared_data
):
    path = real_recording("SpinePhantomFreehand")
    pixels, header = by_simple_itk(path)
    assert pixels.shape == (21, 616, 820)
    assert_decoded(path, pixels)
    config = shared_data / "plus" / PLUS_CONFIG
    start = config.read_text().split('Matrix="')[1]
    matrix = np.array(start.split('"')[0].split(), dtype=float).reshape(4, 4)
    assert_corners(path, header, matrix, read_image_calibration(config, "probe"))


def test_generated_sequence_has_the_pixels_and_corners_of_independent_programs(tmp_path):
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(), compressed=True)
    pixels, header = by_simple_itk(path)
    assert_decoded(path, pixels)
    assert_corners(path, header, PROBE_FROM_IMAGE, PROBE)


@pytest.mark.parametrize(
    ("name", "shape", "kind"),
    [("NrrdSample", (256, 256), "int16"), ("ColorNrrdSample", (648, 1152, 3), "uint8")],
)
def test_samples_of_plus_have_the_pixels_that_pynrrd_decodes(shared_data, name, shape, kind):
    path = shared_data / "plus" / f"{name}.igs.nrrd"
    expected = nrrd.read(str(path), index_order="C")[0]
    assert (expected.shape, expected.dtype.name) == (shape, kind)
    assert_decoded(path, expected[None])
    with ImageSequence(path) as sequence:
        assert sequence.image(0).stamp is None
        pose = sequence.pose(0, PROBE, "reference")
        assert (pose.matrix, pose.problem) == (None, "image 0 has no Timestamp")


@pytest.mark.parametrize("letters", [*ORIENTATIONS, "MFA", "UFD"])
def test_orientation_is_normalised_to_marked_and_far(tmp_path, letters):
    """Each pixel of a stored image holds its coordinate along the marked and the far direction."""
    columns, rows = 7, 6  # of the image in MF
    far, marked = np.mgrid[:rows, :columns].astype(np.uint8)
    standard = 16 * far + marked
    along = {"M": marked, "U": columns - 1 - marked, "F": far, "N": rows - 1 - far}
    sideways = letters[0] in "FN"
    stored = np.zeros((columns, rows) if sideways else (rows, columns), np.uint8)
    # Column and row of the stored image rise in the directions of the letters.
    stored[along[letters[1]], along[letters[0]]] = standard
    path = write_metafile(tmp_path / "x.igs.mha", stored[None], orientation=letters)
    with ImageSequence(path) as sequence:
        assert sequence.size == (columns, rows)
        np.testing.assert_array_equal(sequence.image(0).pixels, standard)


def test_orientation_that_the_file_lacks_is_given(tmp_path):
    pixels = some_pixels(1)
    path = write_metafile(tmp_path / "x.igs.mha", pixels, orientation=None)
    with ImageSequence(path, "UF") as sequence:
        np.testing.assert_array_equal(sequence.image(0).pixels, pixels[0, :, ::-1])


def test_invalid_image_has_no_pixels_and_no_place(tmp_path):
    fields = frame_fields(5, Seq_Frame0002_ImageStatus="INVALID")
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(), fields=fields)
    with ImageSequence(path) as sequence:
        image = sequence.image(2)
        assert (image.status, image.pixels) == (ImageStatus.INVALID, None)
        assert sequence.pose(2, PROBE, "reference").problem == "image 2 has status INVALID"
        assert sequence.image(3).status is ImageStatus.OK


def test_image_without_its_pose_has_no_place(tmp_path):
    fields = frame_fields(5, Seq_Frame0001_ProbeToTrackerTransformStatus="OUT_OF_VIEW")
    del fields["Seq_Frame0003_ReferenceToTrackerTransform"]
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(), fields=fields)
    with ImageSequence(path) as sequence:
        problems = [sequence.pose(n, PROBE, "reference").problem for n in range(5)]
    assert problems == [
        "",
        "image 1: tracker -> probe is OUT_OF_VIEW",
        "",
        "image 3: no pose connects 'reference' with 'probe'",
        "",
    ]


def test_poses_without_images_are_counted(tmp_path):
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(3), fields=frame_fields(5))
    with ImageSequence(path) as sequence:
        assert (len(sequence), sequence.header.spare) == (3, 2)
