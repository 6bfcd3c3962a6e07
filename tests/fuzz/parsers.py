"""The parsers of files and messages, with their seeds and the mutations of these.

The documents to start from are in ``seeds``, in a folder of the name of the parser, and among the
shipped files. To add a parser, add it to `PARSERS`, and a folder of valid documents.
"""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from app.case import (
    ImageSequence,
    message_decoder,
    open_live,
    read_image_message,
    recover_recording,
    tumor_from_contour,
    tumor_from_segmentation,
)
from app.case.manifest.case_file import load_manifest
from app.case.manifest.expected import load_expected
from app.case.messages.decoder import tf_reader
from app.case.messages.message_values import JointValues, PoseValues
from app.case.messages.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
)
from app.case.readers.recording_format import SideTopics, read_recording
from app.files import load_mesh, read_landmarks, read_plus_config, read_transform
from app.files.bounded_io import read_bounded
from app.files.numbers import read_signal
from app.files.paths import shipped
from app.files.transforms import read_hdf5_matrices
from app.files.yaml_file import load_yaml
from app.geometry import ImageCalibration, InputError, MarginGuardError, image_corners
from app.igtl.framing import MessageStream, Refusals
from app.igtl.image_messages import MAX_IMAGE_BODY_BYTES, ImageReader
from app.igtl.pose_messages import TYPES, PoseReader
from app.robot import load_robot, robot_from_text
from app.robot.ambf import bodies_from_mesh_map
from app.robot.mesh_locator import read_robot_mesh
from app.robot.urdf import expand_xacro
from app.simulation import open_world
from tests.fuzz.forked import start_forked, start_forked_hdf5
from tests.fuzz.mutators.containers import DATABASE, MCAP, NRRD, ZIP
from tests.fuzz.mutators.gltf import GLB, GLTF
from tests.fuzz.mutators.igtl import IGTL
from tests.fuzz.mutators.raw import RAW, Mutator
from tests.fuzz.mutators.text import TEXT
from tests.fuzz.mutators.tree import mutate_json, mutate_xml
from tests.fuzz.mutators.xacro_text import XACRO
from tests.fuzz.mutators.yaml_text import YAML
from tests.fuzz.parser import MAX_INPUT_BYTES, FuzzedParser

SEEDS = Path(__file__).parent / "seeds"
JSON = (*TEXT, *[mutate_json] * len(TEXT))
XML = (*TEXT, *[mutate_xml] * len(TEXT))
MORE_XML = (*TEXT, *[mutate_xml] * 2 * len(TEXT))
_SCALED = (0.1, 0, 0, 1, 0, 0.1, 0, 2, 0, 0, 0.1, 3, 0, 0, 0, 1)


def _read_frames(path: Path) -> None:
    notes: list[str] = []
    for _ in read_recording(path, notes.append, SideTopics("/joint_states")):
        pass
    if any("\n" in note for note in notes):
        raise ValueError(f"a note has several lines: {notes}")


def _read_at_rate(path: Path) -> None:
    for _ in read_recording(path, lambda note: None, rate_hz=20.0):
        pass


