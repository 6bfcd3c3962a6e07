"""Options that several commands share."""

import argparse
from collections.abc import Callable
from pathlib import Path


def add_case(parser: argparse.ArgumentParser) -> None:
    """Add the case folder and the folders of packages."""
    parser.add_argument("case", type=folder_path, metavar="CASE", help="folder with a case.yaml")
    add_package_dirs(parser)


def add_package_dirs(parser: argparse.ArgumentParser) -> None:
    """Add the folders in which ``package://`` names are resolved."""
    parser.add_argument(
        "--package-dir",
        type=existing_folder,
        action="append",
        default=[],
        metavar="DIR",
        dest="package_dirs",
        help="where package://NAME/... is found: the folder NAME, or its parent; may be repeated",
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add output for programs."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def folder_path(text: str) -> Path:
    """Path of a folder. An empty text is refused: a script has made a mistake."""
    if not text:
        raise argparse.ArgumentTypeError("the name of the folder is empty; expected a path")
    return Path(text)


def existing_folder(text: str) -> Path:
    """Path of an existing folder; checked before anything is read."""
    path = folder_path(text)
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r}: no such folder; expected an existing one")
    return path


def file_path(ending: str) -> Callable[[str], Path]:
    """Type of an option for an output file whose name ends with ``ending``."""

    def checked(text: str) -> Path:
        if not text.lower().endswith(ending) or Path(text).name.lower() == ending:
            raise argparse.ArgumentTypeError(
                f"{text!r}; expected a file name that ends with {ending}"
            )
        return Path(text)

    return checked
