"""README and docs name only what exists: links, files, commands, options, Python names."""

import argparse
import ast
import importlib
import re
import shlex
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

import marginguard
from app.case import open_case
from app.cli.commands.bench import BENCHMARKS
from app.cli.main import build_parser
from app.cli.parsing import CommandParser
from app.fixture import MarginState
from app.session import Session, setup_from_case

pytestmark = pytest.mark.slow

LINK = re.compile(r"\]\((?!https?://)([^)#\s]*)(?:#([^)\s]+))?\)")
"""A link within the project: path, anchor."""
PAGE_MENTION = re.compile(r"(?<!\[)`[^`\n*]*\w\.md`")
HEADING = re.compile(r"^#+ +(.+?) *$", re.MULTILINE)
FILE = re.compile(r"(?<![\w./~-])[\w.-]+/[\w./-]*\w")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`([^`\n]+)`")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
TASK = re.compile(r"^\| (\d+)\. ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)
"""A row of the contributing guide: number, task, file, tests."""
CALL = re.compile(r"^marginguard +([^#|;&`'\n]+)", re.MULTILINE)
SLICER_OPTIONS = {"--no-splash", "--additional-module-paths"}
INSTALLER_OPTIONS = {"--outdir", "--rm", "--network"}  # of build and docker
EXAMPLE_OPTIONS = {"--accept-simulated", "--controller"}  # of twist_filter.py, guard_bond.py
TOOL_OPTIONS = {"--record", "--tier"}  # of tools.durations and the tests
DASK_OPTIONS = {"--nthreads", "--name"}  # of dask-worker
ROS_OPTIONS = {"--ros-args", "--enclave", "--cmake-args"}  # of ROS programs and colcon
OTHER_OPTIONS = (
    SLICER_OPTIONS | INSTALLER_OPTIONS | EXAMPLE_OPTIONS | ROS_OPTIONS | DASK_OPTIONS | TOOL_OPTIONS
)
PARSER = build_parser()
NOT_A_COMMAND = "marginguard tip"
"""Name of an engine in a table of a benchmark."""


@pytest.fixture(scope="module")
def pages(project_root: Path) -> dict[str, str]:
    """Text of each page by its path in the project."""
    found = [
        *project_root.glob("*.md"),
        *project_root.glob("docs/*.md"),
        *project_root.glob("examples/*.md"),
        *project_root.glob("slicer_module/*.md"),
        *project_root.glob("data/*/*.md"),
    ]
    return {str(path.relative_to(project_root)): path.read_text("utf-8") for path in found}


def test_targets_of_all_links_exist(project_root, pages):
    broken = [
        f"{page}: {target}"
        for page, text in pages.items()
        for target, _ in LINK.findall(text)
        if not ((project_root / page).parent / target).exists()
    ]
    assert broken == []


def test_anchors_of_all_links_exist(project_root, pages):
    broken = [
        f"{page}: {target}#{anchor}"
        for page, text in pages.items()
        for target, anchor in LINK.findall(text)
        if anchor and anchor not in _anchors((project_root / page).parent / target, text, target)
    ]
    assert broken == []


def test_every_mentioned_page_is_a_link(pages):
    bare = [
        f"{page}: {mention}"
        for page, text in pages.items()
        for mention in PAGE_MENTION.findall(BLOCK.sub("", text))
    ]
    assert bare == []


def test_all_named_files_exist(project_root, pages):
    """Check names that begin with a folder of the project, except ``out`` (written by commands)."""
    folders = {path.name for path in project_root.iterdir() if path.is_dir()} - {"out"}
    roots = (project_root, project_root / "examples" / "cpp_controller" / "include")
    missing = [
        f"{page}: {name}"
        for page, text in pages.items()
        for name in FILE.findall(text)
        if name.partition("/")[0] in folders and not any((root / name).exists() for root in roots)
    ]
    assert missing == []


def test_index_links_every_page(pages):
    docs = {Path(page).name for page in pages if page.startswith("docs/")} - {"index.md"}
    assert docs - {target for target, _ in LINK.findall(pages["docs/index.md"])} == set()


def test_api_reference_has_every_stable_name(pages):
    names = re.findall(r"^\.\. auto\w+:: (\w+)$", pages["docs/api_reference.md"], re.MULTILINE)
    assert sorted(names) == sorted(set(marginguard.__all__) - {"__version__"})


def test_readme_is_short(pages):
    assert len(pages["README.md"].splitlines()) <= 150


