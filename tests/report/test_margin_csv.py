import csv
import io
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from app.case import Activation
from app.fixture import MarginState
from app.report import ReportRow, margin_csv
from app.report.rows import COLUMNS

numbers = st.floats(-1e4, 1e4)


def test_text_is_exactly_this(rows_of):
    assert margin_csv(rows_of([6.5, None, -1.25])) == (
        "t_s,stamp_ns,state,signed_distance_mm,lower_bound_mm,reasons,"
        "tip_x_mm,tip_y_mm,tip_z_mm\n"
        "0.000000,1000000000000,NEGATIVE,6.500000,6.250000,clear,6.500000,2.000000,-3.000000\n"
        "0.020000,1000020000000,UNKNOWN,,,invalid;stale,,,\n"
        "0.040000,1000040000000,POSITIVE,-1.250000,-1.500000,inside,-1.250000,2.000000,-3.000000\n"
    )


def test_state_of_the_cautery_is_a_column_of_a_case_with_a_source_only(rows_of):
    rows = rows_of([6.5, None, -1.25])
    states = (Activation.OFF, Activation.UNKNOWN, Activation.ON)
    told = [replace(row, activation=state) for row, state in zip(rows, states, strict=True)]
    plain, text = margin_csv(rows).splitlines(), margin_csv(told).splitlines()
    assert text == [
        f"{line},{cell}"
        for line, cell in zip(plain, ("cautery", "off", "unknown", "on"), strict=True)
    ]


def test_no_rows_leave_the_header():
    assert margin_csv([]) == ",".join(COLUMNS) + "\n"


def test_zero_has_no_sign():
    text = margin_csv([ReportRow(0, MarginState.WARNING, (), -1e-9, -0.0)])
    assert text.splitlines()[1] == "0.000000,0,WARNING,0.000000,0.000000,,,,"


@given(st.lists(st.tuples(st.sampled_from(MarginState), numbers, numbers), min_size=1, max_size=20))
def test_round_trip(values):
    rows = [
        ReportRow(1_700_000_000_000_000_001 + 7 * i, state, ("clear",), d, d, (x, 0.0, 0.0))
        for i, (state, d, x) in enumerate(values)
    ]
    read = list(csv.DictReader(io.StringIO(margin_csv(rows))))
    assert tuple(read[0]) == COLUMNS
    assert len(read) == len(rows)
    for row, cells in zip(rows, read, strict=True):
        assert int(cells["stamp_ns"]) == row.stamp_ns
        assert MarginState[cells["state"]] is row.state
        assert abs(float(cells["signed_distance_mm"]) - (row.signed_distance_mm or 0.0)) < 1e-6
        assert abs(float(cells["tip_x_mm"]) - (row.tip_mm or (0.0,))[0]) < 1e-6
