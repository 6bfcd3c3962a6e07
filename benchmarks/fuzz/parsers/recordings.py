"""Recordings, tumours and configurations of cases: MCAP, databases, IGSIO, scenes, NRRD, YAML."""

import gzip
import sqlite3
import tempfile
import zipfile
from collections.abc import Sequence
from contextlib import closing
from functools import cache
from io import BytesIO
from itertools import islice
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from app.case import open_live, recover_recording, tumor_from_contour, tumor_from_segmentation
from app.case.frames.samples import JointSample, TrackingFrame
from app.case.manifest.case_file import load_manifest
from app.case.manifest.expected import load_expected
from app.case.readers.recording_format import SideTopics
from app.case.readers.registry import read_recording
from app.case.recorder.recorder import write_recording
from app.files.shipped import shipped
from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from benchmarks.fuzz.mutators.containers import DATABASE, MCAP, NRRD, ZIP
from benchmarks.fuzz.mutators.text import TEXT
from benchmarks.fuzz.mutators.tree import mutate_json, mutate_xml
from benchmarks.fuzz.mutators.yaml_text import YAML
from benchmarks.fuzz.parser import FuzzedParser

_MATRIX = "1 0 0 10 0 0 -1 20 0 1 0 30 0 0 0 1"
_JOINTS = "/joint_states"


@cache
def _mcap() -> bytes:
    """Ten frames with three tools, joints and two clocks, in several chunks."""
    frames = []
    for index in range(10):
        stamp = Stamp(10**9 + index * 20_000_000)
        poses = tuple(
            TrackedTransform.lost("tracker", name, stamp, TrackingStatus.INVALID)
            if name == "needle" and index % 7 == 3
            else TrackedTransform.valid(
                Transform("tracker", name, np.eye(3), np.array([index, 2.0, 3.0])), stamp
            )
            for name in ("reference", "needle", "cautery")
        )
        joints = (JointSample(("waist", "shoulder"), (0.1 * index, 1.0), stamp),)
        frames.append(TrackingFrame(stamp, poses, joints, stamp.shifted(5, "tracker")))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.mcap"
        write_recording(path, frames)
        return path.read_bytes()


def _mcap_seeds() -> Sequence[bytes]:
    """The recording as it is, in small chunks, and without chunks."""
    return [_mcap(), _rewritten(chunk_size=2000), _rewritten(use_chunking=False)]


def _rewritten(**options: object) -> bytes:
    out = BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD, **options)  # type: ignore[arg-type]
    writer.start(profile="ros2")
    channels: dict[str, int] = {}
    for schema, channel, message in make_reader(BytesIO(_mcap())).iter_messages():
        if schema is not None and channel.topic not in channels:
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
        writer.add_message(channels[channel.topic], message.log_time, message.data, 0)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def _database_seeds() -> Sequence[bytes]:
    """The database of rosbag2 with and without definitions."""
    return [_database(with_definitions=True), _database(with_definitions=False)]


def _database(*, with_definitions: bool) -> bytes:
    with closing(sqlite3.connect(":memory:")) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, "
            "type_description_hash TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
            "timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, "
            "encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, "
            "type_description_hash TEXT NOT NULL);"
        )
        topics: dict[str, int] = {}
        messages = islice(make_reader(BytesIO(_mcap())).iter_messages(), 60)
        for schema, channel, message in messages:
            if schema is not None and channel.topic not in topics:
                topics[channel.topic] = len(topics) + 1
                row = (channel.topic, schema.name, "cdr", "", "")
                database.execute("INSERT INTO topics VALUES (NULL, ?, ?, ?, ?, ?)", row)
                if with_definitions:
                    text = (schema.name, "ros2msg", schema.data.decode(), "")
                    database.execute(
                        "INSERT INTO message_definitions VALUES (NULL, ?, ?, ?, ?)", text
                    )
            entry = (topics[channel.topic], message.log_time, message.data)
            database.execute("INSERT INTO messages VALUES (NULL, ?, ?, ?)", entry)
        database.commit()
        return database.serialize()


