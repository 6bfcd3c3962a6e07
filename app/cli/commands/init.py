"""Write a commented case.yaml or live.yaml from options, or from answers on a terminal.

A required value without an option is asked for on a terminal; elsewhere it is an error. The file
has the description of each key, and the keys that are left out as comments. It is opened before
the command ends, with the files that it names: one that cannot be opened is removed. Exit status:
0; 2 on bad input.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.options import folder_path
from app.files.bounded_io import is_folder
from app.geometry import InputError

if TYPE_CHECKING:
    from app.geometry import Transform

SUMMARY = "write a commented case.yaml or live.yaml from options or answers"

_IDENTITY = "identity"
_MARGINS = {
    "stop_mm": (1.0, "distance from which the constraint acts"),
    "warn_mm": (5.0, "distance from which the state is WARNING"),
    "k_tre": (2.0, "multiples of the registration's sigma that are added"),
    "v_max_mm_s": (50.0, "largest speed, for the age of the samples"),
    "stale_after_ms": (200.0, "maximum age of a sample"),
}
_POSE_HELP = "file with the pose of the %s (16 numbers, ITK, YAML), or 'identity'"
_NEEDLE = {"needle_frame", "needle_length_mm", "needle_direction", "needle_model"}
_SOURCES = ("tracked_transforms", "tf", "igtl")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard init``."""
    parser.add_argument("document", choices=("case", "live"), help="the kind of file")
    parser.add_argument(
        "folder", type=folder_path, metavar="FOLDER",
        help="folder with the files to be named; case.yaml or live.yaml is written to it",
    )  # fmt: skip
    texts = {
        "name": "name of the case, shown in reports",
        "recording": "case: the recorded tracking data, in FOLDER",
        "source": f"live: {', '.join(_SOURCES)} (then --igtl)",
        "igtl": "live: HOST:PORT of the OpenIGTLink server",
        "tool-frame": "tracked frame of the tool",
        "tool-mesh": "closed surface of the tool in the frame of its tip",
        "tool-tip": _POSE_HELP % "tip in the tool's frame",
        "tumor-frame": "tracked frame that the tumour moves with",
        "tumor-mesh": "closed surface of the tumour",
        "tumor-pose": _POSE_HELP % "tumour in its frame",
        "needle-frame": "tracked frame of a needle, which is drawn and nothing else",
        "needle-model": "its surface in the frame of its tip; by default a thin needle",
        "stylus-frame": "tracked frame of a stylus, with which points are touched",
        "stylus-tip": "file with its tip in that frame; without it the session calibrates it",
    }
    for name, text in texts.items():
        parser.add_argument(f"--{name}", metavar="TEXT", help=text)
    parser.add_argument(
        "--needle-length-mm", type=float, metavar="N", help="from the needle's sensor to its tip"
    )
    parser.add_argument(
        "--needle-direction", type=float, nargs=3, metavar=("X", "Y", "Z"),
        help="direction from the needle's sensor to its tip, in its frame (0 0 1)",
    )  # fmt: skip
    parser.add_argument(
        "--kind", choices=("recorded", "simulated"), default="recorded",
        help="origin of the data (%(default)s)",
    )  # fmt: skip
    parser.add_argument("--origin", default="not stated", help="where the data come from")
    parser.add_argument("--licence", default="not stated", help="licence of the data")
    parser.add_argument(
        "--clock", choices=("host", "estimate"), default="host",
        help="live: the stamps are of this machine's clock, or of another one (%(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--units", choices=("mm", "cm", "m"), default="mm", help="of the meshes (%(default)s)"
    )
    for name, (value, text) in _MARGINS.items():
        parser.add_argument(
            f"--{name.replace('_', '-')}", type=float, default=value, metavar="N",
            help=f"{text} (%(default)s)",
        )  # fmt: skip
    for name, text in (
        ("images-probe", "tracked frame of an ultrasound probe, whose images are shown"),
        ("images-calibration", "its ImageToProbe: a PLUS configuration or a transform file"),
        ("images-topic", "topic of its sensor_msgs/Image"),
    ):
        parser.add_argument(f"--{name}", metavar="TEXT", help=text)


def run(options: argparse.Namespace) -> int:
    """Ask for what is missing, write the file and open it."""
    from app.case import write_case_manifest, write_live_manifest

    if not is_folder(options.folder):
        raise InputError(f"{options.folder} is not a folder; expected one with the files to name")
    answers = _Answers(options)
    values = _values(answers)
    if options.document == "case":
        path = write_case_manifest(options.folder, values)
        then = f"marginguard replay {options.folder}"
    else:
        path = options.folder / "live.yaml"
        write_live_manifest(path, values)
        then = f"marginguard live --config {path}"
    print(f"wrote {path}; next: {then}")
    return 0


