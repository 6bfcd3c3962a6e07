"""Fixtures and collection rules for all tests: their tier and their order."""

import gc
import importlib
import os
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path

import pytest
import yaml
from hypothesis import settings

from app.cli.process import NEW_OBJECTS  # before numpy: sets the threads of BLAS as the product
from tests.browser import browser as browser
from tests.browser import chromium as chromium
from tests.forked_workers import ForkedWorkers
from tests.forking import COMMAND, LIGHT, PLAIN, VIEW, WarmParent
from tests.opened_documents import (
    opened_documents_agree_with_their_schema as opened_documents_agree_with_their_schema,
)
from tests.tiers import PROJECT_ROOT, TIERS, seconds_by_file, tier_of

# No deadline per example: compilation or a busy machine would fail it. The suite draws the same
# examples in each run; --hypothesis-profile random draws new ones.
settings.register_profile("suite", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.load_profile("suite")

# The loader in C is ten times as fast; the product has its own (`app.files.yaml_file`).
yaml.safe_load = partial(yaml.load, Loader=yaml.CSafeLoader)

TOGETHER = (
    "tests/bridge/live/",
    "tests/cli/",
    "tests/report/",
    "tests/slicer_module/",
    "tests/test_",
    "tests/viewer/",
)
"""Starts of paths of files that share what takes seconds: processes, a browser, syntax trees."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--tier`` and ``--workers``."""
    parser.addoption(
        "--tier", choices=TIERS, default="suite", help="which tests to run: tests/tiers.py"
    )
    parser.addoption(
        "--workers", type=int, default=0, help="number of processes: tests/forked_workers.py"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Begin the processes that most tests fork from: they import while the tests are collected."""
    if config.option.workers > 1:
        os.environ["MARGINGUARD_TEST_RUN"] = str(os.getpid())
        if config.option.tier != "fast":
            for modules in (VIEW, COMMAND, PLAIN, LIGHT):
                config.add_cleanup(WarmParent(modules).close)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Modules and tests stay for the whole run, so that no later garbage collection scans them."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()
        gc.set_threshold(NEW_OBJECTS)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip files of other tiers without importing them, and folders without a file of this tier.

    A file that is named on the command line runs in any tier.
    """
    if collection_path in {Path(config.invocation_params.dir, _path(arg)) for arg in config.args}:
        return None
    if collection_path.is_dir():
        files = collection_path.rglob("test_*.py")
    elif collection_path.match("test_*.py"):
        files = iter([collection_path])
    else:
        return None
    return None if any(tier_of(file) in TIERS[config.option.tier] for file in files) else True


def _path(argument: str) -> str:
    return argument.partition("::")[0]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run the most expensive scopes first, so that the workers end together.

    A scope, which one worker runs, is a folder in `TOGETHER` or else a file; among long tests
    always a file: they are few, and those of one folder last longer than all others together.
    """
    together = () if config.option.tier == "long" else TOGETHER
    scopes = defaultdict[str, list[pytest.Item]](list)
    for item in items:
        path = _path(item.nodeid)
        scopes[next((each for each in together if path.startswith(each)), path)].append(item)
    seconds = seconds_by_file()
    paths = {scope: {_path(item.nodeid) for item in found} for scope, found in scopes.items()}
    order = sorted(scopes, key=lambda scope: -sum(seconds.get(path, 0.0) for path in paths[scope]))
    items[:] = [item for scope in order for item in scopes[scope]]
    if config.option.workers > 1:
        importlib.import_module("tests.loaded_kernels")  # all workers share what it loads
        sizes = [len(scopes[scope]) for scope in order]
        config.pluginmanager.register(ForkedWorkers(config.option.workers, sizes))


@pytest.fixture(autouse=True, scope="session")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """All tests share distance fields and convex parts, outside the user's cache."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # of the folders of all workers
    users = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    with pytest.MonkeyPatch.context() as patch:
        # But matplotlib's list of the fonts of this machine, which takes seconds to make.
        patch.setenv("MPLCONFIGDIR", os.environ.get("MPLCONFIGDIR", str(users / "matplotlib")))
        patch.delenv("MARGINGUARD_FIELD_CACHE", raising=False)
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield folder / "cache"


@pytest.fixture(autouse=True, scope="session")
def own_state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests neither read nor write the holds that the user's live sessions have left."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session")
def can_draw() -> None:
    """Skips, with what is missing, on a machine that cannot draw without a screen."""
    from app.scene import OffscreenError, use_offscreen_rendering  # loads VTK

    try:
        use_offscreen_rendering()
    except OffscreenError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def project_root() -> Path:
    return PROJECT_ROOT


@pytest.fixture(scope="session")
def real_recording(request: pytest.FixtureRequest) -> Callable[[str], Path]:
    """Path of a real recording by its name in PlusLibData; one of them is shipped as a case."""

    def path_of(name: str) -> Path:
        if name.startswith("EightLandmarkPoints"):
            return PROJECT_ROOT / "data" / "phantom_case" / "tracking.igs.mha"
        folder: Path = request.getfixturevalue("shared_data")
        return folder / "plus" / f"{name.removesuffix('.igs.mha')}.igs.mha"

    return path_of


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real recordings and robots; it exists on development machines only."""
    folder = PROJECT_ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no ../shared/data beside the project: real recordings are not shipped with it")
    return folder
