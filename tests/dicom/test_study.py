"""Structures written as DICOM and read by pydicom, highdicom and arithmetic of their own."""

import datetime
import io
import shutil
import subprocess

import highdicom as hd
import numpy as np
import pydicom
import pytest
import SimpleITK
import trimesh

from app.dicom import DicomStudy, Structure, dicom_study
from app.geometry import InputError, MeshError, SurfaceMesh
from tests.dicom.surfaces import ball, shell

pytestmark = pytest.mark.slow

BALL, SHELL = (20.0, -30.0, 40.0), (-10.0, 5.0, 60.0)
"""Centres in RAS."""


def make(**options: object) -> DicomStudy:
    structures = [Structure("tumor", ball(9.0, BALL)), Structure("shell", shell(8.0, 5.0, SHELL))]
    given = {"patient": "case^one", "version": "1.2", "voxel_mm": 0.5} | options
    return dicom_study(structures, **given)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def study() -> DicomStudy:
    return make()


def opened(study: DicomStudy, name: str) -> pydicom.Dataset:
    return pydicom.dcmread(io.BytesIO(study.files[name]))


def in_lps(centre: tuple[float, float, float]) -> list[float]:
    return [-centre[0], -centre[1], centre[2]]


def test_segments_have_volume_and_place_of_their_surfaces(study):
    read = hd.seg.Segmentation.from_dataset(opened(study, "segmentation.dcm"))
    assert [read.get_segment_description(k).segment_label for k in (1, 2)] == ["tumor", "shell"]
    volume = read.get_volume(segment_numbers=[1, 2])
    for channel, found in enumerate(study.volumes):
        inside = np.argwhere(volume.array[..., channel])
        assert len(inside) * 0.5**3 == pytest.approx(found.surface_mm3, rel=0.01)
        points = volume.map_indices_to_reference(inside)
        expected = in_lps((BALL, SHELL)[channel])
        assert np.abs(points.mean(axis=0) - expected).max() < 0.05


def test_frames_of_the_segmentation_have_their_place_by_plain_arithmetic(study):
    read = opened(study, "segmentation.dcm")
    bits = np.unpackbits(np.frombuffer(read.PixelData, np.uint8), bitorder="little")
    size = read.Rows * read.Columns
    points = []
    for index, frame in enumerate(read.PerFrameFunctionalGroupsSequence):
        if frame.SegmentIdentificationSequence[0].ReferencedSegmentNumber != 1:
            continue
        corner = [float(v) for v in frame.PlanePositionSequence[0].ImagePositionPatient]
        pixels = bits[index * size : (index + 1) * size].reshape(read.Rows, read.Columns)
        for row, column in np.argwhere(pixels):
            points.append([corner[0] + 0.5 * column, corner[1] + 0.5 * row, corner[2]])
    radius = np.linalg.norm(np.array(points) - in_lps(BALL), axis=1)
    assert 8.8 < radius.max() < 9.01
    assert len(points) * 0.5**3 == pytest.approx(4.0 / 3.0 * np.pi * 9.0**3, rel=0.01)


def test_contours_enclose_the_volume_of_their_surfaces(study):
    read = opened(study, "structure_set.dcm")
    names = [roi.ROIName for roi in read.StructureSetROISequence]
    assert names == ["tumor", "shell"]
    for roi, found in zip(read.ROIContourSequence, study.volumes, strict=True):
        volume = 0.0
        for contour in roi.ContourSequence:
            points = np.array(contour.ContourData, float).reshape(-1, 3)
            assert contour.ContourGeometricType == "CLOSED_PLANAR"
            assert contour.NumberOfContourPoints == len(points)
            assert np.ptp(points[:, 2]) == 0.0
            x, y = (points[:, :2] - points[0, :2]).T
            volume += 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) * 0.5
        assert volume == pytest.approx(found.surface_mm3, rel=0.01)
    points = np.array(read.ROIContourSequence[0].ContourSequence[5].ContourData, float)
    radius = np.linalg.norm(points.reshape(-1, 3) - in_lps(BALL), axis=1)
    assert np.abs(radius - 9.0).max() < 0.05


def test_files_refer_to_the_images_and_share_a_frame_of_reference(study):
    images = [opened(study, name) for name in study.files if name.startswith("image_")]
    segments, contours = opened(study, "segmentation.dcm"), opened(study, "structure_set.dcm")
    assert len({each.FrameOfReferenceUID for each in (*images, segments, contours)}) == 1
    assert len({each.StudyInstanceUID for each in (*images, segments, contours)}) == 1
    known = {image.SOPInstanceUID: float(image.ImagePositionPatient[2]) for image in images}
    assert len(known) == len(images)
    (series,) = segments.ReferencedSeriesSequence
    assert {each.ReferencedSOPInstanceUID for each in series.ReferencedInstanceSequence} == {*known}
    for contour in contours.ROIContourSequence[1].ContourSequence:
        (image,) = contour.ContourImageSequence
        height = known[image.ReferencedSOPInstanceUID]
        assert contour.ContourData[2] == pytest.approx(height, abs=1e-4)
    assert "no image" in images[0].SeriesDescription


