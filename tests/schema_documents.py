"""Hypothesis strategies: documents that a JSON Schema accepts, and documents with one fault more.

The strategy knows the keywords that the schemas of this project use. (The package
hypothesis-jsonschema does not run with the pinned version of Hypothesis.)
"""

import copy
import datetime
import math
from collections.abc import Iterator
from typing import Any

from hypothesis import strategies as st

from tests.valid_documents import IDENTITY

Values = dict[str, Any]

QUARTER_TURN = [0, -1.0, 0, 5.5, 1.0, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1]
TEXTS = ("a", "tumor.stl", "t.Seg.NRRD", "two words", "ü", "1")


def documents(schema: Values) -> st.SearchStrategy[Any]:
    """Values that ``schema`` accepts, except for its rules ``allOf``."""
    if "const" in schema:
        return st.just(schema["const"])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    if isinstance(schema["type"], list):
        return st.one_of([documents({**schema, "type": kind}) for kind in schema["type"]])
    match schema["type"]:
        case "boolean":
            return st.booleans()
        case "string":
            return _texts(schema["pattern"])
        case "array":
            return _lists(schema)
        case "object" if "propertyNames" in schema:
            names, values = schema["propertyNames"], schema["additionalProperties"]
            return st.dictionaries(documents(names), documents(values), max_size=2)
        case "object":
            variants = schema.get("oneOf", [{"properties": {}, "required": []}])
            return st.one_of([_mappings(schema, variant) for variant in variants])
    return _numbers(schema)


def _texts(pattern: str) -> st.SearchStrategy[str]:
    if pattern == r"\S":
        return st.sampled_from(TEXTS) | st.text(min_size=1).filter(str.strip)
    return st.from_regex(pattern.removesuffix(r"(?!\n)").removesuffix("$") + r"\Z")


def _numbers(schema: Values) -> st.SearchStrategy[float]:
    low, high = schema.get("minimum"), schema.get("maximum")
    integers = st.integers(math.ceil(low) if low is not None else None, high)
    if schema["type"] == "integer":
        return integers
    above = schema.get("exclusiveMinimum")
    floats = st.floats(
        low if above is None else above,
        high,
        exclude_min=above is not None,
        allow_nan=False,
        allow_infinity=False,
    )
    near = st.integers(1, 9) if low is None or low <= 1 else integers
    return near | floats


def _lists(schema: Values) -> st.SearchStrategy[list[Any]]:
    size = schema.get("minItems", 0)
    lists = st.lists(
        documents(schema["items"]), min_size=size, max_size=schema.get("maxItems", size + 2)
    )
    if size != len(IDENTITY):
        return lists
    return st.sampled_from((IDENTITY, QUARTER_TURN)) | lists


def _mappings(schema: Values, variant: Values) -> st.SearchStrategy[Values]:
    properties = dict(schema["properties"])
    for name, rule in variant["properties"].items():
        if rule is False:
            del properties[name]
        elif "const" in rule:
            properties[name] = rule
        else:
            is_segmentation = "not" not in rule
            ending = ".nrrd" if is_segmentation else ".stl"
            properties[name] = {"enum": [f"a{ending}", f"folder/B{ending.upper()}"]}
    required = {*schema["required"], *variant["required"]}
    return st.fixed_dictionaries(
        {name: documents(properties[name]) for name in properties if name in required},
        optional={name: documents(properties[name]) for name in properties if name not in required},
    )


