"""A document as text, from its declaration: JSON Schema, and a file with comments.

The schema is of draft 2020-12 and uses only keywords that draft 7 has as well, because some editors
know no later draft.
"""

import json
import math
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

from app.files.keys import (
    Block,
    Boolean,
    Choice,
    Frame,
    Integer,
    Key,
    ListOf,
    Number,
    Numbers,
    Text,
    Texts,
    Variant,
    unit_of,
)
from app.geometry.frames import FRAME_NAME

DRAFT = "https://json-schema.org/draft/2020-12/schema"

GENERAL_RULES = (
    "a number is finite: not .nan or .inf",
    "an integer has no decimal point: 3, not 3.0",
    "the file is UTF-8 YAML 1.1 of at most 1 MB without tags, duplicate keys, merge keys and "
    "ambiguous numbers (010, 1_000, 1:30); an exponent has a point and a sign: 1.0e+3",
)
"""Rules of `load_yaml` and `Section` for every document that a schema cannot state."""

Schema = dict[str, Any]


def schema_text(block: Block, document: str) -> str:
    """Return the JSON Schema of ``document``, which has the keys of ``block``, as indented JSON.

    The name of a document may end with its schema: ``case-2``.
    """
    declared = block.keys.get("schema")
    version = declared.minimum if isinstance(declared, Integer) else 1
    name = document.removesuffix(f"-{version}")
    schema = json_schema(block, f"{name}.yaml of MarginGuard, schema {version}")
    return json.dumps(schema, indent=2) + "\n"


def json_schema(block: Block, title: str) -> Schema:
    """Return the JSON Schema of a document with the keys of ``block``."""
    schema = {"$schema": DRAFT, "title": title, **_schema(block)}
    schema["$comment"] = _comment((*GENERAL_RULES, *block.rules))
    return schema


def whole(pattern: str) -> str:
    """Return a regular expression for texts that match ``pattern`` as a whole.

    It has the same meaning in ECMA 262, which JSON Schema names, and in Python, where ``$`` also
    matches before a final newline.
    """
    return rf"^(?:{pattern})$(?!\n)"


def _schema(key: Key, unit: str = "") -> Schema:
    schema: Schema = {"description": f"{key.description} [{unit}]" if unit else key.description}
    if key.default is not None:
        schema["default"] = _plain(key.default)
    return schema | _type_of(key)


def _type_of(key: Key) -> Schema:
    match key:
        case Text(pattern=pattern):
            return {"type": "string", "pattern": whole(pattern.pattern) if pattern else r"\S"}
        case Frame():
            return {"type": "string", "pattern": whole(FRAME_NAME.pattern)}
        case Choice(options=options):
            return {"type": "string", "enum": list(options)}
        case Boolean():
            return {"type": "boolean"}
        case Integer():
            return {"type": "integer", **_bounds(key)}
        case Number(above=above):
            exclusive = {} if math.isinf(above) else {"exclusiveMinimum": _plain(above)}
            return {"type": "number", **_bounds(key), **exclusive}
        case Numbers(count=count):
            items = {"type": "number"}
            return {"type": "array", "items": items, "minItems": count, "maxItems": count}
        case ListOf(items=items, if_empty=if_empty):
            return {
                "type": "array",
                "items": _schema(items),
                **({"minItems": 1} if if_empty else {}),
            }
        case Texts(name=name, plain_values=plain_values):
            kinds = ["string", "number", "boolean"] if plain_values else "string"
            return {
                "type": "object",
                "propertyNames": {"type": "string", "pattern": whole(name.pattern)},
                "additionalProperties": {"type": kinds, "pattern": r"\S"},
            }
        case Block():
            return _object(key)
    raise TypeError(f"no JSON Schema for {type(key).__name__}")


def _bounds(key: Integer | Number) -> Schema:
    if key.minimum == key.maximum:
        return {"const": key.minimum}
    bounds = {"minimum": key.minimum, "maximum": key.maximum}
    return {
        name: _plain(value)
        for name, value in bounds.items()
        if value is not None and math.isfinite(value)
    }


def _object(block: Block) -> Schema:
    schema: Schema = {
        "type": "object",
        "properties": {
            **{name: _schema(key, unit_of(name)) for name, key in block.keys.items()},
            **{
                old: {"description": f"old name of {name}", **_type_of(block.keys[name])}
                for old, name in block.old_names.items()
            },
        },
        "required": [name for name, key in block.keys.items() if key.required],
        "additionalProperties": False,
    }
    if block.variants:
        schema["oneOf"] = [_variant(block, variant) for variant in block.variants]
    conditions: list[Schema] = [
        {"if": {"required": [key]}, "then": {"required": [other]}} for key, other in block.needs
    ]
    conditions += [{"not": {"required": list(names)}} for names in block.old_names.items()]
    if conditions:
        schema["allOf"] = conditions
    if block.rules:
        schema["$comment"] = _comment(block.rules)
    return schema


def _variant(block: Block, variant: Variant) -> Schema:
    others = dict.fromkeys(block.others_than(variant), False)
    return {
        "title": variant.name,
        "properties": {**variant.where, **others},
        "required": list(variant.required),
    }


def _comment(rules: tuple[str, ...]) -> str:
    return f"Checked by marginguard, not by this schema: {'; '.join(rules)}."


def _plain(value: bool | float | str) -> bool | float | str:
    """An integer for a whole number: 1, not 1.0."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


_WIDTH = 100


def commented_yaml(block: Block, values: Mapping[str, Any], title: str) -> str:
    """Return ``values`` as YAML in the order of the keys of ``block``, each below its description.

    Optional keys that ``values`` does not have are comments, too, with their default. ``title`` is
    the comment at the start of the file. The text is not checked: read it with the reader of the
    document.
    """
    lines = [*_comment_lines(title, ""), *_lines(block, values, "")]
    return "\n".join(lines) + "\n"


def _lines(block: Block, values: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, key in block.keys.items():
        if not indent:
            yield ""
        yield from _comment_lines(_described(key), indent)
        if name not in values:
            default = "" if key.default is None else _flow(key.default, "")
            yield f"{indent}# {name}: {default}".rstrip()
        elif isinstance(key, Block) and isinstance(values[name], Mapping):
            if values[name]:
                yield f"{indent}{name}:"
                yield from _lines(key, values[name], f"{indent}  ")
            else:
                yield f"{indent}{name}: {{}}"
        else:
            yield f"{indent}{name}: {_flow(values[name], indent)}"


def _described(key: Key) -> str:
    text = key.description
    if isinstance(key, Choice) and not all(option in text for option in key.options):
        text += f"; one of {', '.join(key.options)}"
    return f"{text} (optional)" if not key.required else text


def _flow(value: object, indent: str) -> str:
    text = yaml.safe_dump(
        value, default_flow_style=True, allow_unicode=True, width=_WIDTH - len(indent) - 20
    )
    lines = text.strip().removesuffix("...").strip().splitlines()
    return f"\n{indent}  ".join(lines)


def _comment_lines(text: str, indent: str) -> list[str]:
    prefix = f"{indent}# "
    return textwrap.wrap(text, _WIDTH, initial_indent=prefix, subsequent_indent=prefix)
