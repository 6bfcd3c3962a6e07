"""Scenes with recordings, written as text here; files written by MRML are read in tests/scene."""

import io
import zipfile
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case import TrackingFrame, open_case, read_mrml
from app.geometry import InputError, MarginGuardError
from tests.refusals import refused

NEEDLE = "1 0 0 1.5 0 1 0 -2 0 0 1 3e-005 0 0 0 1"
CAUTERY = "1 0 0 100.125 0 1 0 0 0 0 1 7 0 0 0 1"


def header(name: str, *rows: tuple[str, str]) -> str:
    lines = ["ObjectType = Image", "NDims = 3", f"DimSize = 0 0 {len(rows)}"]
    for number, (time, matrix) in enumerate(rows):
        lines += [
            f"Seq_Frame{number:04}_{name}Transform ={matrix} ",
            f"Seq_Frame{number:04}_{name}TransformStatus = OK",
            f"Seq_Frame{number:04}_Timestamp = {time}",
        ]
    return "\n".join([*lines, "ElementDataFile = LOCAL"])


def sequence(number: int, name: str, file: str, *, more: str = "", **changes: str) -> str:
    known = {
        "name": name,
        "attributes": f"DataNodeClassName:vtkMRMLLinearTransformNode{more}",
        "references": f"storage:vtkMRMLLinearTransformSequenceStorageNode{number};",
        "indexName": "time",
        "indexUnit": "s",
        "indexType": "numeric",
        **changes,
    }
    attributes = " ".join(f'{key}="{value}"' for key, value in known.items())
    return (
        f'<Sequence id="vtkMRMLSequenceNode{number}" {attributes}></Sequence>\n'
        f'<LinearTransformSequenceStorage id="vtkMRMLLinearTransformSequenceStorageNode{number}" '
        f'fileName="{file}"></LinearTransformSequenceStorage>\n'
    )


def scene(*nodes: str) -> str:
    return '<?xml version="1.0" encoding="UTF-8"?>\n<MRML>\n' + "".join(nodes) + "</MRML>\n"


SCENE = scene(
    sequence(1, "NeedleToTracker-Sequence", "Data/Needle%20To.seq.mha"),
    sequence(
        2,
        "Recording-CauteryToTracker-Seq",
        "Data/Cautery.seq.mha",
        more=";MarginGuard.Lost:2.5=MISSING 1.000000001=INVALID;Sequences.Source:CauteryToTracker",
    ),
    sequence(3, "Slow", "Data/none.seq.mha", more=";MarginGuard.Derived:true"),
    sequence(4, "Image", "Data/i.seq.nrrd", attributes="DataNodeClassName:vtkMRMLScalarVolumeNode"),
)
FILES = {
    "a/a.mrml": SCENE,
    "a/Data/Needle To.seq.mha": header(
        "NeedleToTracker-Sequence", ("1.000000001", NEEDLE), ("2.5", NEEDLE), ("3", NEEDLE)
    ),
    "a/Data/Cautery.seq.mha": header("CauteryToTracker", ("3.000", CAUTERY)),
}


def bundle(path: Path, files: dict[str, str | bytes]) -> Path:
    """The first file is stored, the others are deflated: programs store what does not shrink."""
    with zipfile.ZipFile(path, "w") as file:
        for number, (name, content) in enumerate(files.items()):
            file.writestr(name, content, zipfile.ZIP_DEFLATED if number else zipfile.ZIP_STORED)
    return path


def folder(path: Path, files: dict[str, str | bytes]) -> Path:
    for name, content in files.items():
        file = path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path / "a" / "a.mrml"


def read(path: Path) -> tuple[list[TrackingFrame], list[str]]:
    notes: list[str] = []
    return list(read_mrml(path, notes.append)), notes


def statuses_by_frame(frames: list[TrackingFrame]) -> list[tuple[int, dict[tuple[str, str], str]]]:
    return [
        (one.stamp.ns, {(p.target, p.source): p.status.name for p in one.poses}) for one in frames
    ]


