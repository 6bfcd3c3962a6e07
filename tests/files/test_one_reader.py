"""Each kind of file is parsed in one file of ``app/files``, which every package uses."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

APP = Path(__file__).resolve().parents[2] / "app"

PARSED_IN = {
    "yaml.load": set(),
    "yaml.safe_load": set(),
    "yaml.full_load": set(),
    "yaml.unsafe_load": set(),
    "yaml.SafeLoader": set(),
    "cyaml.CParser": {"files/yaml_file.py"},
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
    # The log of a live node is written by another process.
    "tempfile.mkstemp": {"bridge/displays/live_child.py", "fixture/proximity/field_cache.py"},
}
"""The files of ``app`` that may name a parser, or a temporary file of an atomic write."""

READS_OWN_FILES = {
    "bridge/session_bag.py": "definitions of messages, as installed",
    "bridge/message_definitions.py": "definitions of this project's messages, as installed",
    "bridge/environment.py": "a loaded library, and a table of the kernel",
    "case/messages/message_values.py": "message definitions of this project",
    "cli/cohort_run.py": "a table of the kernel",
    "cli/replay_page.py": "the report that this process wrote",
    "cli/scene_process.py": "a picture that a child process wrote",
    "scene/pictures/movie.py": "the video that this process wrote",
    "fixture/jit.py": "source code of this project",
    "fixture/proximity/field_cache.py": "a cache file, whose hash is checked",
    "cohort/dataset.py": "the journal and the partitions of an earlier run",
    "files/child_process.py": "a table of the kernel",
    "report/page.py": "scripts and styles of this project",
    "simulation/rigid_body.py": "a cache file, whose hash is checked",
    "viewer/downloads.py": "a tip or surface that this process wrote",
    "hold/record.py": "the name of this machine",
    "viewer/server.py": "the page of this project",
}
"""Files of ``app`` with an unbounded read, and what they read."""

OPENING = ("open", "fopen", "fdopen", "fromfile", "loadtxt", "genfromtxt", "memmap", "ZipFile")
OPENING = (*OPENING, "TarFile", "mmap")
LOADERS = ("np.load", "numpy.load", "nrrd.read", "nrrd.read_header", "sqlite3.connect")
NOT_FILES = {
    "self._zip.open": "a member of an archive that the bounded read opened",
    "files.open": "a reader of MRML scenes, which uses the bounded read",
    "webbrowser.open": "a page",
    "self._dataset.open": "the results of a cohort, listed below",
    "mmap.mmap": "memory",
}
"""Calls of these names that open no file of a user, and what they open."""

OPENS_FILES = {
    "bridge/displays/live_child.py": {"self.log.open", "os.fdopen"},  # the log of its process
    "files/bounded_io.py": {"os.open", "os.fdopen"},
    # Members of an open file, and an open file's header.
    "case/readers/mrml/mrml_scene.py": {"zipfile.ZipFile", "self._files.open"},
    "case/tumor/nrrd_file.py": {"nrrd.read_header"},
    # An archive that a page has received under a limit, and its members under another.
    "files/zip_folder.py": {"archive.open", "zipfile.ZipFile", "opened.open", "target.open"},
    # Writers.
    "viewer/library_server.py": {"archive.open"},
    "case/conversion.py": {"path.open"},
    "case/bag_writer.py": {"os.open"},
    "cohort/dataset.py": {"self._journal.open"},
    "files/atomic_io.py": {"os.open", "os.fdopen"},
    "files/json_file.py": {"os.open", "self.path.open"},
    "case/frames_recorder.py": {"self._partial.open"},
    "fixture/proximity/field_cache.py": {"os.fdopen"},
    "scene/scene_file.py": {"zipfile.ZipFile"},
    # Bytes of a picture, from the bounded read.
    "cli/library_page.py": {"Image.open"},
    # Bytes that were read from the cache and whose hash was checked.
    "simulation/rigid_body.py": {"np.load"},
    # A database, which SQLite opens by name after it was found to be a regular file.
    "case/readers/rosbag2/bag.py": {"sqlite3.connect"},
    # The lock of an instance, which this program made.
    "hold/on_disk.py": {"os.open"},
    # A source file, locked while its functions are compiled.
    "fixture/jit.py": {"os.open"},
    # The lock of a cohort's results.
    "cli/cohort_run.py": {"(folder / LOCK_FILE).open"},
    # A video in a temporary folder of its own.
    "scene/pictures/movie.py": {"av.open"},
    # Pipes between processes, and the folder of own caches.
    "files/child_process.py": {"os.fdopen"},
    "cli/caches.py": {"os.open"},
    # The null device, for buffered output after its pipe was closed.
    "cli/main.py": {"os.open"},
}
"""Files of ``app`` that open files otherwise than by the bounded read."""


@cache
def tree(path: Path) -> tuple[ast.AST, ...]:
    """Attributes, calls and imports of names in ``path``."""
    kinds = ast.Attribute | ast.Call | ast.ImportFrom
    return tuple(
        n for n in ast.walk(ast.parse(path.read_text(), str(path))) if isinstance(n, kinds)
    )


@cache
def names(path: Path) -> set[str]:
    """Names of the form ``module.attribute`` in ``path``."""
    found = set()
    for node in tree(path):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.add(f"{node.value.id}.{node.attr}")
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".")[-1]
            found.update(f"{module}.{alias.name}" for alias in node.names)
    return found


@cache
def texts() -> dict[Path, str]:
    """All files of ``app``. A file is parsed only if its text has the names that are searched."""
    return {path: path.read_text() for path in APP.rglob("*.py")}


def files_that_use(name: str) -> set[str]:
    parts = name.split(".")
    return {
        str(path.relative_to(APP))
        for path, text in texts().items()
        if all(part in text for part in parts) and name in names(path)
    }


@pytest.mark.parametrize("name", PARSED_IN)
def test_a_parser_is_named_in_its_own_file_only(name):
    assert files_that_use(name) == PARSED_IN[name]


def opening_calls(path: Path) -> set[str]:
    """Calls in ``path`` that open a file by its name, as ``open`` or ``module.open``."""
    found = set()
    for node in tree(path):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            last = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            if last in OPENING or last in {name.split(".")[-1] for name in LOADERS}:
                found.add(ast.unparse(node.func))
    known = {name for name in found if name.split(".")[-1] in OPENING or name in LOADERS}
    return known - NOT_FILES.keys()


def test_only_the_bounded_read_opens_files():
    words = "|".join((*OPENING, *(name.split(".")[-1] for name in LOADERS)))
    found = {
        str(path.relative_to(APP)): opening_calls(path)
        for path, text in texts().items()
        if re.search(rf"\b({words})\s*\(", text)
    }
    assert {path: calls for path, calls in found.items() if calls} == OPENS_FILES


def test_an_opening_call_is_found(tmp_path):
    path = tmp_path / "module.py"
    path.write_text("open('a')\nPath('a').open('rb')\nnumpy.load(path)\nio.open(name)\n")
    expected = {"open", "Path('a').open", "numpy.load", "io.open"}
    assert opening_calls(path) == expected


def test_files_of_users_are_not_read_without_a_bound():
    found = {
        str(path.relative_to(APP))
        for path, text in texts().items()
        if re.search("read_(bytes|text)", text) and {"read_bytes", "read_text"} & attributes(path)
    }
    assert found == set(READS_OWN_FILES)


def attributes(path: Path) -> set[str]:
    return {node.attr for node in tree(path) if isinstance(node, ast.Attribute)}
