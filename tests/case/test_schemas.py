"""JSON Schemas of case, live and expected documents: complete, and as strict as the readers."""

import json
import math
import re
from collections.abc import Iterator
from typing import Any

import jsonschema
import pytest
import yaml

from app.case import DOCUMENTS, open_live
from app.case.live_file import ABOVE_0, NEEDS_ROBOT, PASSIVE
from app.case.manifest.case_file import FILES, OWN_BASE_FRAME
from app.case.manifest.display_items import DISPLAY_ITEMS
from app.case.manifest.images import FROM_IGTL, LISTED_DEPTH, NOT_BOTH, ONE_SOURCE
from app.case.manifest.key_rules import RIGID, SESSION_LIMITS
from app.case.manifest.structures import DIFFERENT, MEASURABLE
from app.cli.commands.doctor import SCHEMA_NAMES
from app.files import schema_text
from app.files.document_text import GENERAL_RULES
from app.files.keys import Block, Key, ListOf
from app.fixture import LimiterParameters
from app.geometry import MarginGuardError
from app.session import limiter_parameters
from app.session.case_setup import margin_parameters
from tests.cli.command import refused, run
from tests.schema_agreement import UNSTATED, refusal, validator
from tests.valid_documents import (
    BOX,
    DEPTHS,
    IDENTITY,
    IMAGES,
    ITEMS,
    LIVE_IMAGES,
    PLAUSIBILITY,
    POINTS,
    ROOT,
    SHIPPED,
    VALID,
    XACRO,
    shipped,
)

FREE_NAMES = ("robot.xacro_args.", "robots.xacro_args.", "package_dirs.")
"""Mappings with names of the user's choice."""


@pytest.mark.parametrize("document", DOCUMENTS)
def test_schema_is_valid_and_uses_keywords_of_draft_7_only(document):
    schema = json.loads(schema_text(DOCUMENTS[document], document))
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.Draft7Validator.check_schema(schema)
    known = set(jsonschema.Draft7Validator.VALIDATORS) | {
        "$schema", "$comment", "title", "description", "default", "then",
    }  # fmt: skip
    assert set(_keywords(schema)) <= known


def _keywords(schema: Any) -> Iterator[str]:
    if not isinstance(schema, dict):
        return
    for keyword, value in schema.items():
        yield keyword
        if keyword == "properties":
            for inner in value.values():
                yield from _keywords(inner)
        elif keyword in ("items", "not", "if", "then"):
            yield from _keywords(value)
        elif keyword in ("oneOf", "allOf"):
            for inner in value:
                yield from _keywords(inner)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_committed_schema_is_the_generated_one(document):
    committed = ROOT / "docs/schemas" / f"{document}.schema.json"
    assert committed.read_text() == schema_text(DOCUMENTS[document], document), (
        f"run: marginguard doctor schema {document} -o docs/schemas/{document}.schema.json"
    )


def test_command_prints_and_writes_the_schema(tmp_path):
    assert (*DOCUMENTS, "world", "control", "cohort") == SCHEMA_NAMES
    assert run("doctor", "schema", "live").out == schema_text(DOCUMENTS["live"], "live")
    run("doctor", "schema", "case", "-o", tmp_path / "case.schema.json")
    assert (tmp_path / "case.schema.json").read_text() == schema_text(DOCUMENTS["case"], "case")
    case = tmp_path / "case.yaml"
    case.write_text("schema: 1\n")
    error = refused("doctor", "schema", "case", "-o", case)
    assert error.endswith("case.yaml'; expected a file name that ends with .json")
    assert case.read_text() == "schema: 1\n"


@pytest.mark.parametrize(("path", "document"), SHIPPED.items())
def test_shipped_files_are_valid(path, document):
    validator(document).validate(yaml.safe_load((ROOT / path).read_text()))


def test_every_shipped_document_is_checked():
    found = {
        path.relative_to(ROOT).as_posix()
        for name in DOCUMENTS
        for path in (ROOT / "data").rglob(f"{name}*.yaml")
    }
    assert found == set(SHIPPED)


@pytest.mark.parametrize(("document", "values"), VALID)
def test_complete_documents_are_valid(document, values):
    assert refusal(document, values) is None
    validator(document).validate(values)


@pytest.mark.parametrize(("document", "block"), DOCUMENTS.items())
def test_complete_documents_have_every_key(document, block):
    used = {path for name, values in VALID if name == document for path in _paths(values)}
    declared = set(_declared_paths(block))
    if document.startswith("live"):
        declared = {path for path in declared if "registration.dwells" not in path}
    assert used == declared


def _paths(values: object, place: str = "") -> Iterator[str]:
    """Paths of all keys: ``margins.stop_mm``. Items of a list have the path of the list."""
    if isinstance(values, list):
        for value in values:
            yield from _paths(value, place)
    if isinstance(values, dict) and place not in FREE_NAMES:
        for key, value in values.items():
            yield f"{place}{key}"
            yield from _paths(value, f"{place}{key}.")


def _declared_paths(key: Key, place: str = "") -> Iterator[str]:
    if isinstance(key, ListOf):
        yield from _declared_paths(key.items, place)
    if isinstance(key, Block):
        for name, inner in key.keys.items():
            yield f"{place}{name}"
            yield from _declared_paths(inner, f"{place}{name}.")


def changed(document: dict[str, Any], **values: object) -> dict[str, Any]:
    """The only block of ``document`` with other values."""
    (block,) = document.values()
    return block | values


SOME_PAIR, _ = PLAUSIBILITY["plausibility"]["pairs"]
SOME_APPROACH = PLAUSIBILITY["plausibility"]["approach"]
SOME_BOX = BOX["plausibility"]["workspace"]