def _igsio(ending: str) -> bytes:
    """The header of an IGSIO sequence with two transforms, one of them lost, and an image."""
    is_nrrd = ending == ".nrrd"
    mark = ":=" if is_nrrd else " = "
    first = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 3\nencoding: raw\n"
    lines = [first if is_nrrd else "ObjectType = Image\nNDims = 3\nDimSize = 2 2 3\n"]
    for index in range(3):
        frame = f"Seq_Frame{index:04}_"
        for name, status in (("NeedleToTracker", "OK"), ("StylusToTracker", "INVALID")):
            lines.append(f"{frame}{name}Transform{mark}{_MATRIX}\n")
            lines.append(f"{frame}{name}TransformStatus{mark}{status}\n")
        lines.append(f"{frame}Timestamp{mark}{index}.25\n")
        lines.append(f"{frame}UnfilteredTimestamp{mark}{index}.26\n")
    lines.append("\n" if is_nrrd else "ElementDataFile = LOCAL\n")
    return "".join(lines).encode() + bytes(12)


def _scene(*nodes: str) -> str:
    return f'<MRML version="Slicer 5"><Selection id="s"/>{"".join(nodes)}</MRML>'


def _sequence(name: str, file: str, **more: str) -> str:
    others = " ".join(f'{key}="{value}"' for key, value in more.items())
    return (
        f'<SequenceStorage id="st{name}" fileName="{file}"/><Sequence id="q{name}" name="{name}" '
        f'indexName="time" indexUnit="s" indexType="numeric" references="storage:st{name};" '
        f'attributes="DataNodeClassName:vtkMRMLLinearTransformNode;" {others}/>'
    )


def _inner() -> str:
    return _scene(
        *(
            f'<LinearTransform id="t{index}" name="n" attributes="TransformStatus:OK;" '
            f'matrixTransformToParent="{_MATRIX}"/>'
            for index in range(3)
        )
    )


def _bundle(members: dict[str, str | bytes]) -> bytes:
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as bundle:
        for name, content in members.items():
            bundle.writestr(zipfile.ZipInfo(name), content)
    return out.getvalue()


def _mrml(folder: str = "") -> bytes:
    times = "t0:0.25;t1:1.25;t2:2.5;"
    needle = _sequence("NeedleToTracker", f"{folder}needle.seq.mha", indexValues=times)
    stylus = _sequence("StylusToTracker", f"{folder}stylus.seq.mrml", indexValues=times)
    return _scene(needle, stylus).encode()


def _bundle_seeds() -> Sequence[bytes]:
    parts = {"needle.seq.mha": _igsio(".mha"), "stylus.seq.mrml": _inner()}
    flat = {"a/a.mrml": _mrml("Data/"), **{f"a/Data/{name}": text for name, text in parts.items()}}
    nested = _sequence("NeedleToTracker", "Data/N.seq.mrb", indexValues="t0:0.5;t1:1.5;")
    inner = _bundle({"N/N.mrml": _inner()})
    return [_bundle(flat), _bundle({"a/a.mrml": _scene(nested), "a/Data/N.seq.mrb": inner})]


def _sequence_bundle_seeds() -> Sequence[bytes]:
    """A bundle of one sequence, with its index."""
    index = (
        '<Sequence id="q" name="Sequence" singletonTag="SequenceIndex" indexName="time" '
        'indexUnit="s" indexType="numeric" indexValues="t0:0.5;t1:1.5;"/>'
    )
    scene = _inner().replace('name="n"', 'name="NeedleToTracker"').replace("</MRML>", index)
    return [_bundle({"N/N.mrml": f"{scene}</MRML>"})]


def _perk_tutor() -> bytes:
    elements = "".join(
        f'<log TimeStampSec="{index}" TimeStampNSec="500" type="transform" '
        f'DeviceName="{name}ToReference" transform="{_MATRIX}"/>'
        for name in ("Needle", "Probe")
        for index in range(3)
    )
    message = '<log TimeStampSec="1" TimeStampNSec="0" type="message" message="Insertion"/>'
    return f"<TransformRecorderLog>{elements}{message}</TransformRecorderLog>".encode()


def _nrrd(*, encoding: str, kind: str, named: bool) -> bytes:
    labels = np.zeros((8, 9, 10), dtype=kind)
    labels[2:6, 2:7, 2:8] = 1
    labels[6:, 7:, 8:] = 2
    endian = "endian: little\n" if labels.itemsize > 1 else ""
    names = "".join(
        f"Segment{number}_ID:=s{number}\nSegment{number}_Name:={number + 1}\n"
        f"Segment{number}_LabelValue:={number + 1}\nSegment{number}_Layer:=0\n"
        for number in range(2)
    )
    head = (
        f"NRRD0005\ntype: {labels.dtype.name}\ndimension: 3\nspace: left-posterior-superior\n"
        f"sizes: 8 9 10\nspace directions: (1,0,0) (0,2,0) (0,0,1.5)\nkinds: domain domain domain\n"
        f"{endian}encoding: {encoding}\nspace origin: (10,20,30)\n{names if named else ''}\n"
    )
    data = labels.tobytes(order="F")
    return head.encode() + (gzip.compress(data) if encoding == "gzip" else data)