def test_each_task_of_the_contributing_guide_names_a_file_and_tests_that_exist(project_root, pages):
    tasks = TASK.findall(pages["docs/contributing_guide.md"])
    assert len(tasks) > 15
    assert [int(number) for number, *_ in tasks] == list(range(1, 1 + len(tasks)))
    for _, task, file_cell, tests_cell in tasks:
        (changed,), (tests,) = CODE.findall(file_cell), CODE.findall(tests_cell)
        path = project_root / changed
        assert path.is_dir() if file_cell.startswith("a new file in") else path.is_file(), task
        assert (project_root / tests).is_file(), task
        assert tests.startswith("tests/"), task


def test_commands_and_their_options_exist(project_root, pages):
    """Check calls in code blocks and in inline code."""
    wrong = [
        f"{page}: {' '.join(call)}: {problem}"
        for page, text in pages.items()
        for call in _calls(text)
        if (problem := _problem_of(call, project_root))
    ]
    assert wrong == []


def test_all_named_options_exist(project_root, pages):
    known = {option for parser in _parsers(PARSER) for option in _options(parser)}
    known |= {option for name in BENCHMARKS for option in _benchmark_options(name, project_root)}
    named = {
        (page, option)
        for page, text in pages.items()
        for option in OPTION.findall(text)
        if option not in known | OTHER_OPTIONS
    }
    assert named == set()


def test_imports_in_python_examples_work(project_root, pages):
    missing = []
    for page, text in pages.items():
        for language, code in BLOCK.findall(text):
            if language == "python":
                missing += [f"{page}: {name}" for name in _missing_imports(code)]
    assert missing == []


def test_minimal_case_of_the_docs_has_a_known_margin(project_root, pages, tmp_path):
    first_block = dict(reversed(BLOCK.findall(pages["docs/case_format.md"])))
    (tmp_path / "case.yaml").write_text(first_block["yaml"], encoding="utf-8")
    for name in ("tracking.mcap", "cautery.stl", "tumor.stl"):
        shutil.copy(project_root / "data/recorded_case" / name, tmp_path)
    case = open_case(tmp_path)
    step = Session(setup_from_case(case)).step(next(case.frames()))
    assert step.decision.state is not MarginState.UNKNOWN


def _anchors(path: Path, page: str, target: str) -> set[str]:
    """Anchors of the headings of a file, or of ``page`` itself, as the web view forms them."""
    text = path.read_text("utf-8") if target else page
    titles = [re.sub(r"[^\w\- ]", "", title.lower()) for title in HEADING.findall(text)]
    return {title.replace(" ", "-") for title in titles}


def _calls(text: str) -> Iterator[list[str]]:
    """Arguments of each call of ``marginguard`` in a page."""
    blocks = [code for language, code in BLOCK.findall(text) if language == "sh"]
    for code in (*blocks, *CODE.findall(BLOCK.sub("", text))):
        for call in CALL.findall(code if code != NOT_A_COMMAND else ""):
            yield shlex.split(call)


def _problem_of(arguments: list[str], root: Path) -> str:
    """Error in the arguments of a call; empty if there is none."""
    parser = PARSER
    options = OPTION.findall(" ".join(arguments).partition(" -- ")[0])
    if arguments[0] == "bench" and len(arguments) > 1 and arguments[1] in BENCHMARKS:
        known = _benchmark_options(arguments[1], root)
    else:
        while arguments and (chosen := _subparsers(parser).get(arguments[0])) is not None:
            parser, arguments = chosen, arguments[1:]
        if parser.prog == "marginguard" and not arguments[0].startswith("--"):
            return f"no command {arguments[0]}"
        known = _options(parser)
    unknown = [option for option in options if option not in known]
    return f"no options {unknown}" if unknown else ""


def _subparsers(parser: CommandParser) -> Mapping[str, CommandParser]:
    for action in (*parser._actions, parser.subcommands):
        if isinstance(action, argparse._SubParsersAction):
            return action.choices
    return {}


def _parsers(parser: CommandParser) -> Iterator[CommandParser]:
    yield parser
    for chosen in _subparsers(parser).values():
        yield from _parsers(chosen)


def _options(parser: argparse.ArgumentParser) -> set[str]:
    return {option for action in parser._actions for option in action.option_strings}


def _benchmark_options(name: str, root: Path) -> set[str]:
    """Options in the source text of a benchmark: its peers may not be installed."""
    path = root / "benchmarks" / name.replace("-", "_")
    source = path / "__main__.py" if path.is_dir() else path.with_suffix(".py")
    shared = root / "benchmarks/harness/options.py"
    return {"--help", *OPTION.findall(source.read_text("utf-8") + shared.read_text("utf-8"))}


def _missing_imports(code: str) -> Iterator[str]:
    for statement in ast.walk(ast.parse(code)):
        if isinstance(statement, ast.ImportFrom) and (statement.module or "").startswith("app"):
            module = importlib.import_module(statement.module or "")
            for name in statement.names:
                if not hasattr(module, name.name):
                    yield f"{statement.module}.{name.name}"
