"""Fixtures and collection rules for all tests: their order, and which of them are slow."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.browser import browser as browser
from tests.browser import chromium as chromium
from tests.opened_documents import (
    opened_documents_agree_with_their_schema as opened_documents_agree_with_their_schema,
)

# No deadline per example: compilation or a busy machine would fail it. The suite draws the same
# examples in each run; --hypothesis-profile random draws new ones.
settings.register_profile("suite", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.load_profile("suite")

PROJECT_ROOT = Path(__file__).resolve().parents[1]

SLOW = {
    "needs a ROS graph": (
        "tests/bridge/",
        "tests/interfaces/",
        "tests/cli/test_rearm.py",
        "tests/cli/test_record.py",
        "tests/cli/test_serve.py",
        "tests/cli/test_signals.py",
        "tests/cli/test_standard_input.py",
        "tests/igtl/test_igtl_command.py",
        "tests/marginguard/test_constraints.py",
    ),
    "needs VTK, rendering or a browser": (
        "tests/scene/",
        "tests/slicer_module/",
        "tests/tools/test_check_site_pages.py",
        "tests/viewer/attacks/",
        "tests/viewer/drawing/",
        "tests/viewer/messages/test_calls.py",
        "tests/viewer/messages/test_page_socket.py",
        "tests/viewer/test_page.py",
        "tests/viewer/test_page_navigation.py",
        "tests/viewer/test_page_state.py",
        "tests/viewer/test_server_gone.py",
        "tests/viewer/test_page_layout.py",
        "tests/viewer/test_tls_proxy.py",
        "tests/viewer/steps/test_reslice.py",
        "tests/viewer/steps/test_ultrasound.py",
        "tests/viewer/test_calibration_part.py",
        "tests/viewer/test_contour_part.py",
        "tests/viewer/test_registration_part.py",
        "tests/viewer/test_world_controls.py",
        "tests/viewer/test_world_part.py",
        "tests/cli/test_render_warmup.py",
        "tests/cli/test_replay_scene.py",
        "tests/cli/test_scene_picture.py",
        "tests/cli/test_view.py",
    ),
    "starts many processes or replays whole cases": (
        "tests/analysis/test_insertion.py",
        "tests/cli/test_analyse.py",
        "tests/dicom/test_export_dicom.py",
        "tests/benchmarks/",
        "tests/cli/calibration/test_lag.py",
        "tests/cli/calibration/test_landmarks.py",
        "tests/cli/calibration/test_pivot_and_spin.py",
        "tests/cli/calibration/test_robot.py",
        "tests/cli/test_bench.py",
        "tests/cli/test_completion.py",
        "tests/cli/test_doctor.py",
        "tests/cli/test_live_lines.py",
        "tests/cli/test_main.py",
        "tests/cli/test_recorded_case.py",
        "tests/cli/test_replay.py",
        "tests/cli/test_replay_all.py",
        "tests/cli/test_phantom_case.py",
        "tests/cli/test_tumor.py",
        "tests/examples/test_cpp_rule.py",
        "tests/examples/test_scripts.py",
        "tests/fixture/proximity/test_field_cache.py",
        "tests/fixture/test_jit.py",
        "tests/fuzz/",
        "tests/igtl/test_live_igtl.py",
        "tests/runtime/persistence/test_killed.py",
        "tests/session/test_benchmark.py",
        "tests/session/test_following.py",
        "tests/synthetic/test_recording.py",
        "tests/synthetic/test_scenario.py",
        "tests/synthetic/test_simulation.py",
        "tests/synthetic/test_writing.py",
        "tests/tools/test_wheel.py",
    ),
    "computes for more than about 3 s": (
        "tests/analysis/test_breach_probability.py",
        "tests/analysis/test_case_analysis.py",
        "tests/analysis/test_depth.py",
        "tests/analysis/test_specimen.py",
        "tests/case/readers/test_batches.py",
        "tests/case/test_schema_agreement.py",
        "tests/case/tumor/test_contour_surface.py",
        "tests/fixture/control/test_guidance.py",
        "tests/fixture/control/test_monitor_machine.py",
        "tests/fixture/control/test_push.py",
        "tests/fixture/meshes/test_generated_meshes.py",
        "tests/fixture/meshes/test_margin_surface.py",
        "tests/fixture/meshes/test_mesh_checks.py",
        "tests/fixture/meshes/test_self_intersection.py",
        "tests/fixture/proximity/test_branch_and_bound.py",
        "tests/fixture/proximity/test_engine.py",
        "tests/fixture/proximity/test_separating_planes.py",
        "tests/fixture/proximity/test_witnesses.py",
        "tests/fixture/surfaces/test_clearance.py",
        "tests/registration/points/test_surface.py",
        "tests/registration/robot_base/test_robot_world.py",
        "tests/registration/tool/test_pivot.py",
        "tests/registration/tool/test_pivot_selection.py",
        "tests/registration/tool/test_spin.py",
        "tests/report/test_margin_plot.py",
        "tests/report/test_report_process.py",
        "tests/session/test_from_case.py",
        "tests/session/test_recent_samples.py",
        "tests/session/test_setup_doubts.py",
        "tests/simulation/test_world.py",
        "tests/synthetic/test_clearance.py",
    ),
}
"""Reason -> folders and files whose tests have the marker ``slow``: `make test-fast` skips them."""

LONG = {
    "starts Dask clusters or replays whole cohorts": (
        "tests/cohort/test_case_run.py",
        "tests/cohort/test_cohort_command.py",
    ),
    "opens reports in a browser": (
        "tests/report/test_coverage_in_browser.py",
        "tests/report/test_page_in_browser.py",
    ),
    "starts rival drivers and waits until they have ended": (
        "tests/bridge/live/test_second_senders.py",
    ),
    "starts a process for each parser": ("tests/fuzz/test_parsers.py",),
    "simulates for seconds, loads large robots or decomposes surfaces": (
        "tests/benchmarks/test_guided.py",
        "tests/benchmarks/test_passivity.py",
        "tests/simulation/test_commands.py",
        "tests/simulation/test_contact.py",
        "tests/simulation/test_dynamics.py",
        "tests/simulation/test_kinematics.py",
        "tests/simulation/test_loops.py",
        "tests/simulation/test_shipped_world.py",
    ),
    "attacks a live session with many malformed messages": ("tests/bridge/faults/test_live.py",),
    "starts processes that compute for another": ("tests/runtime/test_compute.py",),
    "runs every block of three pages": ("tests/docs/test_start_pages.py",),
    "plays a recording to sessions that refuse it": (
        "tests/bridge/playback/test_refused_playback.py",
    ),
    "records live sessions and servers in further processes": (
        "tests/bridge/live/test_recorded_content.py",
        "tests/bridge/live/test_session_recording.py",
        "tests/igtl/test_record_igtl.py",
    ),
    "starts live sessions again and again": (
        "tests/bridge/live/test_restart.py",
        "tests/bridge/live/test_second_guard.py",
    ),
    "applies the rules of axe-core to pages in a browser": ("tests/viewer/test_accessibility.py",),
    "draws WebGL by software": ("tests/viewer/test_client_rendering.py",),
    "serves a page of its own": (
        "tests/cli/test_page_push.py",
        "tests/cli/test_page_world.py",
        "tests/cli/test_library.py",
        "tests/cli/test_view_hand.py",
        "tests/viewer/test_calibration_page.py",
        "tests/viewer/test_stylus_page.py",
        "tests/viewer/test_contour_page.py",
        "tests/viewer/test_exports.py",
        "tests/viewer/test_live_ultrasound_page.py",
        "tests/viewer/test_registration_page.py",
        "tests/viewer/test_recording_page.py",
        "tests/viewer/test_ultrasound_page.py",
        "tests/viewer/attacks/test_random_served.py",
        "tests/viewer/attacks/test_world_served.py",
        "tests/viewer/test_operation_page.py",
    ),
    "builds another version of the message package": (
        "tests/interfaces/test_other_definitions.py",
    ),
    "checks types in a new cache": ("tests/marginguard/test_typing.py",),
    "simulates and replays whole cases": (
        "tests/analysis/test_case_of_noise_alone.py",
        "tests/synthetic/test_cases_of_trackers.py",
    ),
    "opens the shipped case many times": ("tests/marginguard/test_doctests.py",),
    "runs examples on whole cases, or beside a replay in real time": (
        "tests/examples/test_guard_bond.py",
        "tests/examples/test_long_scripts.py",
        "tests/examples/test_notebooks.py",
        "tests/examples/test_ros_scripts.py",
        "tests/cli/test_simulate.py",
        "tests/cli/test_simulate_group.py",
        "tests/benchmarks/test_closed_loop.py",
        "tests/examples/test_twist_filter.py",
    ),
}
"""Reason -> files that `make test-long` runs (``--long``), and `make test` does not."""

EXHAUSTIVE = {
    "stops a live session 100 times from outside": ("tests/benchmarks/test_stops.py",),
    "repairs 400 generated meshes": ("tests/fixture/meshes/test_all_generated_meshes.py",),
    "pushes a simulated arm in real time": ("tests/benchmarks/test_closed_loop_processes.py",),
    "kills twenty recorders": ("tests/benchmarks/test_long_recorder.py",),
}
"""Reason -> files that `make test-exhaustive` runs (``--exhaustive``), on an idle machine."""

FAST_TIER = "not slow"
"""Expression of ``-m`` that selects the fast tier."""

EARLY = (
    # In a fresh clone it compiles the kernels; the next two do not need them meanwhile.
    "tests/fixture/proximity/test_engine.py",
    "tests/synthetic/",
    "tests/registration/",
    # More than half a minute each: started last, one would leave the other workers idle.
    "tests/bridge/faults/",
    "tests/bridge/live/",
    "tests/bridge/control/",
    "tests/cli/test_recorded_case.py",
    "tests/cli/test_replay_scene.py",
    "tests/cli/test_serve.py",
    "tests/slicer_module/test_marginguard_replay.py",
    "tests/viewer/test_page.py",
)
"""Folders and files that run first, in this order; the others follow in the collected order."""


def is_slow(path: str) -> bool:
    """True if ``path`` (relative to the project, or a node id) is listed in `SLOW`."""
    return path.startswith(tuple(slow for paths in SLOW.values() for slow in paths))


def tier_of(path: str) -> str:
    """Tier of the file ``path`` (relative to the project): suite, long or exhaustive."""
    for tier, table in (("long", LONG), ("exhaustive", EXHAUSTIVE)):
        if path in {each for paths in table.values() for each in paths}:
            return tier
    return "suite"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--long`` and ``--exhaustive``."""
    parser.addoption(
        "--long", dest="tier", action="store_const", const="long", help="run the files of LONG only"
    )
    parser.addoption(
        "--exhaustive",
        dest="tier",
        action="store_const",
        const="exhaustive",
        help="run the files of EXHAUSTIVE only",
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Select the files of a tier; do not import slow files for the fast one: they load ROS, VTK."""
    if not collection_path.is_relative_to(PROJECT_ROOT):
        return None
    path = collection_path.relative_to(PROJECT_ROOT).as_posix()
    if collection_path.suffix == ".py" and tier_of(path) != (config.option.tier or "suite"):
        return True
    if config.option.markexpr != FAST_TIER:
        return None
    return is_slow(f"{path}/" if collection_path.is_dir() else path) or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark slow tests, and run the files of `EARLY` first, so that two workers end together."""

    def rank(item: pytest.Item) -> int:
        starts = (item.nodeid.startswith(early) for early in EARLY)
        return next((index for index, found in enumerate(starts) if found), len(EARLY))

    for item in items:
        if is_slow(item.nodeid):
            item.add_marker(pytest.mark.slow)
    items.sort(key=rank)


@pytest.fixture(autouse=True, scope="session")
def no_field_cache() -> Iterator[None]:
    """Tests neither read nor fill the user's cache of fields."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MARGINGUARD_FIELD_CACHE", "off")
        yield


@pytest.fixture(autouse=True, scope="session")
def own_state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests neither read nor write the holds that the user's live sessions have left."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


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
