"""Check this installation: what is installed, what is missing, and the remedy.

Exit status: 0 when nothing is missing, 1 when something is.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.options import (
    add_json,
    existing_folder,
    file_path,
    folder_path,
    input_argument,
    output_path,
    package_folder,
)
from app.cli.parsing import CommandParser

if TYPE_CHECKING:
    from app.cli.caches import CacheContent


SUMMARY = "check the installation; schemas of files, completion of shells, caches"


def add_arguments(parser: CommandParser) -> None:
    """Declare the options of ``marginguard doctor``."""
    add_json(parser)
    _add_schema_arguments(
        parser.add_subcommand(
            "schema",
            _run_schema,
            "print the JSON Schema of case, live, expected, world, control or cohort.yaml",
        )
    )
    parser.add_subcommand(
        "completion", _run_completion, "print the completion script of a shell"
    ).add_argument("shell", choices=SHELLS, help="the shell that reads the script")
    _add_clean_arguments(parser.add_subcommand("clean", _run_clean, "list or remove caches"))


def run(options: argparse.Namespace) -> int:
    """Run the checks and print their results."""
    from app.cli.installation_checks import check_environment

    checks = check_environment()
    if options.json:
        print(json.dumps([check._asdict() for check in checks], indent=2))
    else:
        for check in checks:
            print(f"{'ok' if check.ok else 'MISSING':<8} {check.name:<22} {check.found}")
            if check.remedy:
                print(f"{'':<8} {'':<22} {check.remedy}")
    return 0 if all(check.ok for check in checks) else 1


SCHEMA_NAMES = ("case", "case-2", "live", "live-2", "expected", "world", "control", "cohort")


def _add_schema_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard doctor schema``."""
    parser.add_argument("document", choices=SCHEMA_NAMES, help="the file that the schema describes")
    parser.add_argument(
        "-o",
        "--output",
        type=file_path(".json"),
        metavar="FILE",
        help="write the schema to FILE (.json)",
    )


def _run_schema(options: argparse.Namespace) -> int:
    """Print the JSON Schema of case, live, expected, world, control or cohort.yaml.

    An editor with a YAML language server completes keys with it, shows their descriptions and marks
    errors. case-2 and live-2 are those of schema 2. A schema is generated from the declarations
    that the reader of the file uses. A few rules cannot be stated in JSON Schema: it lists them as
    comments.
    """
    from app.case import DOCUMENTS
    from app.cohort import COHORT
    from app.control import CONTROL
    from app.files import schema_text, write_file
    from app.simulation import WORLD

    blocks = {**DOCUMENTS, "world": WORLD, "control": CONTROL, "cohort": COHORT}
    text = schema_text(blocks[options.document], options.document)
    if options.output is None:
        print(text, end="")
        return 0
    write_file(options.output, text.encode())
    print(f"wrote {options.output}")
    return 0


SHELLS = ("bash", "zsh", "tcsh")
_FOLDERS = (folder_path, existing_folder, package_folder)
_FILES = (Path, input_argument, output_path)


def _run_completion(options: argparse.Namespace) -> int:
    """Print a script with which a shell completes commands, options, choices and paths.

    bash: eval "$(marginguard doctor completion bash)" in ~/.bashrc. zsh: save it as _marginguard in
    a folder of $fpath. tcsh: save it and source it in ~/.tcshrc.
    """
    import shtab

    from app.cli.main import build_parser

    parser = build_parser()
    _complete_paths(parser, shtab.FILE, shtab.DIRECTORY)
    print(shtab.complete(parser, options.shell))
    return 0


def _complete_paths(
    parser: argparse.ArgumentParser, file: Mapping[str, Any], folder: Mapping[str, Any]
) -> None:
    """Let the shell complete sub-commands, and paths where the type of an argument is a path."""
    if isinstance(parser, CommandParser) and parser.subcommands is not None:
        parser._actions.append(parser.subcommands)  # shtab knows it as an argument only
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for subparser in set(action.choices.values()):
                _complete_paths(subparser, file, folder)
        elif action.type is not None and action.choices is None:
            if action.type in _FOLDERS:
                action.complete = folder  # type: ignore[attr-defined]
            elif action.type in _FILES or hasattr(action.type, "is_file_path"):
                action.complete = file  # type: ignore[attr-defined]


def _add_clean_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard doctor clean``."""
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument("--yes", action="store_true", help="remove what is listed")
    chosen.add_argument(
        "--dry-run", action="store_true", help="list only, remove nothing (the default)"
    )
    add_json(parser)


def _run_clean(options: argparse.Namespace) -> int:
    """List the caches that MarginGuard keeps on disk, and remove them with --yes.

    These are compiled kernels, distance fields and convex parts. The next command that needs them
    makes them again, the kernels in a minute or two. Symbolic links are not followed. Exit status:
    0; 1 when something could not be read or removed.
    """
    from app.cli.caches import cache_folders, visit

    visited = [visit(folder, removing=options.yes) for folder in cache_folders()]
    contents = [content for content in visited if content.count or content.problem]
    if options.json:
        print(json.dumps([_as_json(content) for content in contents], indent=2))
    else:
        print(_as_text(contents, removed=options.yes))
    return 1 if any(content.problem for content in contents) else 0


def _as_json(content: "CacheContent") -> dict[str, Any]:
    """Describe the files of one folder with values that JSON can hold."""
    return {
        "kind": content.folder.kind,
        "folder": str(content.folder.path),
        "files": content.count,
        "bytes": content.size_bytes,
        "problem": content.problem,
    }


def _as_text(contents: Sequence["CacheContent"], *, removed: bool) -> str:
    """One line for each folder, and the sum."""
    lines = [
        f"{_size(content.size_bytes)} {content.count:5d} files  {content.folder.kind:<16}  "
        f"{content.folder.path}{content.problem and f': {content.problem}'}"
        for content in contents
    ]
    total = _size(sum(content.size_bytes for content in contents))
    count = sum(content.count for content in contents)
    done = "removed" if removed else "in all; --yes removes them"
    return "\n".join([*lines, f"{total} {count:5d} files  {done}"])


def _size(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:8.1f} MB"
