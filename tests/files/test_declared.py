"""A mapping of a document, read as the dataclass that declares its keys."""

import math
from dataclasses import dataclass
from typing import Annotated

import pytest

from app.files.declared import By, block_of, read_as
from app.files.document import Section
from app.files.document_text import json_schema
from app.files.keys import Choice, Integer, ListOf, Number, Numbers, Text
from app.geometry import InputError
from tests.refusals import refused


@dataclass(frozen=True, slots=True)
class Part:
    name: Annotated[str, Text("its name")]
    max_rad: Annotated[float, Number("largest rotation", above=0.0)]
    turn_rad_s: Annotated[float, "turn_rad_s", Number("speed", default=2.0)]
    response_s: Annotated[float, "response_ms", Number("time constant", default=30.0)]


@dataclass(frozen=True, slots=True)
class Whole:
    age_ns: Annotated[int, Number("age", minimum=0.0)]
    is_needed: Annotated[
        bool, "use", Choice("use", ("needed", "not")), By(lambda it: it.choice("use") == "needed")
    ]
    sum: Annotated[
        int,
        {"a": Integer("one", 0), "b": Integer("other", 0)},
        By(lambda it: it.integer("a") + it.integer("b")),
    ]
    parts: Annotated[
        tuple[Part, ...], ListOf("parts", block_of(Part, "a part"), optional=True)
    ] = ()
    place: Annotated[tuple[float, ...] | None, Numbers("a place", 3, optional=True)] = None
    seen: int = 7

    def check(self, section: Section) -> None:
        if self.age_ns == 13_000_000:
            raise InputError(f"{section.place('age_ms')} is 13; expected any other number")


WHOLE = block_of(Whole, "a document")
GIVEN = {"age_ms": 1.5, "use": "needed", "a": 2, "b": 3}


def read(**values: object) -> Whole:
    return read_as(Whole, Section(GIVEN | values, "x.yaml:", WHOLE))


def test_values_are_in_the_unit_of_their_field():
    part = {"name": "p", "max_deg": 90.0}
    whole = read(parts=[part, part | {"turn_rad_s": 1.0, "response_ms": 5.0}])
    assert (whole.age_ns, whole.is_needed, whole.sum) == (1_500_000, True, 5)
    first, second = whole.parts
    assert first == Part("p", math.pi / 2, 2.0, 0.03)
    assert (second.turn_rad_s, second.response_s) == (1.0, 0.005)


def test_missing_optional_keys_give_the_default_of_their_field():
    whole = read()
    assert (whole.parts, whole.place, whole.seen) == ((), None, 7)
    assert read(place=[1, 2, 3]).place == (1.0, 2.0, 3.0)


def test_keys_and_schema_are_those_of_the_fields():
    assert list(WHOLE.keys) == ["age_ms", "use", "a", "b", "parts", "place"]
    part = json_schema(WHOLE, "x")["properties"]["parts"]["items"]
    assert part["required"] == ["name", "max_deg"]
    assert part["properties"]["max_deg"]["description"] == "largest rotation [degrees]"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"age_ms": 13.0}, "x.yaml: age_ms is 13; expected any other number"),
        ({"age_ns": 1}, "x.yaml: age_ns is unknown; expected one of age_ms"),
        ({"seen": 1}, "x.yaml: seen is unknown"),
        ({"parts": [{"name": "p"}]}, "x.yaml: parts[0].max_deg is missing"),
        ({"parts": {}}, "x.yaml: parts is {}; expected a list"),
    ],
)
def test_faults_are_refused_with_their_place(change, text):
    with refused(text=text):
        read(**change)
