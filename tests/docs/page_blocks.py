"""Fenced blocks of a page, with the comment above each that says how it is executed."""

import re
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(
    r"^(?P<indent> *)(?:<!-- (?P<comment>[^\n]*) -->\n(?P=indent))?"
    r"```(?P<language>\w*)\n(?P<text>.*?)^(?P=indent)```",
    re.MULTILINE | re.DOTALL,
)
COMMENT_KEY = re.compile(
    r"(terminal|until|status|retry|ctrl-c|install|not run|file)(?:[: ] *(.*))?"
)
KEYS = {
    "sh": {"terminal", "until", "status", "retry", "install", "not run"},
    "python": {"file", "not run"},
    "text": {"terminal", "ctrl-c", "not run"},
    "": set(),
}
"""Language -> keys of its comment. Blocks of other languages are files, or are not run."""


@dataclass(frozen=True, slots=True)
class PageBlock:
    """A fenced block and the keys of the comment above it."""

    language: str
    text: str
    line: int
    keys: dict[str, str]

    @property
    def terminal(self) -> int:
        """Number of the terminal that executes or printed the block; 1 by default."""
        return int(self.keys.get("terminal", "1"))


def blocks_of(page: Path) -> list[PageBlock]:
    """All fenced blocks of ``page`` in their order.

    A comment holds keys, separated by ``;``: ``<!-- terminal 2; until: CLEAR -->``.
    """
    text = page.read_text("utf-8")
    blocks = []
    for found in BLOCK.finditer(text):
        indent = len(found["indent"])
        body = "".join(line[indent:] for line in found["text"].splitlines(keepends=True))
        line = text.count("\n", 0, found.start("text"))
        block = PageBlock(found["language"], body, line, _keys(found["comment"] or ""))
        unknown = set(block.keys) - KEYS.get(block.language, {"file", "not run"})
        if unknown:
            raise ValueError(f"{page.name}:{line}: keys {sorted(unknown)} of {block.language!r}")
        blocks.append(block)
    if text.count("```") != 2 * len(blocks):
        raise ValueError(f"{page.name}: not every fence was read")
    return blocks


def _keys(comment: str) -> dict[str, str]:
    keys: dict[str, str] = {}
    for part in filter(None, comment.split(";")):
        found = COMMENT_KEY.fullmatch(part.strip())
        keys.update({found[1]: found[2] or ""} if found else {part.strip(): ""})
    return keys
