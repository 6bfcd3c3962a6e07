"""Per-frame results of an analysis as a Parquet file."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.motion import smooth_pieces
from app.geometry import NS_PER_S, FloatArray
from app.runtime import PassiveOutput, StepTiming

if TYPE_CHECKING:
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


class FramesTable(PassiveOutput):
    """`Output` that keeps one row per step, in the tumour's frame; unknown values are null.

    ``max_gap_s``: the velocity is not known across a longer gap.
    """

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        self._rows: list[dict[str, Any]] = []

    def publish(self, step: "StepResult", timing: StepTiming) -> bool:
        """Keep the row of ``step``."""
        self._rows.append(_row(step))
        return True

    def parquet(self) -> bytes:
        """The Parquet file: the same steps give the same bytes.

        Needs pyarrow (extra ``cohort``).
        """
        import pyarrow as pa  # slow to load, and in an extra
        import pyarrow.parquet as pq

        columns = {name: [row.get(name) for row in self._rows] for name in COLUMNS}
        stamps = np.array(columns["stamp_ns"], dtype=np.int64)
        times = (stamps - stamps[:1]) / NS_PER_S
        columns["t_s"] = times.tolist()
        tips = np.array(
            [columns[f"tip_{axis}_mm"] for axis in _XYZ], dtype=np.float64
        ).T  # None becomes NaN
        for axis, values in zip(_XYZ, self._velocities(times, tips).T.tolist(), strict=True):
            columns[f"velocity_{axis}_mm_s"] = [None if math.isnan(v) else v for v in values]
        arrays = [_array(name, values) for name, values in columns.items()]
        table = pa.Table.from_arrays(arrays, names=list(columns))
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        return bytes(sink.getvalue())

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


def _row(step: "StepResult") -> dict[str, Any]:
    decision, pose = step.decision, step.tumor_from_tip
    row: dict[str, Any] = {
        "stamp_ns": step.frame.stamp.ns,
        "state": decision.state.name,
        "reasons": ";".join(map(str, decision.reasons)),
        "hold": decision.hold,
        "hold_causes": ";".join(step.hold_causes),
        "between_frames": step.between_frames is not None,
    }
    if decision.margin is not None:
        row["stop_total_mm"] = _finite(decision.margin.total_mm)
        row["warn_total_mm"] = _finite(decision.margin.warn_total_mm)
    if pose is not None:
        row |= _vector("tip_{}_mm", pose.translation_mm)
    found = decision.proximity
    if found is not None:
        row["signed_distance_mm"] = _finite(found.signed_distance_mm)
        row["lower_bound_mm"] = _finite(found.lower_bound_mm)
        row |= _vector("on_tumor_{}_mm", found.on_tumor_mm)
        row |= _vector("on_tool_{}_mm", found.on_tool_mm)
        row |= _vector("normal_{}", found.normal)
    return row


def _vector(name: str, values: FloatArray) -> dict[str, float | None]:
    return {
        name.format(axis): _finite(value) for axis, value in zip(_XYZ, values.tolist(), strict=True)
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _array(name: str, values: list[Any]) -> Any:
    """The column as an array of pyarrow, of its buffers: `pyarrow.array` loads pandas."""
    import pyarrow as pa

    known = np.array([value is not None for value in values], dtype=np.bool_)
    valid = None if known.all() else _bits(known)
    if name in ("state", "reasons", "hold_causes"):
        texts = [(value or "").encode() for value in values]
        ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        buffers = [valid, pa.py_buffer(ends.tobytes()), pa.py_buffer(b"".join(texts))]
        return pa.Array.from_buffers(pa.string(), len(values), buffers)
    if name in ("hold", "between_frames"):
        bits = _bits(np.array([bool(value) for value in values]))
        return pa.Array.from_buffers(pa.bool_(), len(values), [valid, bits])
    kind, number = (pa.int64(), np.int64) if name == "stamp_ns" else (pa.float64(), np.float64)
    numbers = np.array([0 if value is None else value for value in values], dtype=number)
    return pa.Array.from_buffers(kind, len(values), [valid, pa.py_buffer(numbers.tobytes())])


def _bits(flags: NDArray[np.bool_]) -> Any:
    import pyarrow as pa

    return pa.py_buffer(np.packbits(flags, bitorder="little").tobytes())
