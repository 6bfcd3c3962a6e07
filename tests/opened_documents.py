"""Fixture that compares reader and schema on every document that a test of this process opens.

So each valid and each broken case.yaml, live.yaml and expected.yaml of the suite tests the schemas.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(autouse=True, scope="session")
def opened_documents_agree_with_their_schema() -> Iterator[None]:
    """Fail the last test of the process where reader and schema of a document differ."""
    from app.files.document import Section
    from app.files.yaml_file import load_yaml
    from app.geometry import MarginGuardError

    load = Section.load.__func__
    found: dict[str, str] = {}

    def checked_load(cls: type[Section], path: Path, block: Any) -> Section:
        # Imported here, because most processes open no such document.
        from app.case import DOCUMENTS
        from tests.schema_agreement import disagreement

        for name in (name for name, known in DOCUMENTS.items() if known is block):
            try:
                values = load_yaml(path)
            except MarginGuardError:
                break  # not YAML: the reader refuses it, and there are no values to validate
            if values is not None and (problem := disagreement(name, values)):
                found[str(path)] = problem
        return load(cls, path, block)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Section, "load", classmethod(checked_load))
        yield
    assert not found, found
