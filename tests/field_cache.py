"""A cache of fields for tests of a folder; all other tests have none (`no_field_cache`).

A `conftest.py` or a test file imports both fixtures.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def fields_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fields")


@pytest.fixture(autouse=True, scope="module")
def shared_fields(fields_folder: Path, no_field_cache: None) -> Iterator[Path]:
    """The field of a surface is computed once for all tests that share the folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MARGINGUARD_FIELD_CACHE")
        patch.setenv("XDG_CACHE_HOME", str(fields_folder))
        yield fields_folder
