"""Mutations of JSON and XML: values, keys, attributes and whole subtrees."""

import json
from collections.abc import Callable
from copy import deepcopy
from random import Random
from typing import Any

from lxml import etree

from tests.fuzz.mutators.text import NUMBERS, WORDS

_MAX_TEXT = 400_000
_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**31, 2**32, 2**63, 10**400, 0.5, 1e308, -1e-320),
    *(float("nan"), float("inf"), "", "x", "a" * 100_000, "\0", "../x", [], {}, [[]], [0], [None]),
    *({"": 0}, [1e400] * 3, ["x"] * 16, list(range(16)), [0.0] * 16),
)


def _short(text: bytes) -> bytes:
    if len(text) > _MAX_TEXT:
        raise ValueError("long")
    return text


def mutate_json(data: bytes, random: Random) -> bytes:
    """Change one place of a JSON document."""
    root = json.loads(data)
    places = _places(root)
    container, key = random.choice(places)
    match random.randrange(8):
        case 0:
            del container[key]
        case 1 | 2:
            container[key] = deepcopy(random.choice(_VALUES))
        case 3:
            other, at = random.choice(places)
            container[key] = deepcopy(other[at])
        case 4 if isinstance(container, list):
            container[key:key] = [container[key]] * random.choice((1, 2, 50))
        case 5:
            for _ in range(random.choice((1, 3, 40, 300))):
                inner = container[key]
                container[key] = [inner] if random.random() < 0.7 else {"children": inner}
        case 6 if isinstance(container, dict):
            container[random.choice((key + "_", "", "name", key.upper()))] = container.pop(key)
        case _:
            container[key] = _other_number(container[key], random)
    return _short(json.dumps(root).encode())


def _places(root: Any) -> list[tuple[Any, Any]]:
    """Every container with each of its keys or indices."""
    found: list[tuple[Any, Any]] = []
    waiting = [root]
    while waiting:
        node = waiting.pop()
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            found.append((node, key))
            if isinstance(node[key], dict | list):
                waiting.append(node[key])
    return found


def _other_number(value: Any, random: Random) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)[:1000]
    return random.choice((value + 1, value - 1, -value, value * 1000, float(value % 7), str(value)))


def mutate_xml(data: bytes, random: Random) -> bytes:
    """Change one element of an XML document."""
    root = etree.fromstring(data, etree.XMLParser(resolve_entities=False, huge_tree=True))
    elements = [each for each in root.iter() if isinstance(each.tag, str)]
    random.choice(_XML_CHANGES)(random.choice(elements), elements, random)
    return _short(etree.tostring(root))


def _change_attribute(element: Any, _: list[Any], random: Random) -> None:
    if not element.attrib:
        element.set("name", "x")
    key = random.choice(list(element.attrib))
    words = element.attrib[key].split() or [""]
    edges = NUMBERS if random.random() < 0.6 else WORDS
    words[random.randrange(len(words))] = random.choice(edges).decode("utf-8", "replace")
    element.set(key, " ".join(words))


def _delete_attribute(element: Any, _: list[Any], random: Random) -> None:
    del element.attrib[random.choice(list(element.attrib))]


def _copy_attribute(element: Any, elements: list[Any], random: Random) -> None:
    key, value = random.choice(list(random.choice(elements).attrib.items()))
    element.set(key, value)


def _delete_element(element: Any, _: list[Any], random: Random) -> None:
    element.getparent().remove(element)


def _copy_element(element: Any, elements: list[Any], random: Random) -> None:
    copied = deepcopy(random.choice(elements))
    if sum(1 for _ in copied.iter()) < 2000:
        element.append(copied)


def _repeat_element(element: Any, _: list[Any], random: Random) -> None:
    if sum(1 for _ in element.iter()) < 50:
        for _ in range(random.choice((1, 2, 20, 300 if random.random() < 0.1 else 5))):
            element.getparent().append(deepcopy(element))


def _nest_element(element: Any, _: list[Any], random: Random) -> None:
    for _ in range(random.choice((1, 3, 60, 250))):
        element = etree.SubElement(element, element.tag, dict(element.attrib))


def _rename_element(element: Any, elements: list[Any], random: Random) -> None:
    element.tag = random.choice(elements).tag if random.random() < 0.7 else "x"


def _change_text(element: Any, _: list[Any], random: Random) -> None:
    words = (element.text or "").split() or [""]
    for _ in range(random.choice((1, 1, 3))):
        words[random.randrange(len(words))] = random.choice(NUMBERS).decode("utf-8", "replace")
    if random.random() < 0.2:
        words = words[: len(words) // 2]
    element.text = " ".join(words)


_XML_CHANGES: tuple[Callable[[Any, list[Any], Random], None], ...] = (
    *(_change_attribute, _change_attribute, _change_attribute, _delete_attribute, _copy_attribute),
    *(_delete_element, _copy_element, _repeat_element, _nest_element, _rename_element),
    *(_change_text, _change_text),
)
