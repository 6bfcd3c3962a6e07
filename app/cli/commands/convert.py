"""Copy a case to a new folder with its recording as MCAP; keeps stamps, statuses and joints."""

import argparse
import datetime
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.dicom_folder import VOXEL_MM, write_dicom
from app.cli.options import add_case, add_json, folder_path, input_argument
from app.cli.parsing import CommandParser
from app.files import check_output_path
from app.files.extras import check_installed
from app.geometry import InputError

if TYPE_CHECKING:
    from app.dicom import DicomStudy, Structure


SUMMARY = "copy a case or a recording that was cut to MCAP, export a tumour as DICOM"


def add_arguments(parser: CommandParser) -> None:
    """Declare the options of ``marginguard convert``."""
    add_case(parser)
    parser.add_argument(
        "folder", type=folder_path, metavar="DIR", help="new folder for the MCAP case"
    )
    parser.add_argument(
        "--schema",
        type=int,
        choices=(1, 2),
        default=1,
        help="2: write case.yaml in schema 2, with lists of structures, tools and robots",
    )
    recover = parser.add_subcommand(
        "recover", _run_recover, "copy a recording that was cut to an MCAP file with an index"
    )
    recover.add_argument(
        "recording",
        type=input_argument,
        metavar="RECORDING",
        help=".mcap file or rosbag2 folder; it is not changed",
    )
    recover.add_argument("file", type=Path, metavar="FILE", help="new .mcap file")
    _add_dicom_arguments(
        parser.add_subcommand(
            "dicom",
            _run_dicom,
            "export the tumour and other surfaces as DICOM segmentation and structure set",
        )
    )


def run(options: argparse.Namespace) -> int:
    """Convert the case and print the notes of the reader."""
    from app.case import convert_case, open_case

    case = open_case(options.case, package_dirs=options.package_dirs)
    convert_case(case, options.folder, schema=options.schema)
    for note in case.notes():
        print(f"note: {note}")
    print(f"wrote {options.folder}")
    return 0


def _run_recover(options: argparse.Namespace) -> int:
    """Copy the intact messages of a recording to a new MCAP file with an index, as after a
    crash.
    """
    from app.case import recover_recording

    if options.file.suffix.lower() != ".mcap":
        raise InputError(f"{options.file}: unknown ending; expected .mcap")
    check_output_path(options.file)
    counts, notes = recover_recording(options.recording, options.file)
    for note in notes:
        print(f"note: {note}")
    print(f"wrote {options.file}: {sum(counts.values())} messages of {len(counts)} topics")
    for topic, count in counts.items():
        print(f"  {topic}: {count}")
    return 0


def _add_dicom_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard convert dicom``."""
    add_case(parser)
    parser.add_argument(
        "--out", type=folder_path, required=True, metavar="DIR", help="new folder of the files"
    )
    parser.add_argument(
        "--structure",
        type=_structure,
        action="append",
        default=[],
        metavar="NAME=FILE",
        help="another closed surface (.stl, .ply, .obj) in mm, in the coordinates of the tumour's "
        "file; may be repeated",
    )
    parser.add_argument(
        "--voxel-mm",
        type=float,
        default=VOXEL_MM,
        metavar="S",
        help="edge of a voxel and distance of the contours' planes, 0.05 to 5 mm (%(default)s)",
    )
    parser.add_argument(
        "--ras-from-tumor",
        type=float,
        nargs=9,
        metavar="R",
        help="rotation from the tumour's axes to right, anterior, superior, row by row (default: "
        "the coordinates are RAS)",
    )
    parser.add_argument(
        "--frame-of-reference",
        metavar="UID",
        help="frame of reference of the images in whose coordinates the tumour is (default: one "
        "made from the tumour)",
    )
    parser.add_argument(
        "--patient", metavar="TEXT", help="name and ID of the patient (default: name of the case)"
    )
    parser.add_argument(
        "--date",
        type=_date,
        metavar="YYYY-MM-DD",
        help="date of the study (default: empty; 1970-01-01 where DICOM requires one)",
    )
    add_json(parser)


def _run_dicom(options: argparse.Namespace) -> int:
    """Export the tumour of a case, and other closed surfaces, as DICOM.

    Writes a segmentation, an RT structure set and the images that both refer to. A case has no
    images: the written ones are a grid without a picture. Coordinates of the case are taken as RAS
    and written as LPS. The same input gives the same files, with the same identifiers.
    """
    from app.runtime import prepare_case

    check_installed("highdicom", "pydicom")
    from app.dicom import Structure

    content = prepare_case(options.case, package_dirs=options.package_dirs).content
    axes = options.ras_from_tumor
    study = write_dicom(
        options.out,
        [Structure("tumor", content.tumor), *_structures(options, content.tumor.frame)],
        ras_from_tumor=None if axes is None else [axes[k : k + 3] for k in (0, 3, 6)],
        patient=options.patient or content.name,
        voxel_mm=options.voxel_mm,
        frame_of_reference_uid=options.frame_of_reference,
        date=options.date,
    )
    print(json.dumps(_as_json(study), indent=2) if options.json else _as_text(study, options.out))
    return 0


def _structures(options: argparse.Namespace, frame: str) -> list["Structure"]:
    from app.dicom import Structure
    from app.files import load_mesh

    return [
        Structure(name, load_mesh(path, units="mm", frame=frame))
        for name, path in options.structure
    ]


def _as_json(study: "DicomStudy") -> dict[str, Any]:
    return {
        "files": list(study.files),
        "structures": [
            {
                "name": each.name,
                "surface_mm3": round(each.surface_mm3, 3),
                "segmentation_mm3": round(each.segmentation_mm3, 3),
                "contours_mm3": round(each.contours_mm3, 3),
            }
            for each in study.volumes
        ],
    }


def _as_text(study: "DicomStudy", folder: Path) -> str:
    lines = [
        f"{each.name}: {each.surface_mm3:.1f} mm3, {each.segmentation_mm3:.1f} mm3 in voxels, "
        f"{each.contours_mm3:.1f} mm3 in contours"
        for each in study.volumes
    ]
    return "\n".join([*lines, f"wrote {len(study.files)} files to {folder}"])


def _structure(text: str) -> tuple[str, Path]:
    name, separator, path = text.partition("=")
    if not (name.strip() and separator and path):
        raise argparse.ArgumentTypeError(f"{text!r}; expected NAME=FILE")
    if len(name) > 64 or "\\" in name or not name.isprintable():
        raise argparse.ArgumentTypeError(
            f"name {name!r}; expected 64 printable characters at most, without a backslash"
        )
    return name.strip(), Path(path)


def _date(text: str) -> datetime.date:
    try:
        return datetime.date.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}; expected YYYY-MM-DD") from error
