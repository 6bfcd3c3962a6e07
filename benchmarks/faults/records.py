"""Messages that a controller receives, and their permission to approach the tumour."""

from collections.abc import Sequence
from dataclasses import dataclass

from app.geometry import NS_PER_MS

UNKNOWN = 3
APPROACH_MM_S = 10.0
"""A twist towards the tumour that is faster than this is permissive; 50 mm/s are desired.

Of two places of the tumour at nearly equal distances the session and the truth may take different
ones. The directions differ by up to 25 degrees then, and a retreat by one has up to a sixth of the
desired speed along the other.
"""

TOLERANCE_NS = 30_000_000  # a permissive message later than this after the limit is late


@dataclass(frozen=True, slots=True)
class Content:
    """A constraint without ``seq``. ``single_source`` is None for messages without that field."""

    instance_id: str
    stamp_ns: int
    valid_until_ns: int
    state: int
    reasons: tuple[str, ...]
    hold: bool
    nonce: int
    stop_mm: float
    single_source: bool | None
    model_id: str
    raw: bytes


@dataclass(frozen=True, slots=True)
class Constraint:
    """One received constraint; system times in ns of sending and of arrival."""

    sent_ns: int
    arrived_ns: int
    seq: int
    content: Content

    @property
    def permissive(self) -> bool:
        """True if a controller that obeys ``valid_until`` may approach the tumour."""
        content = self.content
        held = content.hold or content.state == UNKNOWN
        return not held and self.sent_ns < content.valid_until_ns


@dataclass(frozen=True, slots=True)
class Twist:
    """One answer on ``~/allowed_twist``: its component towards the true tumour, in mm/s."""

    sent_ns: int
    arrived_ns: int
    approach_mm_s: float

    @property
    def permissive(self) -> bool:
        """True if it moves the tool towards the tumour, or is not finite."""
        return not self.approach_mm_s <= APPROACH_MM_S


@dataclass(frozen=True, slots=True)
class Verdict:
    """Effect of a fault. Times in ms from the fault; None if the session never became safe.

    ``error_mm``: error of the pose when the fault was detected.
    """

    to_safe_ms: float | None
    over_limit_ms: float
    late_constraints: int
    late_twists: int = 0
    max_approach_mm_s: float = 0.0
    reasons: tuple[str, ...] = ()
    single_source: bool | None = None
    error_mm: float | None = None
    note: str = ""


def judge(
    constraints: Sequence[Constraint],
    twists: Sequence[Twist],
    *,
    begin_ns: int,
    limit_ns: int,
    tolerance_ns: int = TOLERANCE_NS,
) -> Verdict:
    """Judge the messages sent from ``begin_ns`` on, when the fault began, in order of sending.

    From ``limit_ns`` on none may be permissive. The session counts as safe if the last message
    of each kind is not permissive.
    """
    constraints = [each for each in constraints if each.sent_ns >= begin_ns]
    twists = [each for each in twists if each.sent_ns >= begin_ns]
    permissive = [each for each in (*constraints, *twists) if each.permissive]
    last_ns = max((each.sent_ns for each in permissive), default=begin_ns)
    held = [each for each in constraints if not each.permissive]
    never = not held or constraints[-1].permissive or bool(twists and twists[-1].permissive)
    first_held_ns = next((each.sent_ns for each in held if each.sent_ns >= last_ns), last_ns)
    to_safe_ms = (first_held_ns - begin_ns) / NS_PER_MS
    late_ns = limit_ns + tolerance_ns
    sources = [each.content.single_source for each in constraints]
    return Verdict(
        to_safe_ms=None if never else to_safe_ms,
        over_limit_ms=max(0.0, (last_ns - limit_ns) / NS_PER_MS),
        late_constraints=sum(each.permissive and each.sent_ns > late_ns for each in constraints),
        late_twists=sum(each.permissive and each.sent_ns > late_ns for each in twists),
        max_approach_mm_s=max((each.approach_mm_s for each in twists), default=0.0),
        reasons=_reasons(held),
        single_source=None if None in sources or not sources else any(sources),
    )


def _reasons(held: Sequence[Constraint]) -> tuple[str, ...]:
    """Reasons of the first hold; ``expired`` if the last valid constraint was only repeated."""
    for each in held:
        if each.content.hold or each.content.state == UNKNOWN:
            return each.content.reasons
    return ("expired",) if held else ()
