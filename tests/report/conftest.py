"""Rows and records of the report's tests."""

import numpy as np
import pytest

from app.fixture import MarginState
from app.report import ReplayRecord, ReportRow, write_report
from tests.doubles import PARAMETERS

PERIOD_NS = 20_000_000
FIRST_NS = 1_000_000_000_000
PLOT = b"\x89PNG plot"


@pytest.fixture(scope="session")
def margins():
    return PARAMETERS


@pytest.fixture(scope="session")
def rows_of():
    """Rows 20 ms apart with these distances; None is a frame that could not be evaluated."""

    def build(distances, period_ns=PERIOD_NS):
        return tuple(
            _row(FIRST_NS + index * period_ns, distance) for index, distance in enumerate(distances)
        )

    return build


@pytest.fixture(scope="session")
def record_of(rows_of, margins):
    def build(distances, **changes):
        values = {
            "case": "three frames",
            "provenance": {"kind": "simulated", "source": "a test", "licence": "Apache-2.0"},
            "rows": rows_of(distances),
            "margins": margins,
        }
        return ReplayRecord(**{**values, **changes})

    return build


def write(folder, record, scene=None, **others):
    """Write a report with a plot that is not drawn, as only its bytes are embedded."""
    others.setdefault("margin_plot", lambda: PLOT)
    return write_report(folder, record, scene_png=lambda: scene, version="1", **others)


@pytest.fixture(scope="session")
def prepared(tmp_path_factory):
    """Seconds of the shipped case, with a breach."""
    import marginguard as mg
    from tests.cut_case import write_cut_case

    return mg.open_case(write_cut_case(tmp_path_factory.mktemp("cut") / "case", 94.8, 2.6))


@pytest.fixture(scope="session")
def steps(prepared):
    import marginguard as mg

    return list(mg.replay(prepared))


@pytest.fixture(scope="session")
def analysed(prepared, steps):
    from app.analysis import analyse_case
    from app.report import AnalysedCase
    from app.report.methods import methods_of

    content = prepared.content
    analysis = analyse_case(
        steps,
        name="a <b> case",
        margins=content.margins,
        tumor=content.tumor,
        tool=content.tool,
        covariances_mm2={"contour": 0.5 * np.eye(3)},
        stops_mm=(2.0,),
        cutting_mm=4.0,
    )
    errors = {"contour": 0.7}
    methods = methods_of(prepared, steps[0].frame.stamp.ns, "9.8.7", error_sigmas_mm=errors)
    return AnalysedCase(analysis, methods, content.margins, content.tumor)


def _row(stamp_ns, distance):
    if distance is None:
        return ReportRow(stamp_ns, MarginState.UNKNOWN, ("invalid", "stale"))
    if distance < 0.0:
        state, reason = MarginState.POSITIVE, "inside"
    elif distance < 5.0:
        state, reason = MarginState.WARNING, "warning_distance"
    else:
        state, reason = MarginState.NEGATIVE, "clear"
    return ReportRow(
        stamp_ns, state, (reason,), distance, distance - 0.25, (distance, 2.0, -3.0), 1.5, 5.5
    )