@pytest.mark.parametrize("write", [bundle, folder])
def test_samples_of_one_time_are_one_frame(tmp_path, write):
    frames, notes = read(write(tmp_path / "x.mrb", FILES))
    needle, cautery = ("tracker", "needle"), ("tracker", "cautery")
    assert statuses_by_frame(frames) == [
        (1_000_000_001, {needle: "OK", cautery: "INVALID"}),
        (2_500_000_000, {needle: "OK", cautery: "MISSING"}),
        (3_000_000_000, {needle: "OK", cautery: "OK"}),
    ]
    assert notes == []
    poses = {pose.source: pose.transform for pose in frames[2].poses}
    assert poses["needle"].translation_mm.tolist() == [1.5, -2.0, 3e-5]
    assert poses["cautery"].translation_mm.tolist() == [100.125, 0.0, 7.0]


def nested() -> dict[str, str | bytes]:
    """A sequence as Slicer stores one of any other nodes: a scene with one node per item."""
    items = scene(
        f'<LinearTransform id="t1" name="N" matrixTransformToParent="{NEEDLE}"></LinearTransform>',
        f'<LinearTransform id="t2" name="N" attributes="TransformStatus:OUT_OF_VIEW" '
        f'matrixTransformToParent="{NEEDLE}"></LinearTransform>',
    )
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as file:
        file.writestr("Needle.seq/Needle.mrml", items)
    outer = sequence(1, "NeedleToTracker", "Data/Needle.seq.mrb", indexValues="t1:0.5;t2:0.75")
    return {
        "a/a.mrml": scene(outer),
        "a/Data/Needle.seq.mrb": inner.getvalue(),
        "a/Data/Needle.seq.mrml": items,
    }


@pytest.mark.parametrize("kind", [".seq.mrb", ".seq.mrml"])
def test_sequence_in_a_nested_scene_is_read(tmp_path, kind):
    files = nested()
    files["a/a.mrml"] = files["a/a.mrml"].replace(".seq.mrb", kind)
    frames, _ = read(bundle(tmp_path / "x.mrb", files))
    edge = ("tracker", "needle")
    assert statuses_by_frame(frames) == [
        (500_000_000, {edge: "OK"}),
        (750_000_000, {edge: "OUT_OF_VIEW"}),
    ]


def test_sequence_names_without_frames_are_noted(tmp_path):
    other = sequence(9, "Movement", "Data/none.seq.mha")
    files = {**FILES, "a/a.mrml": SCENE.replace("</MRML>", f"{other}</MRML>")}
    frames, notes = read(bundle(tmp_path / "x.mrb", files))
    assert len(frames) == 3
    assert notes == ["sequence 'Movement' skipped: 0 names like NeedleToReference; expected one"]


def one(name: str = "NeedleToTracker", file: str = "Data/N.seq.mha", **changes: str) -> str:
    return scene(sequence(1, name, file, **changes))


