"""Write a YAML document with the descriptions of its keys as comments."""

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

from app.files.keys import Block, Choice, Key

_WIDTH = 100


def commented_yaml(block: Block, values: Mapping[str, Any], title: str) -> str:
    """Return ``values`` as YAML in the order of the keys of ``block``, each below its description.

    Optional keys that ``values`` does not have are comments, too, with their default. ``title`` is
    the comment at the start of the file. The text is not checked: read it with the reader of the
    document.
    """
    lines = [*_comment(title, ""), *_lines(block, values, "")]
    return "\n".join(lines) + "\n"


def _lines(block: Block, values: Mapping[str, Any], indent: str) -> Iterator[str]:
    for name, key in block.keys.items():
        if not indent:
            yield ""
        yield from _comment(_described(key), indent)
        if name not in values:
            yield f"{indent}# {name}: {_default(key)}".rstrip()
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


def _default(key: Key) -> str:
    """The default of a key that is left out; empty where it has none."""
    return "" if key.default is None else _flow(key.default, "")


def _flow(value: object, indent: str) -> str:
    text = yaml.safe_dump(
        value, default_flow_style=True, allow_unicode=True, width=_WIDTH - len(indent) - 20
    )
    lines = text.strip().removesuffix("...").strip().splitlines()
    return f"\n{indent}  ".join(lines)


def _comment(text: str, indent: str) -> list[str]:
    prefix = f"{indent}# "
    return textwrap.wrap(text, _WIDTH, initial_indent=prefix, subsequent_indent=prefix)
