"""Each kind of file is parsed in one file of ``app/files``, which every package uses."""

import ast
from functools import cache
from pathlib import Path

import pytest

APP = Path(__file__).resolve().parents[2] / "app"

PARSED_IN = {
    "yaml.load": set(),
    "yaml.safe_load": set(),
    "yaml.full_load": set(),
    "yaml.unsafe_load": set(),
    "yaml.SafeLoader": {"files/yaml_file.py"},
    "yaml.CSafeLoader": set(),
    "expat.ParserCreate": {"files/xml_guard.py"},
    "etree.XMLParser": {"files/xml_guard.py"},
    "etree.fromstring": {"files/xml_guard.py"},
    "etree.parse": set(),
    "etree.XML": set(),
    "ElementTree.parse": set(),
    "ElementTree.fromstring": set(),
    "minidom.parse": set(),
    "minidom.parseString": set(),
    "trimesh.load": set(),
    "trimesh.load_mesh": set(),
    "trimesh.load_path": set(),
    "trimesh.load_remote": set(),
    "trimesh.load_scene": {"files/mesh_file.py"},
    "tempfile.mkdtemp": set(),
    "tempfile.TemporaryFile": {"files/atomic_io.py", "report/write.py"},
    # The cache of a field is written by `app.fixture`, which imports geometry only.
    "tempfile.mkstemp": {"fixture/proximity/field_cache.py"},
}
"""The files of ``app`` that may name a parser, or a temporary file of an atomic write."""

READS_OWN_FILES = {
    "bridge/message_definitions.py": "definitions of this project's messages, as installed",
    "bridge/open_ports.py": "a table of the kernel",
    "case/messages/definition.py": "message definitions of this project",
    "cli/replay_page.py": "the report that this process wrote",
    "cli/scene_process.py": "a picture that a child process wrote",
    "fixture/jit.py": "source code of this project",
    "fixture/proximity/field_cache.py": "a cache file, whose hash is checked",
    "viewer/server.py": "the page of this project",
}
"""Files of ``app`` with an unbounded read, and what they read."""

READS_STREAMS = {"files/bounded_io.py", "files/paths.py"}
"""Files that open a file for reading bytes: the bounded read, and the hash of a whole file."""


@cache
def names(path: Path) -> set[str]:
    """Names of the form ``module.attribute`` in ``path``."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.add(f"{node.value.id}.{node.attr}")
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".")[-1]
            found.update(f"{module}.{alias.name}" for alias in node.names)
    return found


def files_that_use(name: str) -> set[str]:
    return {str(path.relative_to(APP)) for path in APP.rglob("*.py") if name in names(path)}


@pytest.mark.parametrize("name", PARSED_IN)
def test_a_parser_is_named_in_its_own_file_only(name: str) -> None:
    assert files_that_use(name) <= PARSED_IN[name]


@pytest.mark.parametrize("name", [name for name, files in PARSED_IN.items() if files])
def test_the_table_names_no_file_without_its_parser(name: str) -> None:
    assert files_that_use(name) == PARSED_IN[name]


def opens_bytes(path: Path) -> bool:
    """True if ``path`` calls ``open("rb")``."""
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            constants = [each.value for each in node.args if isinstance(each, ast.Constant)]
            if called == "open" and "rb" in constants:
                return True
    return False


def test_files_are_opened_for_bytes_by_the_bounded_read_only() -> None:
    found = {str(path.relative_to(APP)) for path in APP.rglob("*.py") if opens_bytes(path)}
    assert found == READS_STREAMS


def test_files_of_users_are_not_read_without_a_bound() -> None:
    found = {
        str(path.relative_to(APP))
        for path in APP.rglob("*.py")
        if {"read_bytes", "read_text"} & attributes(path)
    }
    assert found == set(READS_OWN_FILES)


def attributes(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(), str(path))
    return {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
