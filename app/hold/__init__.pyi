from .changes import loosened_margins, margin_changes, moved_text, tightest_margins, tip_change_text
from .hold import Hold, NotRearmableError
from .identity import HoldIdentity, Holds, NextHold, RandomBits, RearmRefusedError, SeenHold
from .instance import InstanceKey, SecondInstanceError, StateFileError, arm_name, host_id
from .on_disk import LiveState, live_state, refuse_beside_guard
from .record import causes_of_record, read_any_record
from .used_values import UsedValues

__all__ = [
    "Hold",
    "HoldIdentity",
    "Holds",
    "InstanceKey",
    "LiveState",
    "NextHold",
    "NotRearmableError",
    "RandomBits",
    "RearmRefusedError",
    "SecondInstanceError",
    "SeenHold",
    "StateFileError",
    "UsedValues",
    "arm_name",
    "causes_of_record",
    "host_id",
    "live_state",
    "loosened_margins",
    "margin_changes",
    "moved_text",
    "read_any_record",
    "refuse_beside_guard",
    "tightest_margins",
    "tip_change_text",
]
