"""Options that several commands share."""

import argparse
from collections.abc import Callable
from pathlib import Path


def add_case(parser: argparse.ArgumentParser) -> None:
    """The case folder, and where the packages that it names are found."""
    parser.add_argument("case", type=folder_path, metavar="CASE", help="folder with a case.yaml")
    add_package_dirs(parser)


def add_package_dirs(parser: argparse.ArgumentParser) -> None:
    """Where ``package://`` names are found."""
    parser.add_argument(
        "--package-dir",
        type=existing_folder,
        action="append",
        default=[],
        metavar="DIR",
        dest="package_dirs",
        help="where package://NAME/... is found: the folder NAME, or one that holds it; "
        "may be given again",
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Output for a program instead of a person."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")


def folder_path(text: str) -> Path:
    """A folder's path; an empty one is a mistake in a script, not the current folder."""
    if not text:
        raise argparse.ArgumentTypeError("the name of the folder is empty")
    return Path(text)


def existing_folder(text: str) -> Path:
    """The path of a folder that is there: a misspelt one is said before anything is read."""
    path = folder_path(text)
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} is no folder")
    return path


def file_path(ending: str) -> Callable[[str], Path]:
    """The type of an option that takes a file to be written, which must end so."""

    def checked(text: str) -> Path:
        if not text.lower().endswith(ending) or Path(text).name.lower() == ending:
            raise argparse.ArgumentTypeError(f"{text!r} does not end with {ending}")
        return Path(text)

    return checked
