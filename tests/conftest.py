"""Fixtures that every room shares."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.browser import browser as browser

PROJECT_ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(autouse=True, scope="session")
def no_field_cache() -> Iterator[None]:
    """Tests neither read nor fill the user's cache of fields."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MARGINGUARD_FIELD_CACHE", "off")
        yield


@pytest.fixture(scope="session")
def project_root() -> Path:
    return PROJECT_ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real recordings and robots, beside the project on a development machine only."""
    folder = PROJECT_ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no ../shared/data beside the project: real recordings are not shipped with it")
    return folder