class _Answers:
    """Values of the options, and answers to questions for those that are missing."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options

    def text(self, name: str, question: str, default: str = "") -> str:
        """The option ``name``, or an answer; raises `InputError` without a terminal."""
        given = getattr(self.options, name)
        if given is None and default and not sys.stdin.isatty():
            given = default
        if given is None and sys.stdin.isatty():
            print(f"{question}{f' [{default}]' if default else ''}: ", end="", file=sys.stderr)
            sys.stderr.flush()
            given = sys.stdin.readline().strip() or default
        if not given:
            raise InputError(
                f"--{name.replace('_', '-')} is missing; expected it, or a terminal to ask on"
            )
        return str(given)

    def pose(self, name: str, question: str, target: str, source: str) -> "Transform":
        """The pose in the file that is named; the identity for 'identity'."""
        from app.files.transforms import read_transform
        from app.geometry import Transform

        file = self.text(name, f"{question}, or '{_IDENTITY}'")
        if file == _IDENTITY:
            return Transform.identity(target, source)
        return read_transform(Path(file), target=target, source=source)

    def file(self, name: str, question: str) -> str:
        """A path as it is written in the file: relative in the folder, else absolute."""
        text = self.text(name, question)
        if text.startswith("package://"):
            return text
        folder, path = self.options.folder.resolve(), Path(text)
        found = path if path.exists() else folder / text
        resolved = found.resolve()
        inside = resolved.is_relative_to(folder)
        return resolved.relative_to(folder).as_posix() if inside else str(resolved)


def _values(answers: _Answers) -> dict[str, Any]:
    """The values of the document."""
    from app.case.new_case import placed_mesh

    options = answers.options
    values: dict[str, Any] = {
        "schema": 1,
        "name": answers.text("name", "Name of the case", options.folder.resolve().name),
        "provenance": {
            "kind": options.kind,
            "source": options.origin,
            "licence": options.licence,
        },
    }
    if options.document == "case":
        values["recording"] = {"path": answers.file("recording", "Recording in the folder")}
    else:
        values["source"] = _source(answers)
    tool = answers.text("tool_frame", "Tracked frame of the tool")
    mesh = answers.file("tool_mesh", "Mesh of the tool, in the frame of its tip")
    tip = answers.pose("tool_tip", "File with the pose of the tip", tool, f"{tool}_tip")
    values["tool"] = placed_mesh(mesh, tip, "tip_from", options.units)
    holder = answers.text("tumor_frame", "Tracked frame that the tumour moves with")
    mesh = answers.file("tumor_mesh", "Mesh of the tumour")
    pose = answers.pose("tumor_pose", "File with the pose of the tumour", holder, "tumor")
    values["tumor"] = placed_mesh(mesh, pose, units=options.units)
    values["margins"] = {name: getattr(options, name) for name in _MARGINS}
    if _NEEDLE.intersection(name for name, given in vars(options).items() if given is not None):
        values["needle"] = _needle(answers)
    if options.stylus_frame is not None or options.stylus_tip is not None:
        values["stylus"] = _stylus(answers)
    if options.images_probe is not None:
        values["images"] = _images(answers)
    return values


def _needle(answers: _Answers) -> dict[str, Any]:
    options = answers.options
    for name in ("needle_frame", "needle_length_mm"):
        if getattr(options, name) is None:
            raise InputError(
                f"--{name.replace('_', '-')} is missing; expected it for a needle, which has a "
                "frame and a length"
            )
    values: dict[str, Any] = {
        "frame": options.needle_frame,
        "length_mm": options.needle_length_mm,
    }
    if options.needle_direction is not None:
        values["tip_from"] = {"direction": options.needle_direction}
    if options.needle_model is not None:
        path = answers.file("needle_model", "Model of the needle")
        values["model"] = {"path": path, "units": options.units}
    return values


def _stylus(answers: _Answers) -> dict[str, Any]:
    frame = answers.options.stylus_frame
    if frame is None:
        raise InputError("--stylus-frame is missing; expected it for a stylus, which has a frame")
    if answers.options.stylus_tip is None:
        return {"frame": frame}
    from app.case.new_case import matrix_values

    tip = answers.pose("stylus_tip", "File with the tip of the stylus", frame, f"{frame}_tip")
    return {"frame": frame, "tip_from": matrix_values(tip)}


def _images(answers: _Answers) -> dict[str, str]:
    topic = answers.options.images_topic
    return {
        **({} if topic is None else {"topic": topic}),
        "probe": answers.options.images_probe,
        "calibration": answers.file("images_calibration", "ImageToProbe of the probe"),
    }


def _source(answers: _Answers) -> dict[str, Any]:
    name = answers.text("source", f"Source of the poses ({', '.join(_SOURCES)})", _SOURCES[0])
    if name not in _SOURCES:
        raise InputError(f"--source is {name[:40]!r}; expected one of {', '.join(_SOURCES)}")
    entry: dict[str, Any] = {}
    if name == "igtl":
        server = answers.text("igtl", "HOST:PORT of the server", "localhost:18944")
        host, _, port = server.rpartition(":")
        if not (host and port.isascii() and port.isdigit() and 0 < int(port[:6]) < 1 << 16):
            raise InputError(f"--igtl is {server[:60]!r}; expected HOST:PORT")
        entry = {"host": host, "port": int(port)}
    return {name: entry, "clock": answers.options.clock}