def _nrrd_seeds() -> Sequence[bytes]:
    return [
        _nrrd(encoding="gzip", kind="u1", named=True),
        _nrrd(encoding="raw", kind="<i2", named=False),
        _nrrd(encoding="gzip", kind="<u4", named=False),
    ]


def _read_tumor(path: Path) -> None:
    tumor_from_segmentation(path, frame="tumor", segment="1")


def _untimed() -> bytes:
    lines = _igsio(".mha").decode("latin-1").splitlines(keepends=True)
    return "".join(line for line in lines if "imestamp =" not in line).encode("latin-1")


def _read_at_rate(path: Path) -> None:
    for _ in read_recording(path, lambda note: None, rate_hz=20.0):
        pass


def _read_frames(path: Path) -> None:
    notes: list[str] = []
    for _ in read_recording(path, notes.append, SideTopics(_JOINTS)):
        pass
    for note in notes:
        if "\n" in note:
            raise ValueError(f"a note has several lines: {note[:200]!r}")


def _recover(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        recover_recording(path, Path(folder) / "new.mcap")


def _contour() -> bytes:
    points = [(10, 0, 0), (-10, 0, 0), (0, 10, 0), (0, -10, 0), (0, 0, 9), (0, 0, -9), (5, 5, 5)]
    listed = ",".join(
        f'{{"label": "F-{index}", "position": [{x}, {y}, {z}], "positionStatus": "defined"}}'
        for index, (x, y, z) in enumerate(points)
    )
    text = f'{{"markups": [{{"coordinateSystem": "LPS", "controlPoints": [{listed}]}}]}}'
    return text.encode()


def _yaml_of(*parts: str) -> Sequence[bytes]:
    return [shipped("data", *parts).read_bytes()]


PARSERS = (
    FuzzedParser("mcap", "x.mcap", _read_frames, _mcap_seeds, MCAP),
    FuzzedParser("recover", "x.mcap", _recover, _mcap_seeds, MCAP),
    FuzzedParser(
        "database", "x.db3", lambda path: _read_frames(path.parent), _database_seeds, DATABASE
    ),
    FuzzedParser("igs_mha", "x.igs.mha", _read_frames, lambda: [_igsio(".mha")], TEXT),
    FuzzedParser("igs_nrrd", "x.igs.nrrd", _read_frames, lambda: [_igsio(".nrrd")], TEXT),
    FuzzedParser(
        "mrml",
        "x.mrml",
        _read_frames,
        lambda: [_mrml()],
        (*TEXT, *[mutate_xml] * 2 * len(TEXT)),
        {"needle.seq.mha": _igsio(".mha"), "stylus.seq.mrml": _inner().encode()},
    ),
    FuzzedParser("mrb", "x.mrb", _read_frames, _bundle_seeds, ZIP),
    FuzzedParser("seq_mrb", "x.seq.mrb", _read_frames, _sequence_bundle_seeds, ZIP),
    FuzzedParser("seq_mha", "x.seq.mha", _read_frames, lambda: [_igsio(".mha")], TEXT),
    FuzzedParser("igs_mhd", "x.igs.mhd", _read_at_rate, lambda: [_untimed()], TEXT),
    FuzzedParser(
        "perk_tutor",
        "x.xml",
        _read_frames,
        lambda: [_perk_tutor()],
        (*TEXT, *[mutate_xml] * len(TEXT)),
    ),
    FuzzedParser("segmentation", "x.seg.nrrd", _read_tumor, _nrrd_seeds, NRRD),
    FuzzedParser(
        "contour",
        "x.mrk.json",
        lambda path: tumor_from_contour(path, frame="tumor"),
        lambda: [_contour()],
        (*TEXT, *[mutate_json] * len(TEXT)),
    ),
    FuzzedParser(
        "case_yaml",
        "case.yaml",
        lambda path: load_manifest(path.parent),
        lambda: _yaml_of("recorded_case", "case.yaml"),
        YAML,
    ),
    FuzzedParser(
        "live_yaml", "live.yaml", open_live, lambda: _yaml_of("live_example", "live.yaml"), YAML
    ),
    FuzzedParser(
        "expected_yaml",
        "expected.yaml",
        lambda path: load_expected(path, reference="reference", robot_base="base"),
        lambda: _yaml_of("recorded_case", "expected.yaml"),
        YAML,
    ),
)