BOMB = '<!DOCTYPE MRML [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><MRML>&b;</MRML>'
FAULTS: dict[str, tuple[dict[str, str | bytes], str]] = {
    "no scene": ({"a/x": ""}, r"0 scenes \(\.mrml\); expected 1"),
    "two scenes": ({"a/a.mrml": SCENE, "a/b.mrml": SCENE}, "2 scenes"),
    "no sequence": ({"a/a.mrml": scene()}, "no sequence of transforms"),
    "not MRML": ({"a/a.mrml": "<html></html>"}, "is a 'html'; expected an MRML scene"),
    "cut": ({"a/a.mrml": SCENE[:-20]}, "not well-formed: "),
    "entities": ({"a/a.mrml": BOMB}, "has a document type"),
    "over angles": (
        {"a/a.mrml": one(indexUnit="deg")}, "over 'time' in 'deg' .*; expected time in 's'"
    ),
    "no storage": ({"a/a.mrml": one(references="")}, "has no file"),
    "no file": ({"a/a.mrml": one()}, r"has no file 'a/Data/N\.seq\.mha'"),
    "up and away": (
        {"a/a.mrml": one(file="../../etc/N.seq.mha"), "etc/N.seq.mha": header("NeedleToTracker")},
        r"has no file 'a/\.\./\.\./etc/N\.seq\.mha'",
    ),
    "absolute": ({"a/a.mrml": one(file="/etc/N.seq.mha")}, "has no file '/etc/N.seq.mha'"),
    "unknown kind": (
        {"a/a.mrml": one(file="Data/N.h5"), "a/Data/N.h5": b""},
        r"N\.h5 cannot be read; expected one of \.mha, "
    ),
    "another transform": (
        {"a/a.mrml": one(), "a/Data/N.seq.mha": header("ProbeToTracker", ("1", NEEDLE))},
        "holds no sample of NeedleToTracker",
    ),
    "bad numbers": (
        {"a/a.mrml": one(), "a/Data/N.seq.mha": header("NeedleToTracker", ("1", "1 2 3"))},
        r"N\.seq\.mha line 4 .*3 numbers; expected 16",
    ),
    "bad time": (
        {"a/a.mrml": one(), "a/Data/N.seq.mha": header("NeedleToTracker", ("soon", NEEDLE))},
        "time 'soon'",
    ),
    "bad loss": (
        {
            "a/a.mrml": one(more=";MarginGuard.Lost:1=OK"),
            "a/Data/N.seq.mha": header("NeedleToTracker", ("1", NEEDLE)),
        },
        "a lost sample has status 'OK'",
    ),
    "item without node": (
        {**nested(), "a/a.mrml": one(file="Data/Needle.seq.mrml", indexValues="t7:1")},
        "has no transform 't7', which the sequence has at 1 s",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_scenes_are_refused_in_one_line(tmp_path, fault):
    files, message = FAULTS[fault]
    with refused(message) as caught:
        read(bundle(tmp_path / "x.mrb", files))
    assert "x.mrb" in str(caught.value)


def test_scene_cannot_name_a_file_outside_its_folder(tmp_path):
    (tmp_path / "secret.seq.mha").write_text(header("NeedleToTracker", ("1", NEEDLE)))
    for name in ("../secret.seq.mha", str(tmp_path / "secret.seq.mha")):
        path = folder(tmp_path / "x", {"a/a.mrml": one(file=name)})
        with pytest.raises(InputError, match="a relative path without"):
            read(path)
    path = folder(tmp_path / "x", {"a/a.mrml": one(file="link.seq.mha")})
    (path.parent / "link.seq.mha").symlink_to(tmp_path / "secret.seq.mha")
    with pytest.raises(InputError, match="leaves the folder"):
        read(path)


def test_oversized_content_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._MAX_SCENE_BYTES", 10_000)
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._MAX_RATIO", 0)
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._FREE_BYTES", 10_000)
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._MAX_MEMBERS", 5)
    much = b" " * 20_000
    for files, message in (
        ({"a/a.mrml": much}, "too large; expected 10000 bytes or less"),
        (
            {"a/a.mrml": one(), "a/Data/N.seq.mha": much},
            "unpacks to 20000 bytes; expected 10000 or less",
        ),
        ({f"a/{n}": b"" for n in range(6)}, "6 files; expected 5 or less"),
        ({**nested(), "a/Data/Needle.seq.mrb": much}, "20000 bytes; expected 10000 or less"),
    ):
        with pytest.raises(InputError, match=message):
            read(bundle(tmp_path / "x.mrb", files))


@pytest.mark.parametrize("write", [bundle, folder])
def test_size_limit_covers_sequences_that_share_a_file(tmp_path, monkeypatch, write):
    """Sequences are read side by side, so a small file could otherwise fill the memory."""
    names = ("Needle", "Cautery", "Probe", "Stylus")
    item = f'<LinearTransform id="t1" matrixTransformToParent="{NEEDLE}"></LinearTransform>'
    scenes = scene(
        *(
            sequence(number, f"{name}ToTracker", "Data/N.seq.mrml", indexValues="t1:0.5;")
            for number, name in enumerate(names)
        )
    )
    files = {"a/a.mrml": scenes, "a/Data/N.seq.mrml": scene(item, " " * 10_000)}
    (frame,) = read(write(tmp_path / "x.mrb", files))[0]
    assert len(frame.poses) == len(names)
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._MAX_SCENE_BYTES", 40_000)
    with pytest.raises(InputError, match=r"N.seq.mrml: .* too large; expected 40000 bytes or less"):
        read(write(tmp_path / "y.mrb", files))


def test_size_limit_covers_sequences_that_share_a_header(tmp_path, monkeypatch):
    nodes = [sequence(number, "NeedleToTracker", "N.seq.mha") for number in range(3)]
    held = header("NeedleToTracker", ("0.5", NEEDLE))
    files = {"a/a.mrml": scene(*nodes), "a/N.seq.mha": held}
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._MAX_RATIO", 0)
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._FREE_BYTES", 2 * len(held) + 7)
    with pytest.raises(InputError, match=rf"unpacks to {len(held)} bytes; expected 7 or less"):
        list(read_mrml(bundle(tmp_path / "x.mrb", files), print))


def test_changed_byte_after_the_header_is_detected(tmp_path):
    text = header("NeedleToTracker", ("1", NEEDLE)).encode() + b"\n" + bytes(5_000_000)
    path = tmp_path / "x.mrb"
    with zipfile.ZipFile(path, "w") as file:  # stored, as MRML does it
        file.writestr("a/a.mrml", one())
        file.writestr("a/Data/N.seq.mha", text)
    content = bytearray(path.read_bytes())
    content[4_000_000] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"is not a complete bundle: Bad CRC-32 .*N\.seq\.mha"):
        read(path)


def test_members_that_zipfile_unpacks_without_a_limit_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "x.mrb", "w", zipfile.ZIP_LZMA) as file:
        file.writestr("a/a.mrml", one())
        file.writestr("a/Data/N.seq.mha", header("NeedleToTracker", ("1", NEEDLE)))
    with pytest.raises(InputError, match="holds files that are not deflated"):
        read(tmp_path / "x.mrb")


