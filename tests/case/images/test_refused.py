"""Sequences whose images cannot be used are refused with one line."""

from pathlib import Path

import numpy as np
import pytest

from app.case import ImageSequence, read_image_calibration
from app.geometry import ImageCalibration, InputError
from tests.case.images.sequences import PROBE_FROM_IMAGE, frame_fields, some_pixels, write_metafile


def refused(path: Path, orientation: str | None = None) -> str:
    """The one line with which the sequence at ``path`` is refused."""
    with pytest.raises(InputError) as caught, ImageSequence(path, orientation) as sequence:
        for _ in sequence:
            pass
    text = str(caught.value)
    assert "\n" not in text
    assert str(path) in text
    return text


def replaced(old: bytes, new: bytes):
    return lambda path: path.write_bytes(path.read_bytes().replace(old, new))


def damaged(path: Path) -> None:
    content = bytearray(path.read_bytes())
    begin = content.index(b"ElementDataFile = LOCAL\n") + 24
    content[begin + 2 :] = b"\xff" * len(content[begin + 2 :])
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("name", "edit", "expected"),
    [
        ("x.raw", lambda path: path.write_bytes(path.read_bytes()[:-1]),
         "x.raw has 209 bytes of pixels; expected 210: 5 images of 7 x 6"),
        ("x.raw", lambda path: path.write_bytes(path.read_bytes() + b"\0"),
         "x.raw has 211 bytes of pixels; expected 210: 5 images of 7 x 6"),
        ("x.raw", Path.unlink, "no such file"),
        ("x.igs.mhd", replaced(b"= x.raw", b"= ../x.raw"), "a relative path without '..'"),
        ("x.igs.mhd", replaced(b"= x.raw", b"= x%04d.raw 1 5 1"),
         "its images are in several files (x%04d.raw 1 5 1); expected one"),
        ("x.igs.mha", lambda path: path.write_bytes(path.read_bytes()[:-20]), "is cut"),
        ("x.igs.mha", damaged, "cut or damaged at image 0"),
        # As where images change their size: the pixels are not those of the declared size.
        ("x.igs.mha", replaced(b"DimSize = 7 6 5\n", b"DimSize = 7 6 50000\n"),
         "cannot hold 50000 images of 7 x 6"),
    ],
)  # fmt: skip
def test_pixels_that_are_cut_damaged_or_elsewhere(tmp_path, name, edit, expected):
    compressed = name == "x.igs.mha"
    path = tmp_path / (name if compressed else "x.igs.mhd")
    write_metafile(path, some_pixels(), compressed=compressed)
    edit(tmp_path / name)
    assert expected in refused(path)


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ({"DimSize": "0 0 5"}, "holds no images"),
        ({"DimSize": "7 6 2 5", "NDims": "4"}, "each image has 2 slices; expected 1"),
        ({"DimSize": "7 6 5", "NDims": "4"}, "NDims is '4' and DimSize has 3 numbers"),
        ({"DimSize": "7 -6 5"}, "dimsize is '7 -6 5'; expected integers"),
        ({"DimSize": "9000 6 5"}, "5 images of 9000 x 6; expected up to"),
        ({"ElementType": "MET_FLOAT"}, "1 values of type 'MET_FLOAT'; expected one of 8 or 16"),
        ({"ElementNumberOfChannels": "2"}, "2 values of type 'MET_UCHAR'"),
        ({"ElementNumberOfChannels": ""}, ""),
        ({"UltrasoundImageType": "RF_REAL"}, "'RF_REAL'; expected BRIGHTNESS, RGB_COLOR"),
        ({"UltrasoundImageOrientation": "QF"}, "orientation of its images is 'QF'; expected MF"),
        ({"BinaryData": "False"}, "its pixels are text"),
        ({"HeaderSize": "-1"}, "HeaderSize is '-1'"),
        ({"CompressedData": "maybe"}, "compresseddata is 'maybe'; expected True or False"),
    ],
)
def test_header_of_images_that_are_not_read(tmp_path, header, expected):
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(), header=header)
    if expected:
        assert expected in refused(path)
    else:  # an empty number of channels is none: one value
        with ImageSequence(path) as sequence:
            assert len(list(sequence)) == 5


def test_orientation_that_is_missing_or_contradicts(tmp_path):
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(), orientation=None)
    assert "lacks UltrasoundImageOrientation" in refused(path)
    path = write_metafile(tmp_path / "y.igs.mha", some_pixels(), orientation="UF")
    assert "is UF; expected no other (MF)" in refused(path, "MF")


def test_two_transforms_that_contradict_give_no_place(tmp_path):
    known = frame_fields(5)
    fields = frame_fields(
        5,
        **{
            f"Seq_Frame000{number}_ProbeTransform": known[
                f"Seq_Frame000{number}_{other}ToTrackerTransform"
            ]
            for number, other in ((1, "Probe"), (2, "Reference"))
        },
    )
    path = write_metafile(tmp_path / "x.igs.mha", some_pixels(), fields=fields)
    calibration = ImageCalibration("probe", PROBE_FROM_IMAGE)
    with ImageSequence(path) as sequence:
        problems = [sequence.pose(n, calibration, "reference").problem for n in (1, 2)]
    assert problems == ["", "image 2: tracker -> probe is INVALID"]


def test_calibration_is_read_from_a_configuration_and_from_transform_files(tmp_path):
    matrix = PROBE_FROM_IMAGE.copy()
    numbers = " ".join(map(str, matrix.ravel()))
    files = {
        "plus.xml": '<PlusConfiguration version="2.1"><CoordinateDefinitions><Transform '
        f'From="Image" To="Probe" Matrix="{numbers}"/></CoordinateDefinitions>'
        "</PlusConfiguration>",
        "image.txt": numbers,
        "image.yaml": f"source: image\ntarget: probe\nmatrix: {matrix.ravel().tolist()}\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
        found = read_image_calibration(tmp_path / name, "probe")
        np.testing.assert_array_equal(found.matrix, matrix)
    with pytest.raises(InputError, match="has no ImageToNeedle; it has ImageToProbe"):
        read_image_calibration(tmp_path / "plus.xml", "needle")


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        ((0, 0, 0), "a pixel measures 0 x"),
        ((20, 0, 0), "a pixel measures 20 x"),
        ((0.08, 0, 0), "degrees from a right angle"),
        ((np.nan, 0, 0), "expected 16 finite numbers"),
    ],
)
def test_matrix_that_is_no_calibration(column, expected):
    matrix = PROBE_FROM_IMAGE.copy()
    matrix[:3, 0] = column
    matrix[:3, 1] = (0.08, 0.001, 0)
    with pytest.raises(InputError, match=expected):
        ImageCalibration("probe", matrix)
