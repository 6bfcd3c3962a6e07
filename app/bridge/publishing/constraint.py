"""Convert a fixture decision to ``marginguard_msgs/FixtureConstraint``, in m and m/s."""

import math
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from marginguard_msgs.msg import FixtureConstraint, HalfSpace
from std_msgs.msg import Header

from app.bridge import messages
from app.fixture import Constraint, FixtureDecision, MarginState
from app.geometry import Stamp
from app.runtime import SessionContent


class ConstraintBuilder:
    """Converts decisions to messages and keeps the stamp of the last current planes.

    A decision whose planes do not belong to the current pose contains the last planes that did.
    The message then keeps their stamp and ``valid_until``, so that planes never appear newer than
    they are. Without planes both are zero, which is long past, and ``hold`` is set.
    """

    def __init__(self, content: SessionContent) -> None:
        self._planes_from: Stamp | None = None
        self.use(content)

    def use(self, content: SessionContent) -> None:
        """Use margins, tumour and registration of ``content`` from the next message on."""
        self._frame = content.tumor.frame
        self._stale_after_ns = content.margins.stale_after_ns
        self._k_tre = content.margins.k_tre
        self._model_id = content.model_id
        self._registration_id = content.registration_id

    def message(
        self,
        decision: FixtureDecision,
        *,
        hold_causes: Sequence[str] = (),
        simulated: bool = True,
        single_source: bool = True,
    ) -> FixtureConstraint:
        """Convert ``decision``; the publisher sets ``seq``.

        ``simulated``: the poses are recorded or simulated. ``single_source``: nothing checks them.
        """
        known = decision.state is not MarginState.UNKNOWN
        if decision.constraint is None:
            self._planes_from = None
        elif decision.constraint_is_current:
            self._planes_from = decision.stamp
        message = FixtureConstraint(
            header=Header(frame_id=self._frame),
            state=int(decision.state),
            reasons=[str(reason) for reason in decision.reasons],
            hold=decision.hold,
            hold_causes=list(hold_causes),
            simulated=simulated,
            planes_current=decision.constraint_is_current,
            single_source=single_source,
            signed_distance=math.nan,
            lower_bound=math.nan,
            stop_distance=math.nan,
            warn_distance=math.nan,
            sigma_tre=math.nan,
            model_id=self._model_id,
            registration_id=self._registration_id,
        )
        if self._planes_from is not None:
            message.header.stamp = messages.time_message(self._planes_from)
            message.valid_until = self._valid_until(self._planes_from)
        if decision.constraint is not None:
            message.half_spaces = half_space_messages(decision.constraint)
        if known and decision.proximity is not None:
            message.signed_distance = _metres(decision.proximity.signed_distance_mm)
            message.lower_bound = _metres(decision.proximity.lower_bound_mm)
        if decision.margin is not None:
            message.stop_distance = _metres(decision.margin.total_mm)
            message.warn_distance = _metres(decision.margin.warn_total_mm)
            if self._k_tre > 0.0:
                message.sigma_tre = _metres(decision.margin.tre_mm / self._k_tre)
        return message

    def _valid_until(self, stamp: Stamp) -> Time:
        return messages.time_message(stamp.shifted(self._stale_after_ns, stamp.clock))


def half_space_messages(constraint: Constraint) -> list[HalfSpace]:
    """Convert half-spaces: unit normals, offsets and points in m, velocities in m/s."""
    return [
        HalfSpace(
            normal=messages.vector_message(normal),
            offset=_metres(offset_mm),
            point_on_tool=messages.point_message(point_mm),
            tumor_velocity=messages.vector_message(messages.metres(velocity_mm_s)),
        )
        for normal, offset_mm, point_mm, velocity_mm_s in zip(
            constraint.normals,
            constraint.offsets_mm,
            constraint.points_on_tool_mm,
            constraint.tumor_velocities_mm_s,
            strict=True,
        )
    ]


def _metres(value_mm: float) -> float:
    return float(messages.metres(value_mm))