def settled(values: Values) -> Values:
    """Make ``values``, a case or live document, obey the rules that a schema cannot state."""
    values = copy.deepcopy(values)
    if values["schema"] == 1:
        tools, structures = [values["tool"]], [{**values["tumor"], "margins": values["margins"]}]
        robots, registrations = [values.get("robot", {})], [values.get("registration", {})]
        values["tumor"] = structures[0]
    else:
        _name_all(values)
        tools, structures, robots = values["tools"], values["structures"], values["robots"]
        registrations = [robot["registration"] for robot in robots]
    for tool in tools:
        tool["tip_from"] = {"matrix": QUARTER_TURN}
    for structure in structures:
        structure |= {"frame": tools[0]["frame"] + "_2", "pose": {"matrix": QUARTER_TURN}}
        margins = structure["margins"]
        margins["stop_mm"] = min(margins["stop_mm"], 1e6)
        margins["warn_mm"] = margins["stop_mm"] + 1.0
    if values["schema"] == 1:
        del values["tumor"]["margins"]
    for robot in robots:
        if "xacro_args" in robot:
            robot["urdf"] = "package://arm/arm.xacro"
    for registration in registrations:
        _settle_registration(registration)
    plausibility = values.get("plausibility", {})
    for pair in plausibility.get("pairs", []):
        pair["child"] = pair["parent"] + "_2"
        if "pose" in pair:
            pair["pose"] = {"matrix": QUARTER_TURN}
    if "min_mm" in (workspace := plausibility.get("workspace", {})):
        workspace |= {"min_mm": [0.0, 0, 0], "max_mm": [1.0, 1, 1]}
    plausibility.get("approach", {}).update({"direction": [0.0, 0, 1], "axis": [1.0, 0, 0]})
    return values


def _name_all(values: Values) -> None:
    """Give tools, structures and robots names and frames of their own; one is a target."""
    tools = values["tools"]
    values["robots"] = values.get("robots", [])[: len(tools)]
    for index, tool in enumerate(tools):
        tool |= {"name": f"tool {index}", "frame": f"tool_{index}"}
    for index, structure in enumerate(values["structures"]):
        structure["name"] = f"structure_{index}"
    values["structures"][-1]["role"] = "target"
    for index, robot in enumerate(values["robots"]):
        robot |= {"name": f"arm {index}", "holds": tools[index]["name"]}
        robot["base_frame"] = f"base_{index}"


def _settle_registration(registration: Values) -> None:
    if "fixed_mm" in registration:
        registration["moving_mm"] = registration["fixed_mm"]
    for index, dwell in enumerate(registration.get("dwells", [])):
        dwell |= {"start_s": 2 * index, "end_s": 2 * index + 1.5}
    if "matrix" in registration:
        registration["matrix"] = IDENTITY


FAULTS: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 3.0, -0.0, 0.05, 1.5, 70_000, 4e10, 10**400, math.nan,
    math.inf, -math.inf, "", " ", "a", "a b", "a\n", "/a", "/a/", "/a\n", "a.nrrd", "a.nrrd\n",
    "given", "host", "1e3", [], [1], [[1, 2]], [None], {}, {"path": "a"}, {"matrix": IDENTITY},
    {1: 2}, datetime.date(2026, 1, 1),
)  # fmt: skip
"""Values of every type, and values at bounds."""


@st.composite
def faulty(draw: st.DrawFn, valid: list[Values]) -> Values:
    """One of ``valid`` with one to three edits, each of which may make it invalid.

    An edit removes or replaces a value, copies one of another document, or adds a key.
    """
    values = copy.deepcopy(draw(st.sampled_from(valid)))
    for _ in range(draw(st.sampled_from((1, 1, 2, 3)))):
        if not values:
            return values
        holder, key = draw(st.sampled_from(list(_places(values))))
        others = list(_places(draw(st.sampled_from(valid))))
        match draw(st.sampled_from(("remove", "replace", "replace", "same key", "copy", "add"))):
            case "remove":
                del holder[key]
            case "replace":
                holder[key] = copy.deepcopy(draw(st.sampled_from(FAULTS)))
            case "same key":
                other, name = draw(st.sampled_from([at for at in others if at[1] == key] or others))
                holder[key] = copy.deepcopy(other[name])
            case "copy":
                other, name = draw(st.sampled_from(others))
                holder[name if isinstance(holder, dict) else key] = copy.deepcopy(other[name])
            case "add" if isinstance(holder, dict):
                holder[draw(st.sampled_from(("stop_m", "units_", 1, None)))] = 1
            case _:
                holder.append(copy.deepcopy(holder[0]))
    return values


def _places(values: Any) -> Iterator[tuple[Any, Any]]:
    """Pairs of a mapping or list and a key or index of it; of a list of numbers only the first."""
    keys = list(values) if isinstance(values, dict) else list(range(len(values)))
    if isinstance(values, list) and all(isinstance(value, int | float) for value in values):
        keys = keys[:1]
    for key in keys:
        yield values, key
        if isinstance(values[key], dict | list):
            yield from _places(values[key])
