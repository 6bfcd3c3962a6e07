"""Bundles of one sequence with an ``.h5`` file per item, and scenes of Slicer 4.4."""

import io
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.case import read_recording
from app.geometry import InputError

pytestmark = pytest.mark.slow

FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])
COUNT = 12


def h5_bytes(seed: int) -> bytes:
    rng = np.random.default_rng(seed)
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        group = file.create_group("TransformGroup/0")
        group["TransformType"] = ["AffineTransform_double_3_3"]
        rotation = Rotation.random(rng=rng).as_matrix()
        group["TransformParameters"] = np.append(rotation.ravel(), rng.normal(0, 90, 3))
        group["TransformFixedParameters"] = np.zeros(3)
    return content.getvalue()


def inner_scene(name: str, *, index: bool) -> str:
    """The scene in a ``.seq.mrb``, with storages after the nodes that name them."""
    nodes = [
        f'<LinearTransform id="vtkMRMLLinearTransformNode{item}" name="{name}" '
        f'references="storage:vtkMRMLTransformStorageNode{item};"/>'
        f'<TransformStorage id="vtkMRMLTransformStorageNode{item}" '
        f'fileName="Data/{name}_{item}.h5"/>'
        for item in range(COUNT)
    ]
    if index:
        times = "".join(f"vtkMRMLLinearTransformNode{item}:{item / 8};" for item in range(COUNT))
        nodes.append(
            '<Sequence id="vtkMRMLSequenceNodeSequenceIndex" name="Sequence" '
            'singletonTag="SequenceIndex" indexName="time" indexUnit="s" indexType="numeric" '
            f'indexValues="{times}"/>'
        )
    return f"<MRML>{''.join(nodes)}</MRML>"


def bundle(name: str, *, index: bool = True) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr(f"{name}/{name}.mrml", inner_scene(name, index=index))
        for item in range(COUNT):
            file.writestr(f"{name}/Data/{name}_{item}.h5", h5_bytes(item))
    return content.getvalue()


def expected(seed: int) -> np.ndarray:
    with h5py.File(io.BytesIO(h5_bytes(seed))) as file:
        numbers = file["TransformGroup/0/TransformParameters"][()]
    stored = np.eye(4)
    stored[:3, :3], stored[:3, 3] = numbers[:9].reshape(3, 3), numbers[9:]
    return FLIP @ np.linalg.inv(stored) @ FLIP


def check(path: Path) -> None:
    frames = list(read_recording(path, pytest.fail))
    assert [frame.stamp.ns for frame in frames] == [item * 125_000_000 for item in range(COUNT)]
    for item, frame in enumerate(frames):
        (pose,) = frame.poses
        assert (pose.target, pose.source) == ("reference", "needle")
        np.testing.assert_allclose(pose.transform.matrix, expected(item), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "items"),
    [("x.seq.mrb", "NeedleToReference"), ("NeedleToReference-Sequence.mrb", "Item")],
    ids=["names of the items", "name of the file"],
)
def test_bundle_of_one_sequence_is_a_recording(tmp_path, name, items):
    (tmp_path / name).write_bytes(bundle(items))
    check(tmp_path / name)


def outer_scene(*, with_class: bool) -> str:
    times = "".join(f"vtkMRMLLinearTransformNode{item}:{item / 8};" for item in range(COUNT))
    known = 'attributes="DataNodeClassName:vtkMRMLLinearTransformNode;"' if with_class else ""
    return (
        '<MRML version="Slicer4.4.0"><SequenceBrowser id="vtkMRMLSequenceBrowserNode1"/>'
        '<Sequence id="vtkMRMLSequenceNode1" name="NeedleToReference" indexName="time" '
        f'indexUnit="s" indexType="numeric" storageNodeRef="s" {known} indexValues="{times}"/>'
        '<SequenceStorage id="s" fileName="Needle.seq.mrb"/></MRML>'
    )


@pytest.mark.parametrize(("with_class", "index"), [(True, True), (False, False)])
def test_scene_names_the_bundle_with_or_without_the_class_of_its_items(tmp_path, with_class, index):
    """Slicer 4.4 gives the class of the items by their IDs only, and embeds no index."""
    (tmp_path / "Needle.seq.mrb").write_bytes(bundle("NeedleToReference", index=index))
    (tmp_path / "s.mrml").write_text(outer_scene(with_class=with_class))
    check(tmp_path / "s.mrml")


def test_scene_of_images_only_names_their_class(tmp_path):
    text = outer_scene(with_class=False).replace("LinearTransformNode", "ScalarVolumeNode")
    (tmp_path / "s.mrml").write_text(text)
    with pytest.raises(InputError, match=r"no sequence of transforms .*, but of vtkMRMLScalarVol"):
        list(read_recording(tmp_path / "s.mrml", print))


def test_damaged_item_is_named(tmp_path):
    path = tmp_path / "x.seq.mrb"
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as file:
        file.writestr("n/n.mrml", inner_scene("NeedleToReference", index=True))
        for item in range(COUNT):
            data = h5_bytes(item)
            file.writestr(f"n/Data/NeedleToReference_{item}.h5", data[:200] if item == 7 else data)
    path.write_bytes(content.getvalue())
    with pytest.raises(InputError, match=r"NeedleToReference_7\.h5 is not a transform of ITK"):
        list(read_recording(path, print))
