import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pydicom
import pytest
import trimesh

from app.analysis.specimen import Resection, Specimen
from app.cli.dicom_folder import resected_structures, write_dicom
from app.cli.main import main
from app.geometry import SurfaceMesh
from tests.cli.small_case import write_small_case

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_case(tmp_path_factory.mktemp("export") / "case")


def centre(path: Path, number: int) -> np.ndarray:
    contours = pydicom.dcmread(path / "structure_set.dcm").ROIContourSequence[number]
    points = [np.reshape(each.ContourData, (-1, 3)) for each in contours.ContourSequence]
    return np.concatenate(points).astype(float).mean(axis=0)


def test_tumour_and_another_surface_are_written_in_the_axes_of_the_patient(case, tmp_path, capsys):
    specimen = trimesh.creation.box(extents=[30.0, 20.0, 10.0])
    specimen.apply_translation([5.0, 7.0, 9.0])
    specimen.export(tmp_path / "specimen.stl")
    out = tmp_path / "out"
    given = ["--out", str(out), "--structure", f"specimen={tmp_path / 'specimen.stl'}"]
    turned = ["--ras-from-tumor", *("0", "-1", "0", "1", "0", "0", "0", "0", "1")]  # x is anterior
    given += ["--voxel-mm", "0.5", "--json", *turned]
    assert main(["convert", "dicom", str(case), *given]) == 0
    document = json.loads(capsys.readouterr().out)
    assert sorted(document["files"]) == sorted(path.name for path in out.iterdir())
    tumor, box = document["structures"]
    assert (tumor["name"], box["name"]) == ("tumor", "specimen")
    assert box["segmentation_mm3"] == pytest.approx(6000.0, rel=0.01)
    assert centre(out, 1) == pytest.approx([7.0, -5.0, 9.0], abs=0.3)
    segments = pydicom.dcmread(out / "segmentation.dcm").SegmentSequence
    assert [segment.SegmentLabel for segment in segments] == ["tumor", "specimen"]


def test_analysis_writes_tumour_and_specimen(case, tmp_path):
    assert main(["analyse", str(case), "--dicom", str(tmp_path / "out")]) == 0
    read = pydicom.dcmread(tmp_path / "out" / "structure_set.dcm")
    assert [roi.ROIName for roi in read.StructureSetROISequence] == ["tumor"]

    block = trimesh.creation.box(extents=[10.0, 12.0, 14.0])
    surface = SurfaceMesh("tumor", block.vertices, block.faces)
    specimen = Specimen(None, surface, 1680.0, 0.0, {"R": 1.0})
    resection = Resection(10.0, None, 0.0, specimen, "")
    found = resected_structures(surface, SimpleNamespace(resection=resection))
    assert [each.name for each in found] == ["tumor", "specimen"]
    study = write_dicom(tmp_path / "both", found, ras_from_tumor=None, patient="p", voxel_mm=0.4)
    assert study.volumes[1].segmentation_mm3 == pytest.approx(1680.0, rel=0.01)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--structure", "specimen"], "expected NAME=FILE"),
        (["--structure", "specimen=missing.stl"], "missing.stl"),
        (["--date", "yesterday"], "expected YYYY-MM-DD"),
        (["--ras-from-tumor", *"111111111"], "is no rotation"),
    ],
)
def test_bad_options_leave_no_folder(case, options, problem, tmp_path, capsys):
    out = tmp_path / "out"
    try:
        status = main(["convert", "dicom", str(case), "--out", str(out), *options])
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    error = capsys.readouterr().err
    assert problem in error
    assert len(error.splitlines()) == 1
    assert not out.exists()


def test_an_existing_folder_is_not_overwritten(case, tmp_path, capsys):
    (tmp_path / "mine").write_text("kept")
    assert main(["convert", "dicom", str(case), "--out", str(tmp_path)]) == 2
    assert "already exists" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