EXAMPLES: dict[str, tuple[str, str, object]] = {
    GENERAL_RULES[0]: ("case", "margins.k_tre", math.inf),
    GENERAL_RULES[1]: ("case", "schema", 1.0),
    RIGID: ("case", "tumor.pose.matrix", [2.0, *IDENTITY[1:]]),
    DIFFERENT: ("case-2", "structures.1.name", "cautery"),
    MEASURABLE: ("case-2", "tool_distance_mm", 5.0),
    "tumor.frame is not the frame of the tool": ("live", "tumor.frame", "cautery"),
    **{
        each.rules[0]: ("live", each.name, ITEMS[each.name] | {"frame": "cautery"})
        for each in DISPLAY_ITEMS
    },
    **{
        rule: ("case", each.name, ITEMS[each.name] | {"tip_from": {"matrix": IDENTITY}})
        for each in DISPLAY_ITEMS
        for rule in each.rules[1:]
    },
    "warn_mm is more than stop_mm": ("live", "margins.stop_mm", 5),
    "moving_mm has as many points as fixed_mm": (
        "case", "registration", changed(POINTS, moving_mm=[]),
    ),
    "dwells do not overlap": ("case", "registration.dwells.1.start_s", 1.0),
    "end_s is after start_s": ("case", "registration.dwells.0.end_s", 0.05),
    "parent and child are two frames": (
        "live", "plausibility", {"pairs": [{**SOME_PAIR, "child": "reference"}]},
    ),
    "a direction and an axis have a length above 0": (
        "case", "plausibility", {"approach": {**SOME_APPROACH, "axis": [0.0, 0.0, 0.0]}},
    ),
    "every value of max_mm is more than that of min_mm": (
        "case", "plausibility", {"workspace": {**SOME_BOX, "max_mm": [1.0, 0.0, 1.0]}},
    ),
    "xacro_args are given for a .xacro only": (
        "case", "robot", XACRO["robot"] | {"urdf": "arm.urdf"},
    ),
    NOT_BOTH: ("case", "images", changed(IMAGES, topic="/image")),
    FROM_IGTL: ("live", "images", LIVE_IMAGES["images"]),
    LISTED_DEPTH: ("case", "images", changed(DEPTHS, depth_mm=60)),
    ONE_SOURCE: ("live", "cautery", {"device": "Cautery"}),
    "end_s is start_s or later": ("expected", "dropouts.0.end_s", 1),
}  # fmt: skip
"""Rule of `UNSTATED` -> a document that breaks it."""


@pytest.mark.parametrize("rule", UNSTATED)
def test_reader_checks_the_rule_that_a_schema_cannot_state(rule):
    document, path, value = EXAMPLES[rule]
    block = values = shipped(document)
    *places, key = path.split(".")
    for place in places:
        block = block[int(place) if isinstance(block, list) else place]
    block[key] = value
    assert validator(document).is_valid(values)
    assert re.search(UNSTATED[rule], str(refusal(document, values)))


HELD_BY = {
    FILES: "tests/case/test_case.py",
    GENERAL_RULES[2]: "tests/files/test_document.py",
    OWN_BASE_FRAME: "tests/session/test_named_frames.py",
    NEEDS_ROBOT: "tests/session/test_tumor_velocity.py",
    PASSIVE: "tests/case/test_live_file.py",
    ABOVE_0: "tests/case/test_live_file.py",
    SESSION_LIMITS: "tests/case/test_schemas.py",
    "a covariance is symmetric and has no negative variance": (
        "tests/registration/uncertainty/test_result.py"
    ),
}
"""Rule that is not about the values of one document -> where the refusal is tested."""


def test_every_rule_that_a_schema_does_not_state_is_tested_and_in_its_comments():
    rules = {rule for block in DOCUMENTS.values() for rule in _rules(block)} | {*GENERAL_RULES}
    assert rules == {*UNSTATED, *HELD_BY}
    assert all((ROOT / path).is_file() for path in HELD_BY.values())
    schemas = [path.read_text() for path in (ROOT / "docs/schemas").glob("*.json")]
    assert [rule for rule in rules if not any(rule in text for text in schemas)] == []


def _rules(key: Key) -> Iterator[str]:
    if isinstance(key, ListOf):
        yield from _rules(key.items)
    if isinstance(key, Block):
        yield from key.rules
        for inner in key.keys.values():
            yield from _rules(inner)


LIMITS = re.findall(r"(\w+) up to (\d+)", SESSION_LIMITS)


def test_session_limits_name_all_margins():
    assert {key for key, _ in LIMITS} == set(DOCUMENTS["case"].keys["margins"].keys)


@pytest.mark.parametrize(("key", "limit"), LIMITS)
def test_session_limits_are_those_of_the_fixture(tmp_path, key, limit):
    values = shipped("live")
    values["margins"] |= {"stop_mm": 0, "warn_mm": 200}
    path = tmp_path / "live.yaml"

    def parameters(value: int) -> object:
        values["margins"][key] = value
        validator("live").validate(values)
        path.write_text(yaml.safe_dump(values))
        return margin_parameters(open_live(path).case)

    parameters(int(limit))
    with pytest.raises(MarginGuardError, match=key.removesuffix("_ms")):
        parameters(int(limit) + 1)


def test_defaults_of_the_limiter_are_those_of_the_fixture(tmp_path):
    path = tmp_path / "live.yaml"
    path.write_text(yaml.safe_dump(shipped("live") | {"limiter": {}}))
    assert limiter_parameters(open_live(path)) == LimiterParameters()
