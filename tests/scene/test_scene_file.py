import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest
import slicer
import slicer.util
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from trame_slicer.core import SlicerApp

from app.fixture import MarginState
from app.scene import MarginGuardScene, SceneError, load_scene, save_scene
from tests.case.readers.test_mrml import bundle
from tests.scene.conftest import loaded
from tests.scene.scene_content import content

pytestmark = pytest.mark.slow

DIGITS = 1e-12


@pytest.fixture
def shown(application, fill, arm, decision):
    scene = fill(MarginGuardScene(application.scene))
    links = arm.forward_kinematics({"shoulder": 0.7, "elbow": -0.4})
    scene.show(decision(MarginState.POSITIVE, -3.25), {"arm": links})
    return scene


@pytest.fixture
def saved(shown, tmp_path):
    path = tmp_path / "scene.mrb"
    save_scene(shown.scene, path)
    return path


def assert_same(found, expected, place=""):
    """Equal names, texts and structure; numbers to the last digits of a double."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys(), place
        for key in expected:
            assert_same(found[key], expected[key], f"{place}/{key}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), place
        if all(isinstance(value, float) for value in expected):
            np.testing.assert_allclose(found, expected, rtol=DIGITS, atol=DIGITS, err_msg=place)
        else:
            for one, other in zip(found, expected, strict=True):
                assert_same(one, other, place)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=DIGITS, abs=DIGITS), place
    else:
        assert found == expected, place


def test_scene_is_saved_in_the_current_folder(shown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_scene(shown.scene, Path("scene.mrb"))
    assert [path.name for path in tmp_path.iterdir()] == ["scene.mrb"]
    assert_same(content(loaded(Path("scene.mrb")).scene), content(shown.scene))


def test_loaded_scene_is_the_saved_one(shown, saved, edges, arm):
    found = content(loaded(saved).scene)
    assert_same(found, content(shown.scene))
    # And against the input, independent of MRML.
    tracker_from_reference, tracker_from_needle, _ = edges
    needle = (tracker_from_reference.inverse() @ tracker_from_needle).matrix
    np.testing.assert_allclose(
        np.reshape(found["NeedleToReference"]["to_world"], (4, 4)), needle, atol=1e-9
    )
    assert found["Tumor"]["display"]["color"] == list(MarginState.POSITIVE.color)
    assert found["Tumor"]["display"]["opacity"] == 0.4
    assert found["Tumor"]["parent"] == "TumorToNeedle"
    assert found["MarginStatus"]["text"] == "POSITIVE: in the tumour, -3.2 mm"
    assert [point[3] for point in found["ClosestPoints"]["points"]] == ["-3.2 mm", ""]
    blue, magenta = [0, 0, 255], [255, 0, 255]
    assert {tuple(c) for c in found["fore_arm_model"]["cell_colors"]} == {(*blue,), (*magenta,)}
    assert {f"{link.name}_model" for link in arm.links} <= found.keys()


def test_loaded_scene_can_be_saved_again(saved, shown):
    again = saved.with_name("again.mrb")
    save_scene(loaded(saved).scene, again)
    assert_same(content(loaded(again).scene), content(shown.scene))


def test_functions_of_slicer_find_the_nodes(saved, shown, monkeypatch):
    theirs = SlicerApp()
    assert theirs.io_manager.load_scene(saved)
    assert_same(content(theirs.scene), content(shown.scene))
    monkeypatch.setattr(slicer, "mrmlScene", theirs.scene, raising=False)
    fore_arm, tumor = map(slicer.util.getNode, ("ForeArmToBase", "Tumor"))
    matrix = slicer.util.arrayFromTransformMatrix(fore_arm, toWorld=True)
    expected = content(shown.scene)
    np.testing.assert_allclose(matrix.ravel(), expected["ForeArmToBase"]["to_world"], atol=1e-9)
    points = slicer.util.arrayFromModelPoints(tumor)
    np.testing.assert_array_equal(points, expected["Tumor"]["points"])


def test_saving_replaces_a_file_and_leaves_no_other(application, saved):
    before = saved.read_bytes()
    application.scene.AddNewNodeByClass("vtkMRMLTextNode", "Further")
    save_scene(application.scene, saved)
    assert saved.read_bytes() != before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("scene.mrml", "suffix is '.mrml'; expected '.mrb'"),
        ("none/scene.mrb", "parent directory does not exist"),
        ("folder.mrb", "is a directory"),
    ],
)
def test_paths_that_cannot_be_written_are_refused(application, tmp_path, name, message):
    (tmp_path / "folder.mrb").mkdir()
    with pytest.raises(SceneError, match=message):
        save_scene(application.scene, tmp_path / name)


MRML, EMPTY = "a/a.mrml", "<MRML></MRML>"
MODEL = (
    "<MRML><Model id='vtkMRMLModelNode1' name='x' references='storage:vtkMRMLModelStorageNode1;'/>"
    "<ModelStorage id='vtkMRMLModelStorageNode1' fileName='Data/none.vtk'/></MRML>"
)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path: path, "cannot be read: No such file"),
        (lambda path: path.write_text("hello"), "damaged: .*not a zip"),
        (lambda path: bundle(path, {"other": "x"}), "no .mrml file in it; expected a scene bundle"),
        (lambda path: bundle(path, {MRML: "<MRML>"}), "cannot be read as a scene: Syntax error"),
        (lambda path: bundle(path, {MRML: EMPTY}), "0 nodes; expected 1 or more"),
        (lambda path: bundle(path, {MRML: MODEL}), "Failed to read node x"),
    ],
    ids=["missing", "no zip", "no scene", "cut", "empty", "no data"],
)
def test_foreign_files_are_refused_in_one_line(application, tmp_path, write, message, capfd):
    write(tmp_path / "foreign.mrb")
    with pytest.raises(SceneError, match=message) as caught:
        load_scene(application.scene, tmp_path / "foreign.mrb")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0.0, 1.0, exclude_max=True), bits=st.integers(1, 255))
def test_damaged_byte_is_detected_or_changes_nothing(saved, shown, place, bits):
    damaged = bytearray(saved.read_bytes())
    damaged[int(place * len(damaged))] ^= bits
    path = saved.with_name("damaged.mrb")
    path.write_bytes(damaged)
    try:
        found = loaded(path)
    except SceneError as error:
        assert "\n" not in str(error)
    else:
        assert_same(content(found.scene), content(shown.scene))


def test_bundle_that_unpacks_too_large_is_refused(application, tmp_path, monkeypatch):
    monkeypatch.setattr("app.scene.scene_file._MAX_BYTES", 10_000)
    path = bundle(tmp_path / "bomb.mrb", {MRML: EMPTY, "a/Data/much": bytes(20_000)})
    with pytest.raises(SceneError, match=r"2 files of 20013 bytes; expected .* 10000 bytes"):
        load_scene(application.scene, path)


def link_to(target):
    link = zipfile.ZipInfo("a/link")
    link.create_system, link.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
    return {link: str(target), "a/link/astray.txt": "x"}


@pytest.mark.parametrize(
    ("files", "name"),
    [
        (lambda outside: {f"{outside}/astray.txt": "x"}, ".*/outside/astray.txt"),
        (lambda outside: {f"a/../../../../../..{outside}/astray.txt": "x"}, "a/../.*"),
        (lambda outside: {"a\\..\\astray.txt": "x"}, "a.*astray.txt"),
        (link_to, "a/link/astray.txt"),
    ],
    ids=["absolute", "upwards", "backslash", "through a link"],
)
def test_bundle_that_unpacks_outside_its_folder_is_refused(application, tmp_path, files, name):
    outside = tmp_path / "outside"
    outside.mkdir()
    path = bundle(tmp_path / "astray.mrb", {MRML: EMPTY, **files(outside)})
    with pytest.raises(SceneError, match=f"unpacks to '{name}'; expected"):
        load_scene(application.scene, path)
    assert list(outside.iterdir()) == []
