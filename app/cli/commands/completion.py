"""Print a script with which a shell completes commands, options, choices and paths.

bash: eval "$(marginguard completion bash)" in ~/.bashrc. zsh: save it as _marginguard in a folder
of $fpath. tcsh: save it and source it in ~/.tcshrc.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.cli.options import (
    existing_folder,
    folder_path,
    input_argument,
    output_path,
    package_folder,
)

SUMMARY = "print the completion script of a shell"
SHELLS = ("bash", "zsh", "tcsh")
_FOLDERS = (folder_path, existing_folder, package_folder)
_FILES = (Path, input_argument, output_path)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard completion``."""
    parser.add_argument("shell", choices=SHELLS, help="the shell that reads the script")


def run(options: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    _complete_paths(options.parser, shtab.FILE, shtab.DIRECTORY)
    print(shtab.complete(options.parser, options.shell))
    return 0


def _complete_paths(
    parser: argparse.ArgumentParser, file: Mapping[str, Any], folder: Mapping[str, Any]
) -> None:
    """Let the shell complete paths for every option and argument that has a path as its type."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for subparser in set(action.choices.values()):
                _complete_paths(subparser, file, folder)
        elif action.type is not None and action.choices is None:
            if action.type in _FOLDERS:
                action.complete = folder  # type: ignore[attr-defined]
            elif action.type in _FILES or hasattr(action.type, "is_file_path"):
                action.complete = file  # type: ignore[attr-defined]