def test_bundle_that_unpacks_to_far_more_than_its_size_is_refused(tmp_path):
    held = header("NeedleToTracker", ("1", NEEDLE)).encode()
    files = {"a/a.mrml": one(), "a/Data/N.seq.mha": b"Comment = 1\n" * 3_000_000 + held}
    path = bundle(tmp_path / "x.mrb", files)
    assert path.stat().st_size < 80_000
    with pytest.raises(InputError, match=r"unpacks to 360\d+ bytes; expected \d+ or less"):
        read(path)


@pytest.mark.parametrize(
    ("nodes", "problem"),
    [
        (['<a b="c"/>'] * 12, "more than 10 elements and items of sequences"),
        ([sequence(1, "NeedleToTracker", "N.seq.mha", indexValues="a:1;" * 20)], "more than 10"),
        ([sequence(1, "NeedleToTracker", "N.seq.mha", more=";x:y" * 20)], "more than 10 elements"),
    ],
    ids=["elements", "index", "attributes"],
)
def test_number_of_items_is_limited(tmp_path, monkeypatch, nodes, problem):
    monkeypatch.setattr("app.case.readers.mrml.mrml_scene._MAX_ITEMS", 10)
    files = {"a/a.mrml": scene(*nodes), "a/N.seq.mha": header("NeedleToTracker", ("1", NEEDLE))}
    with pytest.raises(InputError, match=problem):
        read(bundle(tmp_path / "x.mrb", files))


def test_number_of_sequences_is_limited(tmp_path):
    nodes = [sequence(number, "NeedleToTracker", "N.seq.mha") for number in range(257)]
    with pytest.raises(InputError, match="has 257 sequences; expected 256 or fewer"):
        read(bundle(tmp_path / "x.mrb", {"a/a.mrml": scene(*nodes)}))


def test_file_that_is_not_a_bundle_is_refused(tmp_path):
    path = tmp_path / "x.mrb"
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read(path)
    path.write_bytes(b"PK or not")
    with pytest.raises(InputError, match=r"is not a complete bundle: .*not a zip"):
        read(path)


def compare_damaged_bundles(path: Path, count: int) -> None:
    expected = statuses_by_frame(read(bundle(path, FILES))[0])
    whole = path.read_bytes()

    @settings(max_examples=count)
    @given(st.floats(0.0, 1.0, exclude_max=True), st.integers(1, 255), st.booleans())
    def compare(position: float, bits: int, cut: bool) -> None:
        content, at = bytearray(whole), int(position * len(whole))
        if cut:
            del content[at:]
        else:
            content[at] ^= bits
        path.write_bytes(content)
        try:
            frames, _ = read(path)
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert statuses_by_frame(frames) == expected

    compare()


def test_damaged_bundle_is_refused_or_read_identically(tmp_path):
    compare_damaged_bundles(tmp_path / "x.mrb", 80)


def test_case_with_a_bundle_as_recording_is_opened(write_case, manifest):
    case_folder = write_case(manifest)
    bundle(case_folder / "x.mrb", FILES)
    manifest["recording"] = {"path": "x.mrb"}
    (case_folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    case = open_case(case_folder)
    assert next(frame.stamp.ns for frame in case.recorded_frames()) == 1_000_000_001
    bundle(case_folder / "x.mrb", {**FILES, "a/Data/Cautery.seq.mha": "ObjectType = Image\n"})
    with pytest.raises(MarginGuardError, match=r"Cautery\.seq\.mha is cut at line 1"):
        open_case(case_folder)
