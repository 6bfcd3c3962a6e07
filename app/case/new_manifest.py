"""The declared documents of a case, and the writer of a commented one that can be opened."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from app.case.case import open_case
from app.case.live_file import LIVE, LIVE_2, open_live
from app.case.manifest.case_file import CASE, CASE_2, MANIFEST_NAME
from app.case.manifest.expected import EXPECTED
from app.files.atomic_io import write_file
from app.files.document_text import commented_yaml
from app.files.keys import Block
from app.geometry import InputError, MarginGuardError

DOCUMENTS = {"case": CASE, "case-2": CASE_2, "live": LIVE, "live-2": LIVE_2, "expected": EXPECTED}
"""Name of a document, with its schema unless that is 1 -> the declaration of its keys."""


def write_case_manifest(folder: Path, values: Mapping[str, Any]) -> Path:
    """Write ``case.yaml`` with ``values`` to ``folder``, which has the files that it names.

    Returns its path. The case is opened, with its meshes: raises `MarginGuardError` for one that
    cannot be, or if there is a ``case.yaml`` already; no file is left then.
    """

    def check() -> None:
        case = open_case(folder)
        case.tumor_mesh()
        case.tool_mesh()
        case.item_meshes()

    path = folder / MANIFEST_NAME
    _write(path, CASE, values, "A case of MarginGuard. Every key: docs/case_format.md", check)
    return path


def write_live_manifest(path: Path, values: Mapping[str, Any]) -> None:
    """Write a ``live.yaml`` with ``values`` to ``path``; raises as `write_case_manifest`."""

    def check() -> None:
        case = open_live(path).case
        case.tumor_mesh()
        case.tool_mesh()
        case.item_meshes()

    _write(path, LIVE, values, "A live session of MarginGuard. Every key: docs/live.md", check)


def _write(
    path: Path, block: Block, values: Mapping[str, Any], title: str, check: Callable[[], None]
) -> None:
    if os.path.lexists(path):
        raise InputError(f"{path} already exists; refusing to overwrite it")
    write_file(path, commented_yaml(block, values, title).encode())
    try:
        check()
    except MarginGuardError:
        path.unlink()
        raise
