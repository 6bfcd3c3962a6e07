"""Per-frame results of an analysis as a Parquet file."""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.analysis.motion import smooth_pieces
from app.geometry import NS_PER_S, FloatArray
from app.runtime import PassiveOutput, StepTiming

if TYPE_CHECKING:
    from app.fixture import FixtureDecision
    from app.geometry import Transform
    from app.session import StepResult

_XYZ = ("x", "y", "z")
COLUMNS = (
    *("t_s", "stamp_ns", "state", "reasons", "hold", "hold_causes", "between_frames"),
    *("signed_distance_mm", "lower_bound_mm", "stop_total_mm", "warn_total_mm"),
    *(f"tip_{axis}_mm" for axis in _XYZ),
    *(f"velocity_{axis}_mm_s" for axis in _XYZ),
    *(f"on_tumor_{axis}_mm" for axis in _XYZ),
    *(f"on_tool_{axis}_mm" for axis in _XYZ),
    *(f"normal_{axis}" for axis in _XYZ),
)


class _Row(NamedTuple):
    """Values of a step for the table; they are taken apart at the end."""

    stamp_ns: int
    decision: "FixtureDecision"
    hold_causes: tuple[str, ...]
    between_frames: bool
    tip: "Transform | None"


class FramesTable(PassiveOutput):
    """`Output` that keeps one row per step, in the tumour's frame; unknown values are null.

    ``max_gap_s``: the velocity is not known across a longer gap.
    """

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        self._rows: list[_Row] = []

    def publish(self, step: "StepResult", timing: StepTiming) -> bool:
        """Keep the row of ``step``."""
        between_frames = step.between_frames is not None
        stamp_ns, tip = step.frame.stamp.ns, step.tumor_from_tip
        self._rows.append(_Row(stamp_ns, step.decision, step.hold_causes, between_frames, tip))
        return True

    def parquet(self) -> bytes:
        """The Parquet file: the same steps give the same bytes.

        Needs pyarrow (extra ``cohort``).
        """
        import pyarrow as pa  # slow to load, and in an extra
        import pyarrow.parquet as pq

        columns = self._columns()
        table = pa.Table.from_arrays(
            [_array(name, columns[name]) for name in COLUMNS], names=list(COLUMNS)
        )
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        return bytes(sink.getvalue())

    def _columns(self) -> dict[str, Any]:
        """By name: texts, truth values, whole numbers, or floats, not finite where unknown."""
        rows = self._rows
        stamps = np.array([row.stamp_ns for row in rows], dtype=np.int64)
        times = (stamps - stamps[:1]) / NS_PER_S
        tips = _points(None if row.tip is None else row.tip.translation_mm for row in rows)
        decisions = [row.decision for row in rows]
        margins = [decision.margin for decision in decisions]
        found = [decision.proximity for decision in decisions]
        distances = _numbers(None if p is None else p.signed_distance_mm for p in found)
        columns: dict[str, Any] = {
            "t_s": times,
            "stamp_ns": stamps,
            "state": [decision.state.name for decision in decisions],
            "reasons": [";".join(map(str, decision.reasons)) for decision in decisions],
            "hold": np.array([decision.hold for decision in decisions], dtype=np.bool_),
            "hold_causes": [";".join(row.hold_causes) for row in rows],
            "between_frames": np.array([row.between_frames for row in rows], dtype=np.bool_),
            "signed_distance_mm": distances,
            "lower_bound_mm": _numbers(None if p is None else p.lower_bound_mm for p in found),
            "stop_total_mm": _numbers(None if m is None else m.total_mm for m in margins),
            "warn_total_mm": _numbers(None if m is None else m.warn_total_mm for m in margins),
        }
        for name, values in (
            ("tip_{}_mm", tips),
            ("velocity_{}_mm_s", self._velocities(times, tips)),
            ("on_tumor_{}_mm", _points(None if p is None else p.on_tumor_mm for p in found)),
            ("on_tool_{}_mm", _points(None if p is None else p.on_tool_mm for p in found)),
            ("normal_{}", _points(None if p is None else p.normal for p in found)),
        ):
            columns |= {
                name.format(axis): column for axis, column in zip(_XYZ, values.T, strict=True)
            }
        return columns

    def _velocities(self, times: FloatArray, tips: FloatArray) -> FloatArray:
        """Velocity (n, 3) of the tip by `smooth_pieces`, NaN where it is not known."""
        found = np.full((len(times), 3), np.nan)
        known = np.isfinite(tips).all(axis=1)
        for piece in smooth_pieces(times, tips, self._max_gap_s):
            within = known & (times >= piece.times_s[0]) & (times <= piece.times_s[-1])
            for axis in range(3):
                found[within, axis] = np.interp(
                    times[within], piece.times_s, piece.velocities_mm_s[:, axis]
                )
        return found


def _numbers(values: Iterable[float | None]) -> FloatArray:
    return np.array([math.nan if value is None else value for value in values], dtype=np.float64)


def _points(values: Iterable[FloatArray | None]) -> FloatArray:
    """Points (n, 3), NaN for None."""
    unknown = np.full(3, math.nan)
    points = [unknown if value is None else value for value in values]
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _array(name: str, values: Any) -> Any:
    """The column as an array of pyarrow, of its buffers: `pyarrow.array` loads pandas."""
    import pyarrow as pa

    if name in ("state", "reasons", "hold_causes"):
        texts = [text.encode() for text in values]
        ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        buffers = [None, pa.py_buffer(ends.tobytes()), pa.py_buffer(b"".join(texts))]
        return pa.Array.from_buffers(pa.string(), len(values), buffers)
    if name in ("hold", "between_frames"):
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, _bits(values)])
    if name == "stamp_ns":
        stamps = pa.py_buffer(values.tobytes())
        return pa.Array.from_buffers(pa.int64(), len(values), [None, stamps])
    known = np.isfinite(values)
    valid = None if known.all() else _bits(known)
    numbers = pa.py_buffer(np.where(known, values, 0.0).tobytes())
    return pa.Array.from_buffers(pa.float64(), len(values), [valid, numbers])


def _bits(flags: NDArray[np.bool_]) -> Any:
    import pyarrow as pa

    return pa.py_buffer(np.packbits(flags, bitorder="little").tobytes())