def _recover(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        recover_recording(path, Path(folder) / "new.mcap")


def _read_images(path: Path) -> None:
    """Read every image and its place, then the first one again."""
    calibration = ImageCalibration("probe", _SCALED)
    with ImageSequence(path) as sequence:
        for image in sequence:
            pose = sequence.pose(image.number, calibration, "reference")
            if pose.matrix is not None:
                image_corners(pose.matrix, *sequence.size)
        sequence.image(0)


def _read_needle(path: Path) -> object:
    return read_transform(path, target="reference", source="needle")


def _read_hdf5(path: Path) -> None:
    content = read_bounded(path, MAX_INPUT_BYTES)
    read_hdf5_matrices([content], [str(path)], ask=start_forked_hdf5)


def _read_case_mesh(path: Path) -> object:
    return load_mesh(path, units="mm", frame="tumor")


def _read_received_urdf(path: Path) -> None:
    robot_from_text(path.read_bytes().decode("utf-8", "replace"), allowed_dirs=[path.parent])


def _read_xacro(path: Path) -> None:
    data = expand_xacro(path, {}, ask=start_forked)
    robot_from_text(data.decode(), name=str(path), allowed_dirs=[path.parent])


def _read_mesh_map(path: Path) -> None:
    bodies_from_mesh_map(path.read_bytes().decode("utf-8", "replace"), allowed_dirs=[path.parent])


def _message(kind: str) -> Callable[[Path], None]:
    """Reads the message twice, by a new layout and by a known one, and makes samples of it."""

    def parse(path: Path) -> None:
        read = message_decoder(kind)
        values: Any = [read(path.read_bytes()) for _ in range(2)][1]
        for each in values if type(values) is tuple else [values]:
            if isinstance(each, PoseValues):
                each.sample()
            elif isinstance(each, JointValues):
                each.sample(offset_ns=0)

    return parse


def _read_tf(path: Path) -> None:
    try:
        tf_reader()(path.read_bytes())
    except ValueError as error:  # documented; its caller counts it
        raise InputError(str(error)) from error


def _read_stream(path: Path) -> None:
    """Feed the bytes in parts; a refused message is an error of the client, as in diagnostics."""
    data, refusals = path.read_bytes(), Refusals()
    stream, reader = MessageStream(TYPES, refusals), PoseReader(refusals)
    for at in range(0, len(data), 1 << 16):
        for message in stream.feed(data[at : at + (1 << 16)]):
            reader.read(message)
    if refusals.last:
        raise MarginGuardError(refusals.last)


def _read_image_stream(path: Path) -> None:
    refusals = Refusals()
    stream = MessageStream(("IMAGE",), refusals, MAX_IMAGE_BODY_BYTES)
    reader = ImageReader(refusals)
    for message in stream.feed(path.read_bytes()):
        reader.read(message)
    if refusals.last:
        raise MarginGuardError(refusals.last)


def _parser(
    name: str,
    file_name: str,
    parse: Callable[[Path], object],
    mutators: Sequence[Mutator],
    *folders: str,
    shipped_files: Sequence[str] = (),
    beside: Sequence[str] = (),
    names_file: bool = True,
) -> tuple[str, FuzzedParser]:
    """A parser by name, with the seeds of its folder or of ``folders``, and shipped files."""

    def seeds() -> list[bytes]:
        stored = [path for each in folders or (name,) for path in (SEEDS / each).glob("*")]
        return [path.read_bytes() for path in (*sorted(stored), *map(_shipped, shipped_files))]

    near = {path.name: path.read_bytes() for path in map(_shipped_or_stored, beside)}
    return name, FuzzedParser(file_name, parse, seeds, mutators, near, names_file)


def _shipped(path: str) -> Path:
    return shipped("data", *path.split("/"))


def _shipped_or_stored(path: str) -> Path:
    return _shipped(path) if "/" in path else SEEDS / "beside" / path


_CASE, _LIVE = "recorded_case/case.yaml", "live_example/live.yaml"
_EXPECTED, _WORLD = "recorded_case/expected.yaml", "worlds/lumpectomy/world.yaml"
_LOOPS, _WALL = "robots/parallelogram/parallelogram.yaml", "worlds/lumpectomy/chest_wall.stl"
_TUMOR: Any = {"frame": "tumor"}
_PART: Any = {"beside": ("part.stl",)}
_RECEIVED: Any = {"names_file": False}

PARSERS: dict[str, FuzzedParser] = dict(
    (
        # Files of numbers and names
        _parser(
            *("yaml", "document.yaml", load_yaml, YAML, "transform_yaml", "landmarks_yaml"),
            shipped_files=(_CASE, _LIVE),
        ),
        _parser("transform_yaml", "needle.yaml", _read_needle, YAML),
        _parser("transform_itk", "needle.tfm", _read_needle, TEXT),
        _parser("transform_hdf5", "needle.h5", _read_hdf5, RAW),
        _parser("landmarks_yaml", "points.yaml", read_landmarks, YAML),
        _parser("markups", "points.mrk.json", read_landmarks, JSON),
        _parser("fiducials", "points.fcsv", read_landmarks, TEXT),
        _parser("signal", "line.csv", read_signal, TEXT),
        _parser(
            *("plus_config", "plus.xml"),
            *(lambda path: read_plus_config(path).transform("stylus", "stylus_tip"), XML),
        ),
        # Meshes of cases and robots
        _parser("stl", "mesh.stl", _read_case_mesh, (*TEXT, *RAW)),
        _parser("ply", "mesh.ply", _read_case_mesh, (*TEXT, *RAW)),
        _parser("obj", "mesh.obj", read_robot_mesh, TEXT, beside=("two.mtl", "picture.png")),
        _parser("dae", "mesh.dae", read_robot_mesh, MORE_XML),
        _parser("glb", "mesh.glb", read_robot_mesh, (*RAW, *GLB)),
        _parser("gltf", "mesh.gltf", read_robot_mesh, GLTF, beside=("buffer.bin",)),
        # Robots and simulated worlds
        _parser("urdf", "arm.urdf", load_robot, XML, "urdf", "robot_description", **_PART),
        _parser("robot_description", "arm.urdf", _read_received_urdf, XML, **_PART, **_RECEIVED),
        _parser("xacro", "arm.xacro", _read_xacro, XACRO, beside=("part.xacro", "limits.yaml")),
        _parser("adf", "arm.yaml", load_robot, YAML, shipped_files=(_LOOPS,), **_PART),
        _parser("mesh_map", "map.txt", _read_mesh_map, TEXT, **_PART, **_RECEIVED),
        _parser(
            *("world_yaml", "world.yaml", open_world, YAML),
            shipped_files=(_WORLD,),
            beside=(_WALL,),
        ),
        # Recordings, tumours and configurations of cases
        _parser("mcap", "x.mcap", _read_frames, MCAP),
        _parser("recover", "x.mcap", _recover, MCAP, "mcap"),
        _parser("database", "x.db3", lambda path: _read_frames(path.parent), DATABASE),
        _parser("igs_mha", "x.igs.mha", _read_frames, TEXT),
        _parser("igs_nrrd", "x.igs.nrrd", _read_frames, TEXT),
        _parser("igs_mhd", "x.igs.mhd", _read_at_rate, TEXT),
        _parser("seq_mha", "x.seq.mha", _read_frames, TEXT, "igs_mha"),
        _parser(
            *("mrml", "x.mrml", _read_frames, MORE_XML),
            beside=("needle.seq.mha", "stylus.seq.mrml"),
        ),
        _parser("mrb", "x.mrb", _read_frames, ZIP),
        _parser("seq_mrb", "x.seq.mrb", _read_frames, ZIP),
        _parser("perk_tutor", "x.xml", _read_frames, XML),
        _parser(
            *("segmentation", "x.seg.nrrd"),
            *(lambda path: tumor_from_segmentation(path, segment="1", **_TUMOR), NRRD),
        ),
        _parser("contour", "x.mrk.json", lambda path: tumor_from_contour(path, **_TUMOR), JSON),
        _parser(
            *("case_yaml", "case.yaml", lambda path: load_manifest(path.parent), YAML),
            shipped_files=(_CASE,),
        ),
        _parser("live_yaml", "live.yaml", open_live, YAML, shipped_files=(_LIVE,)),
        _parser(
            *("expected_yaml", "expected.yaml"),
            *(lambda path: load_expected(path, reference="reference", robot_base="base"), YAML),
            shipped_files=(_EXPECTED,),
        ),
        # Images of ultrasound sequences
        _parser("images_mha", "x.igs.mha", _read_images, (*TEXT, *RAW)),
        _parser("images_mhd", "x.igs.mhd", _read_images, TEXT, beside=("x.raw",)),
        _parser("images_nrrd", "x.igs.nrrd", _read_images, (*TEXT, *NRRD)),
        # Messages from a network
        _parser("cdr_tracked", "message.cdr", _message(TRACKED_TRANSFORM), RAW, **_RECEIVED),
        _parser("cdr_tf", "message.cdr", _message(TF_MESSAGE), RAW, **_RECEIVED),
        _parser("cdr_joints", "message.cdr", _message(JOINT_STATE), RAW, **_RECEIVED),
        _parser("cdr_time", "message.cdr", _message(TIME_REFERENCE), RAW, **_RECEIVED),
        _parser("cdr_tf_buffer", "message.cdr", _read_tf, RAW, "cdr_tf", **_RECEIVED),
        _parser(
            *("cdr_image", "message.cdr"),
            *(lambda path: read_image_message(path.read_bytes(), 0), RAW),
            **_RECEIVED,
        ),
        _parser("igtl", "stream.bin", _read_stream, IGTL, **_RECEIVED),
        _parser("igtl_image", "stream.bin", _read_image_stream, IGTL, **_RECEIVED),
    )
)
