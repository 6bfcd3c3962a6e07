"""Fixtures that every room shares."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.browser import browser as browser

# A machine that does other work, or compiles, is no fault of an example.
settings.register_profile("any_clock", deadline=None)
settings.load_profile("any_clock")

PROJECT_ROOT = Path(__file__).resolve().parents[1]

EARLY = (
    # Compiles the kernels in a fresh clone, once for all: the next two do without them meanwhile.
    "tests/fixture/proximity/test_engine.py",
    "tests/synthetic/",
    "tests/registration/",
    # Longer than half a minute each: at the end one would leave the other workers idle.
    "tests/bridge/faults/",
    "tests/bridge/live/",
    "tests/bridge/control/",
    "tests/cli/test_recorded_case.py",
    "tests/cli/test_replay_scene.py",
    "tests/cli/test_serve.py",
    "tests/slicer_module/test_marginguard_replay.py",
    "tests/viewer/test_page.py",
)
"""What is begun first, in this order; all else follows as it was collected."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files of `EARLY` first, so that two workers end together."""

    def place(item: pytest.Item) -> int:
        begins = (item.nodeid.startswith(early) for early in EARLY)
        return next((at for at, is_it in enumerate(begins) if is_it), len(EARLY))

    items.sort(key=place)


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
