"""The keys of ``cautery`` in ``case.yaml`` and ``live.yaml``, and their reader."""

from app.case.manifest.entries import CauteryEntry
from app.case.manifest.key_rules import TOPIC, TOPIC_EXPECTED
from app.files.document import Section
from app.files.keys import Block, Number, Text
from app.geometry import NS_PER_MS, InputError

ONE_SOURCE = "cautery has topic or device, and device needs source.igtl"

_DAY_MS = 86_400_000
_TOPIC = Text(
    "topic of std_msgs/Bool: true while the cautery burns",
    optional=True,
    pattern=TOPIC,
    expected=TOPIC_EXPECTED,
)
_AGE = Number(
    "age after which what was said is unknown; longer than the period of the messages",
    default=1000.0,
    above=0.0,
    maximum=_DAY_MS,
)

CAUTERY = Block(
    "whether the cautery burns, shown and recorded only",
    {
        "topic": Text(
            "topic of std_msgs/Bool in the recording, a bag: true while the cautery burns",
            pattern=TOPIC,
            expected=TOPIC_EXPECTED,
        ),
        "stale_after_ms": _AGE,
    },
    optional=True,
)

LIVE_CAUTERY = Block(
    "whether the cautery burns, shown and recorded only; it changes no margin",
    {
        "topic": _TOPIC,
        "device": Text(
            "device name of OpenIGTLink STRING messages (on, off) of source.igtl, instead of topic",
            optional=True,
        ),
        "stale_after_ms": _AGE,
    },
    optional=True,
    rules=(ONE_SOURCE,),
)


def read_cautery(document: Section) -> CauteryEntry | None:
    """Read ``cautery``; None for a session without it."""
    if "cautery" not in document:
        return None
    block = document.section("cautery")
    topic = block.text("topic") if "topic" in block else None
    device = block.text("device") if "device" in block else None
    if (topic is None) == (device is None):
        found = "neither topic nor device" if topic is None else "topic and device"
        raise InputError(f"{block.where} has {found}; expected one of them")
    return CauteryEntry(topic, device, round(block.number("stale_after_ms") * NS_PER_MS))
