"""Converts a case to MCAP. Stamps and statuses are kept, of a bag all messages of all topics."""

import shutil
from pathlib import Path, PurePosixPath

import yaml

from app.case.case import Case
from app.case.copying import write_messages
from app.case.manifest.case_file import MANIFEST_NAME
from app.case.messages.ros_messages import JOINT_STATES_TOPIC
from app.case.recorder.recorder import write_recording
from app.files.atomic_io import new_folder
from app.files.packages import PACKAGE_SCHEME
from app.files.paths import resolve_inside, sha256_of
from app.files.yaml_file import load_yaml
from app.geometry import InputError

RECORDING_NAME = "tracking.mcap"


def convert_case(case: Case, folder: Path) -> tuple[str, ...]:
    """Write ``case`` to the new folder ``folder`` with its recording as MCAP.

    Copies the files that the manifest names, except those of packages. Returns the notes of the
    reader. Raises `InputError` when ``folder`` exists or cannot be written; no folder is left after
    an error.
    """
    with new_folder(folder) as partial:
        _write(case, partial)
    return case.notes()


def _write(case: Case, folder: Path) -> None:
    copy_named_files(case, folder)
    recording = folder / RECORDING_NAME
    robot = case.manifest.robot
    messages = case.recorded_messages()
    if messages is None:
        write_recording(
            recording,
            case.recorded_frames(),
            robot_to_tracker_offset_ns=case.manifest.clock.offset_robot_to_tracker_ns,
            joint_states_topic=(robot and robot.joint_states) or JOINT_STATES_TOPIC,
        )
    else:
        write_messages(recording, messages)
        # Refuse a recording that cannot be replayed, and note what a replay skips.
        for _ in case.copied_frames(recording):
            pass
    # Not parsed again: it was checked when the case was opened, and stays but for the recording.
    manifest = load_yaml(case.folder / MANIFEST_NAME)
    manifest["recording"] = {"path": RECORDING_NAME, "sha256": sha256_of(recording)}
    text = yaml.safe_dump(manifest, sort_keys=False, allow_unicode=True)
    (folder / MANIFEST_NAME).write_text(text, encoding="utf-8")


def copy_named_files(case: Case, folder: Path, *, with_tumor: bool = True) -> None:
    """Copy the files that the manifest names, except the recording, to ``folder``."""
    for name in _named_files(case, with_tumor=with_tumor):
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        source = resolve_inside(case.folder, name, name)
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
        else:
            shutil.copyfile(source, target)


def _named_files(case: Case, *, with_tumor: bool) -> list[str]:
    """Files of the case folder other than the recording, relative to it."""
    manifest = case.manifest
    names = [manifest.tumor.shape.path] if with_tumor else []
    if manifest.tool.mesh is not None:
        names.append(manifest.tool.mesh.path)
    if manifest.needle is not None and manifest.needle.model is not None:
        names.append(manifest.needle.model.path)
    if manifest.expected is not None:
        names.append(manifest.expected)
    if manifest.images is not None:
        names += [each.path for each in manifest.images.calibrations if each.path is not None]
    if manifest.robot is not None and not manifest.robot.urdf.startswith(PACKAGE_SCHEME):
        # A URDF names its meshes relative to itself, so its folder is copied.
        parent = str(PurePosixPath(manifest.robot.urdf).parent)
        if parent == ".":
            raise InputError(
                f"case.yaml: robot.urdf is {manifest.robot.urdf!r}; "
                "expected a file in a folder of its own, which can be copied"
            )
        names.append(parent)
    return [name for name in names if not name.startswith(PACKAGE_SCHEME)]
