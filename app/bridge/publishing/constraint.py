"""Convert a fixture decision to ``marginguard_msgs/FixtureConstraint``, in m and m/s."""

import math
from collections.abc import Sequence

from geometry_msgs.msg import TransformStamped
from marginguard_msgs.msg import FixtureConstraint, HalfSpace

from app.bridge import messages
from app.fixture import MAX_TURN_RAD_S, Constraint, FixtureDecision, MarginState
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
        self._max_tool_speed = _metres(content.margins.v_max_mm_s)
        self._model_id = content.model_id
        self._registration_id = content.registration_id
        self._setup_id = content.setup_id
        self._tumor = messages.transform_message(content.frame_from_tumor, Stamp(0))
        self._base = TransformStamped()
        if content.registration is not None:
            self._base = messages.transform_message(content.registration.transform, Stamp(0))

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
            max_tool_speed=self._max_tool_speed,
            max_tool_turn=MAX_TURN_RAD_S,
            model_id=self._model_id,
            registration_id=self._registration_id,
            setup_id=self._setup_id,
            tumor=self._tumor,
            base=self._base,
        )
        message.header.frame_id = self._frame
        if self._planes_from is not None:
            messages.set_time(message.header.stamp, self._planes_from)
            messages.set_time(message.valid_until, self._until(self._planes_from))
        if decision.constraint is not None:
            message.half_spaces = half_space_messages(decision.constraint)
            message.free_distance = _metres(decision.constraint.free.distance_mm)
            message.free_turn = decision.constraint.free.turn_rad
        if known and decision.proximity is not None:
            message.signed_distance = _metres(decision.proximity.signed_distance_mm)
            message.lower_bound = _metres(decision.proximity.lower_bound_mm)
        if decision.margin is not None:
            message.stop_distance = _metres(decision.margin.total_mm)
            message.warn_distance = _metres(decision.margin.warn_total_mm)
            if self._k_tre > 0.0:
                message.sigma_tre = _metres(decision.margin.tre_mm / self._k_tre)
        return message

    def _until(self, stamp: Stamp) -> Stamp:
        """The last time at which planes of ``stamp`` are valid."""
        return stamp.shifted(self._stale_after_ns, stamp.clock)


def half_space_messages(constraint: Constraint) -> list[HalfSpace]:
    """Convert half-spaces: unit normals, offsets and points in m, velocities in m/s."""
    return [_half_space(*row) for row in constraint.rows.tolist()]


def _half_space(
    offset_mm: float,
    nx: float, ny: float, nz: float,
    px: float, py: float, pz: float,
    vx: float, vy: float, vz: float,
) -> HalfSpace:  # fmt: skip
    """One row of `Constraint.rows`. Fills in a new message, quicker than to construct its parts."""
    message = HalfSpace(offset=_metres(offset_mm))
    normal, point, velocity = message.normal, message.point_on_tool, message.tumor_velocity
    normal.x, normal.y, normal.z = nx, ny, nz
    point.x, point.y, point.z = _metres(px), _metres(py), _metres(pz)
    velocity.x, velocity.y, velocity.z = _metres(vx), _metres(vy), _metres(vz)
    return message


def _metres(value_mm: float) -> float:
    return float(value_mm) / messages.MM_PER_M
