"""The keys of ``cohort.yaml``: which cases a cohort has."""

import json

from app.cohort.design import FIXTURES, OPTION_RANGES
from app.files.json_schema import json_schema
from app.files.keys import Block, Choice, Integer, ListOf, Numbers, Text, Variant
from app.synthetic.presets import PRESETS

MAX_COUNT = 10_000_000
ORDERED = "low is not above high, and both are within the limits of the option"
UNIQUE_NAMES = "names of cases differ from each other"
KNOWN_TRACKERS = f"trackers are of {', '.join(PRESETS)}"

_SIMULATED = Block(
    "cases that workers make from a seed and ranges of options",
    {
        "count": Integer("number of cases", 1, MAX_COUNT),
        "seed": Integer("of all random values", 0, 2**63 - 1),
        "trackers": ListOf(
            "presets of trackers, of which each case has one",
            Text("preset"),
            if_empty="expected presets",
        ),
        "surgeons": Integer("number of surgeons", 1, 100_000),
        "fixture": Choice(
            "virtual fixture: off, on, paired (two cases of every draw, without and with it) or "
            "alternate (every second case)",
            FIXTURES,
        ),
        **{
            key: Numbers(
                f"{option.description}: low and high, {option.low:g} to {option.high:g}",
                2,
                optional=True,
            )
            for key, option in OPTION_RANGES.items()
        },
    },
    optional=True,
    rules=(ORDERED, KNOWN_TRACKERS),
)

_CASE = Block(
    "a recorded case",
    {
        "name": Text("name, unique in the cohort"),
        "source": Text("case folder: a path, relative to this file, or a URL"),
        "group": Text("group in a comparison; default: none", optional=True),
        "surgeon": Text("who operated; default: unknown", optional=True),
        "pair": Text("name that joins a case of each group; default: none", optional=True),
    },
)

COHORT = Block(
    "a cohort",
    {
        "schema": Integer("version of the format", 1, 1),
        "name": Text("name of the cohort, shown in the report"),
        "simulated": _SIMULATED,
        "cases": ListOf("recorded cases", _CASE, optional=True, if_empty="expected cases"),
    },
    variants=(Variant("simulated", ("simulated",)), Variant("recorded", ("cases",))),
    rules=(UNIQUE_NAMES,),
)


def cohort_schema_text() -> str:
    """Return the JSON Schema of ``cohort.yaml``, as indented JSON."""
    schema = json_schema(COHORT, "cohort.yaml of MarginGuard, schema 1")
    return json.dumps(schema, indent=2) + "\n"
