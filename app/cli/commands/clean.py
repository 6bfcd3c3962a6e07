"""List the caches that MarginGuard keeps on disk, and remove them with --yes.

These are compiled kernels, distance fields and convex parts. The next command that needs them
makes them again, the kernels in a minute or two. Symbolic links are not followed. Exit status: 0; 1
when something could not be read or removed.
"""

import argparse
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from app.cli.options import add_json

if TYPE_CHECKING:
    from app.cli.caches import CacheContent

SUMMARY = "list or remove caches"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``marginguard clean``."""
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument("--yes", action="store_true", help="remove what is listed")
    chosen.add_argument(
        "--dry-run", action="store_true", help="list only, remove nothing (the default)"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """List the caches, or remove them."""
    from app.cli.caches import cache_folders, inspect, remove

    visit = remove if options.yes else inspect
    visited = [visit(folder) for folder in cache_folders()]
    contents = [content for content in visited if content.count or content.problem]
    if options.json:
        print(json.dumps([as_json(content) for content in contents], indent=2))
    else:
        print(as_text(contents, removed=options.yes))
    return 1 if any(content.problem for content in contents) else 0


def as_json(content: "CacheContent") -> dict[str, Any]:
    """Describe the files of one folder with values that JSON can hold."""
    return {
        "kind": content.folder.kind,
        "folder": str(content.folder.path),
        "files": content.count,
        "bytes": content.size_bytes,
        "problem": content.problem,
    }


def as_text(contents: Sequence["CacheContent"], *, removed: bool) -> str:
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
