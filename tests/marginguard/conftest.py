"""Fields of the shipped case are computed once for all tests of the API."""

from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(autouse=True, scope="session")
def shared_fields(tmp_path_factory: pytest.TempPathFactory, no_field_cache: None) -> Iterator[Path]:
    """A cache of fields of this run alone."""
    folder = tmp_path_factory.mktemp("fields")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MARGINGUARD_FIELD_CACHE", str(folder))
        yield folder