def test_the_same_input_gives_the_same_bytes_and_other_input_other_identifiers():
    coarse = make(voxel_mm=0.8)
    assert make(voxel_mm=0.8).files == coarse.files
    first = opened(coarse, "segmentation.dcm")
    other = make(voxel_mm=0.8, date=datetime.date(2026, 5, 4), patient="two")
    dated = opened(other, "segmentation.dcm")
    assert (dated.StudyDate, dated.ContentDate) == ("20260504", "20260504")
    assert (dated.PatientID, first.PatientID) == ("two", "case one")
    assert dated.FrameOfReferenceUID == first.FrameOfReferenceUID
    assert dated.SOPInstanceUID != first.SOPInstanceUID
    assert dated.StudyInstanceUID != first.StudyInstanceUID


def test_a_given_frame_of_reference_is_that_of_all_files():
    study = dicom_study(
        [Structure("tumor", ball(9.0, BALL))],
        patient="p",
        version="1",
        voxel_mm=0.5,
        frame_of_reference_uid="1.2.3.4",
    )
    assert {opened(study, name).FrameOfReferenceUID for name in study.files} == {"1.2.3.4"}


def test_simpleitk_reads_the_grid(study, tmp_path):
    paths = []
    for name, content in study.files.items():
        (tmp_path / name).write_bytes(content)
        if name.startswith("image_"):
            paths.append(str(tmp_path / name))
    image = SimpleITK.ReadImage(paths)
    assert image.GetSpacing() == pytest.approx((0.5, 0.5, 0.5))
    first = opened(study, "image_0001.dcm")
    assert image.GetOrigin() == pytest.approx([float(v) for v in first.ImagePositionPatient])
    assert np.all(SimpleITK.GetArrayFromImage(image) == -1024)


@pytest.mark.skipif(shutil.which("dciodvfy") is None, reason="dicom3tools is not installed")
@pytest.mark.parametrize("name", ["segmentation.dcm", "structure_set.dcm", "image_0002.dcm"])
def test_dciodvfy_finds_no_error(study, name, tmp_path):
    (tmp_path / name).write_bytes(study.files[name])
    done = subprocess.run(
        ["dciodvfy", "-new", str(tmp_path / name)], capture_output=True, text=True, check=False
    )
    text = done.stdout + done.stderr
    assert "Error" not in text
    assert any(kind in text for kind in ("Segmentation", "RTStructureSet", "CTImage"))


def test_flat_faces_at_multiples_of_a_voxel_have_their_volume():
    box = trimesh.creation.box(extents=[10.0, 12.0, 14.0])
    surface = SurfaceMesh("tumor", box.vertices, box.faces)
    for voxel_mm in (0.5, 1.0, 2.0):
        study = dicom_study(
            [Structure("box", surface)], patient="p", version="1", voxel_mm=voxel_mm
        )
        assert study.volumes[0].segmentation_mm3 == pytest.approx(1680.0)
        assert study.volumes[0].contours_mm3 == pytest.approx(1680.0)


def test_bad_structures_are_refused():
    one = Structure("tumor", ball(9.0, BALL))
    options = {"patient": "p", "version": "1", "voxel_mm": 0.5}
    with pytest.raises(InputError, match=r"'tumor': 2 of this name; expected 1"):
        dicom_study([one, one], **options)
    with pytest.raises(InputError, match=r"expected 64000000 at most"):
        dicom_study([one, Structure("far", ball(1.0, (900.0, 0.0, 900.0)))], **options)
    with pytest.raises(InputError, match=r"expected 0.05 to 5 mm"):
        dicom_study([one], **options | {"voxel_mm": 0.01})
    with pytest.raises(InputError, match=r"expected 1 % at most: smaller voxels"):
        dicom_study([one, Structure("grain", ball(0.5, BALL))], **options | {"voxel_mm": 0.4})
    with pytest.raises(InputError, match=r"expected a DICOM UID"):
        dicom_study([one], **options, frame_of_reference_uid="1.02")
    surface = one.surface
    with pytest.raises(MeshError, match=r"structure 'open' is not closed"):
        open_one = SurfaceMesh("tumor", surface.vertices_mm, surface.faces[:-1])
        dicom_study([one, Structure("open", open_one)], **options)
