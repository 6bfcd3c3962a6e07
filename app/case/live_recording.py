"""Writes a case folder for a live recording: everything but the recording, before it starts."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from app.case.convert import copy_named_files
from app.case.live_file import ONLY_LIVE, IgtlSourceEntry, LiveCase, TopicSourceEntry
from app.case.manifest.case_file import MANIFEST_NAME
from app.case.messages.ros_messages import TRACKED_TRANSFORMS_TOPIC
from app.case.new_case import margin_values
from app.case.readers.rosbag2 import CHANGES_NAME
from app.case.session_values import RegistrationValues, SessionValues, check_frames
from app.files.atomic_io import new_folder, write_file
from app.files.meshes import write_exact_ply
from app.files.yaml_file import load_yaml
from app.geometry import InputError

RECORDING_FOLDER = "tracking"

TUMOR_NAME = "tumor_of_session.ply"
"""File in a recorded case of a tumour that an operator of the session has accepted."""

IGTL_IMAGES_TOPIC = "/marginguard/images"
"""Topic in a recording of the images that came over the session's OpenIGTLink connection."""


IGTL_CAUTERY_TOPIC = "/marginguard/cautery"
"""Topic in a recording of the cautery's state that came over the OpenIGTLink connection."""


@dataclass(frozen=True, slots=True)
class SessionChange:
    """Tumour and registration of a session from the time ``received_ns`` (since 1970) on.

    ``replaced`` names the parts that are not those of the case.
    """

    received_ns: int
    model_id: str
    registration_id: str
    replaced: str


def write_changes(changes: Sequence[SessionChange], recording: Path) -> None:
    """Write ``changes.yaml`` to the folder ``recording``; `InputError` where that fails."""
    text = yaml.safe_dump({"changes": [asdict(change) for change in changes]}, sort_keys=False)
    write_file(recording / CHANGES_NAME, text.encode())


def begin_case(live: LiveCase, folder: Path, values: SessionValues | None = None) -> None:
    """Write ``case.yaml`` and the files that it names, except the recording, to ``folder``.

    ``folder`` must not exist. The recording is expected in the rosbag2 folder ``tracking``.
    ``values`` are those that a session uses at present in the place of those of ``live``. Raises
    `InputError` for a source that a case cannot hold, and `FrameError` for ``values`` of other
    frames.
    """
    source = live.source
    if isinstance(source, TopicSourceEntry) and source.topic != TRACKED_TRANSFORMS_TOPIC:
        raise InputError(
            f"{live.case.manifest.file}: source.tracked_transforms.topic is {source.topic!r}; "
            f"expected {TRACKED_TRANSFORMS_TOPIC}, the topic of a case"
        )
    if values is not None:
        tool, tumor = live.case.manifest.tool, live.case.manifest.tumor
        check_frames(values, tool.tool_from_tip, tumor.frame_from_tumor)
    with new_folder(folder) as partial:
        _write(live, partial, values)


def _write(live: LiveCase, folder: Path, in_use: SessionValues | None) -> None:
    is_other_tumor = in_use is not None and in_use.tumor is not None
    copy_named_files(live.case, folder, with_tumor=not is_other_tumor)
    # Not parsed again: it was checked when it was opened.
    path = live.case.folder / live.case.manifest.file
    values = load_yaml(path)
    for name in ONLY_LIVE:
        values.pop(name, None)
    if live.case.manifest.images is not None:
        values["images"].pop("device", None)
        if isinstance(live.source, IgtlSourceEntry):
            values["images"].setdefault("topic", IGTL_IMAGES_TOPIC)
    if live.case.manifest.cautery is not None:
        values["cautery"].pop("device", None)
        values["cautery"].setdefault("topic", IGTL_CAUTERY_TOPIC)
    robot = live.case.manifest.robot
    if live.joints_of_host and not live.stamps_of_host and robot and robot.joint_states:
        values["clock"] = {"estimate": True}  # the offset of the two clocks is unknown
    values["recording"] = {"path": RECORDING_FOLDER}
    if in_use is not None:
        _use(in_use, values, folder)
    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
    (folder / MANIFEST_NAME).write_text(text, encoding="utf-8")


def _use(in_use: SessionValues, values: dict[str, Any], folder: Path) -> None:
    """Replace the keys of ``values``, those of a ``case.yaml``, by the values in use."""
    tool, tumor = values["tool"], values["tumor"]
    tool["tip_from"] = {"matrix": in_use.tool_from_tip.matrix.ravel().tolist()}
    tool["sigma_mm"] = in_use.tip_sigma_mm
    tumor["pose"] = {"matrix": in_use.frame_from_tumor.matrix.ravel().tolist()}
    tumor["sigma_mm"] = in_use.tumor_sigma_mm
    if in_use.tumor is not None:
        write_exact_ply(folder / TUMOR_NAME, in_use.tumor)
        tumor.pop("contour", None)
        tumor["mesh"] = {"path": TUMOR_NAME, "units": "mm"}
    values["margins"] = margin_values(in_use.margins)
    if in_use.needle_length_mm is not None and "needle" in values:
        values["needle"]["length_mm"] = in_use.needle_length_mm
    if in_use.stylus_from_tip is not None and "stylus" in values:
        matrix = in_use.stylus_from_tip.matrix.ravel().tolist()
        values["stylus"] |= {"tip_from": {"matrix": matrix}, "sigma_mm": in_use.stylus_sigma_mm}
    if in_use.image_depth_mm is not None and "calibrations" in values.get("images", {}):
        values["images"]["depth_mm"] = in_use.image_depth_mm
    if in_use.registration is not None:
        values["registration"] = _given(in_use.registration, values["registration"])


def _given(registration: RegistrationValues, before: dict[str, Any]) -> dict[str, Any]:
    """The keys of a registration by its pose, with the limits of the one ``before``."""
    matrix = registration.reference_from_base.matrix.ravel().tolist()
    values: dict[str, Any] = {"method": "given", "matrix": matrix}
    if registration.covariance is not None:
        values["covariance"] = registration.covariance.ravel().tolist()
        if registration.degrees_of_freedom is not None:
            values["degrees_of_freedom"] = registration.degrees_of_freedom
    values.update((key, before[key]) for key in ("max_drift_mm", "max_drift_deg") if key in before)
    return values
