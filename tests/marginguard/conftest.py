"""Fields of the shipped case are computed once for all tests of the API."""

from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(autouse=True, scope="package")
def shared_fields(tmp_path_factory: pytest.TempPathFactory, no_field_cache: None) -> Iterator[Path]:
    """Cache of fields for these tests alone; other tests have none (`no_field_cache`)."""
    folder = tmp_path_factory.mktemp("fields")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MARGINGUARD_FIELD_CACHE")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder
