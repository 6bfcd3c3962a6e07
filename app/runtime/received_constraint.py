"""A constraint as another process receives it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from app.fixture import Constraint, MarginState


@dataclass(frozen=True, slots=True)
class ReceivedStructure:
    """One of several structures: its state, its distance and a lower bound of that, in mm.

    None if it is not known. A far structure has the lower bound alone.
    """

    name: str
    state: MarginState
    signed_distance_mm: float | None
    lower_bound_mm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class ReceivedConstraint:
    """A ``FixtureConstraint`` as plain values: lengths in mm, times in ns of the tracker's clock.

    ``constraint`` holds the half-spaces, None if no plane is known. After ``valid_until_ns`` no
    motion is allowed, not even retreat; with ``hold`` only retreat is. ``reasons`` are the worst
    first, as text, since a newer publisher may have others. ``stop_total_mm`` and ``warn_total_mm``
    are the applied margins. A number that the message does not have is None. Another
    ``instance_id`` is another run of the session, which does not know earlier holds: stop.
    ``rearm_nonce`` identifies a hold that has to be re-armed, 0 if none has. ``hold_causes`` are
    texts on what began and prolonged the hold. ``simulated``: the poses are not those of a patient.
    ``setup_id`` changes with the structures, their poses and the registration.
    ``max_tool_speed_mm_s`` and ``max_tool_turn_rad_s`` are what the margins assume of the tool.
    ``planes_current``: the half-spaces belong to the tool's present pose; otherwise no motion is
    allowed. ``single_source``: nothing independent can contradict the tracker. ``structures`` are
    empty where the tumour is the only one; ``half_spaces_of`` has the number of the structure of
    each half-space. ``off`` are structures that are not guarded, each with the reason.

    >>> import marginguard as mg
    >>> before_the_first_pose = mg.ReceivedConstraint(
    ...     seq=0, stamp_ns=0, valid_until_ns=0, state=mg.MarginState.UNKNOWN,
    ...     reasons=("starting",), hold=True, constraint=None, signed_distance_mm=None,
    ...     lower_bound_mm=None, stop_total_mm=None, warn_total_mm=None, sigma_tre_mm=None,
    ...     model_id="", registration_id="", setup_id="",
    ...     max_tool_speed_mm_s=0.0, max_tool_turn_rad_s=0.0,
    ...     instance_id="",
    ...     rearm_nonce=0,
    ...     hold_causes=(),
    ...     simulated=False,
    ...     planes_current=False,
    ...     single_source=True,
    ... )
    >>> before_the_first_pose.hold
    True
    """

    seq: int
    stamp_ns: int
    valid_until_ns: int
    state: MarginState
    reasons: tuple[str, ...]
    hold: bool
    constraint: Constraint | None
    signed_distance_mm: float | None
    lower_bound_mm: float | None
    stop_total_mm: float | None
    warn_total_mm: float | None
    sigma_tre_mm: float | None
    model_id: str
    registration_id: str
    setup_id: str
    max_tool_speed_mm_s: float
    max_tool_turn_rad_s: float
    instance_id: str
    rearm_nonce: int
    hold_causes: tuple[str, ...]
    simulated: bool
    planes_current: bool
    single_source: bool
    structures: tuple[ReceivedStructure, ...] = ()
    off: Mapping[str, str] = field(default_factory=dict)
    half_spaces_of: tuple[int, ...] = ()
