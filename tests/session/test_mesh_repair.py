"""Repair of a case's meshes: on request only, and reported."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from app.case import Case, open_case
from app.cli.main import main
from app.geometry import MeshError
from app.session import with_repaired_meshes
from tests.cli.small_case import write_small_case

pytestmark = pytest.mark.slow

OpenCase = Callable[..., Case]


@pytest.fixture
def broken(project_root: Path, tmp_path: Path) -> OpenCase:
    """The recorded case with some faces of its tumour flipped or removed."""

    def write(*, repair: bool | None, missing: int = 1) -> Case:
        folder = tmp_path / "case"
        shutil.copytree(project_root / "data" / "recorded_case", folder)
        manifest = yaml.safe_load((folder / "case.yaml").read_text())
        mesh = manifest["tumor"]["mesh"]
        shape = trimesh.load_mesh(folder / mesh["path"])
        faces = np.array(shape.faces[missing:])
        faces[40:50] = faces[40:50, ::-1]
        trimesh.Trimesh(shape.vertices, faces, process=False).export(folder / mesh["path"])
        if repair is not None:
            mesh["repair"] = repair
        (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
        return open_case(folder)

    return write


@pytest.mark.parametrize("repair", [None, False])
def test_mesh_is_repaired_only_on_request(broken, repair):
    case = broken(repair=repair)
    assert with_repaired_meshes(case) is case
    with pytest.raises(MeshError, match="is not closed"):
        case.tumor_mesh()


def test_repaired_tumour_equals_that_of_the_sound_case(broken, project_root):
    case = with_repaired_meshes(broken(repair=True))
    sound = open_case(project_root / "data" / "recorded_case").tumor_mesh()
    assert case.tumor_mesh().signed_volume_mm3 == pytest.approx(sound.signed_volume_mm3, rel=1e-4)
    turned, closed = case.notes()
    assert "was repaired: 10 faces reoriented to match their neighbours" in turned
    assert "1 holes closed with planar patches" in closed


def test_tool_of_overlapping_parts_is_united_on_request(tmp_path):
    def with_parts(manifest: dict[str, Any]) -> None:
        manifest["tool"]["mesh"]["repair"] = True

    folder = write_small_case(tmp_path / "case", with_parts)
    manifest = yaml.safe_load((folder / "case.yaml").read_text())
    shaft = trimesh.creation.cylinder(radius=1.0, height=20.0, sections=16)
    ball = trimesh.creation.icosphere(2, radius=1.5)
    ball.apply_translation([0.0, 0.0, 10.0])
    path = folder / manifest["tool"]["mesh"]["path"]
    trimesh.util.concatenate([shaft, ball]).export(path)
    case = with_repaired_meshes(open_case(folder))
    volume = case.tool_mesh().signed_volume_mm3
    assert max(shaft.volume, ball.volume) < volume < shaft.volume + ball.volume
    assert "the tool's mesh" in case.notes()[-1]
    assert "2 parts united" in case.notes()[-1]
    manifest["tool"]["mesh"]["repair"] = False
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    case = open_case(folder)
    assert with_repaired_meshes(case) is case


def test_mesh_without_safe_repair_is_rejected(broken):
    with pytest.raises(MeshError, match=r"the tumour's mesh tumor.stl: holes touch at"):
        with_repaired_meshes(broken(repair=True, missing=2000))


@pytest.mark.parametrize("command", ["info", "replay"])
def test_commands_report_the_repair(tmp_path, capsys, command):
    def repair(manifest: dict[str, Any]) -> None:
        manifest["tumor"]["mesh"]["repair"] = True

    folder = write_small_case(tmp_path / "case", repair)
    ball = trimesh.load_mesh(folder / "tumor.stl")
    ball.invert()
    ball.export(folder / "tumor.stl")
    assert main([command, str(folder), "--json"]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert "the tumour's mesh tumor.stl was repaired: orientation of 1 of 1 parts reversed" in notes
