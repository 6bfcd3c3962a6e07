"""Compares the readers of case.yaml, live.yaml and expected.yaml with their JSON Schemas.

A reader and a schema agree on a document if both accept it, if both refuse it, or if the reader
refuses it for a rule that a schema cannot state (`UNSTATED`).
"""

import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema

from app.case import DOCUMENTS
from app.case.live_file import read_live
from app.case.manifest.case_file import read_manifest
from app.case.manifest.display_items import DISPLAY_ITEMS
from app.case.manifest.expected import read_expected
from app.case.manifest.images import FROM_IGTL, LISTED_DEPTH, NOT_BOTH, ONE_SOURCE
from app.case.manifest.key_rules import RIGID
from app.case.manifest.structures import DIFFERENT, MEASURABLE
from app.files import schema_text
from app.files.document import Section
from app.files.document_text import GENERAL_RULES
from app.geometry import MarginGuardError

UNSTATED = {
    GENERAL_RULES[0]: r"expected a finite number",
    GENERAL_RULES[1]: r" is -?[\d.]+(e\+\d+)?; expected an integer",
    RIGID: r"(rotation|last row of the matrix) of \S+_from_\S+ is ",
    DIFFERENT: r"(tools|structures|robots)(: .*; expected (a|another)| has (\d+|no target);)"
    r"|holds is .*; expected one|structures\.\S+\.frame is .*, the frame of the tool;",
    MEASURABLE: r"tool_distance_mm is given",
    "tumor.frame is not the frame of the tool": r"tumor\.frame is .*, the frame of the tool;",
    **{
        each.rules[0]: rf"{each.name}\.frame is .*; expected that of a sensor on the {each.name}"
        for each in DISPLAY_ITEMS
    },
    **{
        rule: rf"{each.name}\.tip_from is \S+ mm from the sensor's origin; expected 1 mm or more"
        for each in DISPLAY_ITEMS
        for rule in each.rules[1:]
    },
    "warn_mm is more than stop_mm": r"warn_mm is .*expected more than stop_mm",
    "moving_mm has as many points as fixed_mm": r"moving_mm has \d+ points; expected \d+",
    "dwells do not overlap": r"registration\.dwells overlap",
    "end_s is after start_s": r"end_s is .*; expected a time after start_s",
    "parent and child are two frames": r"child is .*, the parent; expected another frame",
    "a direction and an axis have a length above 0": r"has length \S+; expected more than 0",
    "every value of max_mm is more than that of min_mm": r"max_mm is .*expected more than min_mm",
    "xacro_args are given for a .xacro only": r"xacro_args are given, but .* is not a \.xacro file",
    NOT_BOTH: r"images has path and topic; expected one",
    LISTED_DEPTH: r"images\.(calibrations: depth_mm .* is listed twice|depth_mm is .* one of cal)",
    FROM_IGTL: r"images has (no topic and the source|topic and device)",
    ONE_SOURCE: r"cautery(\.device is .* is not igtl| has (neither topic nor|topic and) device)",
    "end_s is start_s or later": r"end_s is .*; expected start_s \(.*\) or later",
}
"""Rule that a reader of values checks and a schema cannot state -> its message."""

READERS: dict[str, Callable[[Section], object]] = {
    "case": read_manifest,
    "case-2": read_manifest,
    "live": lambda document: read_live(document, Path("live.yaml")),
    "live-2": lambda document: read_live(document, Path("live.yaml")),
    "expected": lambda document: read_expected(document, reference="reference", robot_base="base"),
}


@cache
def validator(document: str) -> Any:
    """The validator of a document by the independent library ``jsonschema``."""
    return jsonschema.Draft202012Validator(json.loads(schema_text(DOCUMENTS[document], document)))


def section_of(document: str, values: object) -> Section:
    """``values`` as a document for its reader in `READERS`."""
    return Section(values, f"{document.removesuffix('-2')}.yaml:", DOCUMENTS[document])


def refusal(document: str, values: object) -> str | None:
    """The message with which the reader refuses ``values``, None if it accepts them."""
    try:
        READERS[document](section_of(document, values))
    except MarginGuardError as error:
        return str(error)
    return None


def disagreement(document: str, values: object) -> str | None:
    """Describe how the reader and the schema differ on ``values``; None if they agree."""
    return difference(refusal(document, values), validator(document), values)


def difference(message: str | None, schema: Any, values: object) -> str | None:
    """Describe how ``schema`` differs from a reader that has refused with ``message``, or None."""
    error = next(iter(schema.iter_errors(values)), None)
    if message is None:
        return error and f"the reader accepts and the schema refuses: {error.message}"
    if error is None and not any(re.search(pattern, message) for pattern in UNSTATED.values()):
        return f"the schema accepts and the reader refuses: {message}"
    return None
