"""Files about the project that other tools read: citation, pre-commit, container."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import app
from tests.python_process import run_python


@pytest.fixture(scope="module")
def project(project_root: Path) -> dict[str, Any]:
    return tomllib.loads((project_root / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def citation(project_root: Path) -> dict[str, Any]:
    return yaml.safe_load((project_root / "CITATION.cff").read_text())


def test_citation_has_the_required_keys_of_cff(citation):
    """Required by the schema of CFF 1.2.0: these four keys, and of an entity a name."""
    assert citation["cff-version"] == "1.2.0"
    assert all(citation[key] for key in ("message", "title", "authors"))
    assert citation["type"] in ("software", "dataset")
    assert [set(author) for author in citation["authors"]] == [{"name"}]  # no persons
    assert len(set(citation["keywords"])) == len(citation["keywords"])


def test_citation_equals_the_metadata(citation, project):
    assert citation["version"] == app.__version__
    assert citation["license"] == project["license"]
    assert citation["repository-code"] == project["urls"]["Repository"]
    assert citation["authors"] == project["authors"]


def test_pre_commit_accepts_its_configuration(project_root):
    path = project_root / ".pre-commit-config.yaml"
    run_python("-m", "pre_commit", "validate-config", path)
    assert [repo["repo"] for repo in yaml.safe_load(path.read_text())["repos"]] == ["local"]


def test_dockerfile_copies_files_that_exist(project_root):
    text = (project_root / "Dockerfile").read_text().replace("\\\n", " ")
    copied = [line.split()[1:-1] for line in text.splitlines() if line.startswith("COPY ")]
    sources = [source for names in copied if not names[0].startswith("--from=") for source in names]
    assert sources
    assert [source for source in sources if not (project_root / source).exists()] == []
    # A source that .dockerignore leaves out would be missing in the build.
    ignored = (project_root / ".dockerignore").read_text().split()
    assert not {source.rstrip("/") for source in sources} & set(ignored)


def test_dockerfile_stages_are_defined_before_use(project_root):
    text = (project_root / "Dockerfile").read_text()
    stages = re.findall(r"^FROM \S+ AS (\w+)$", text, re.MULTILINE)
    assert len(stages) == len(re.findall(r"^FROM ", text, re.MULTILINE)) == 2
    assert set(re.findall(r"--from=(\w+)", text)) == {stages[0]}
    assert re.search(r"^USER (?!root)\w+$", text, re.MULTILINE)
    assert text.rstrip().splitlines()[-2].startswith("ENTRYPOINT ")


def test_source_distribution_has_the_files_that_tests_read(project_root):
    manifest = [line.split() for line in (project_root / "MANIFEST.in").read_text().splitlines()]
    included = {name for words in manifest if words[:1] != ["#"] for name in words[1:]}
    included |= {"LICENSE", "MANIFEST.in", "README.md", "pyproject.toml"}  # of setuptools itself
    sources = [path.read_text() for path in (project_root / "tests").rglob("*.py")]
    named = {
        name for text in sources for name in re.findall(r'(?i:root) / "([^"/]+)(?:/[^"]*)?"', text)
    }
    read = {name for name in named if (project_root / name).exists()}
    assert {"CITATION.cff", "Dockerfile", "examples"} <= read
    assert read - included - {".git"} == set()


def test_pages_clone_from_the_address_of_the_metadata(project_root, project):
    pages = [project_root / "README.md", *(project_root / "docs").glob("*.md")]
    cloned = {url for page in pages for url in re.findall(r"git clone (\S+)", page.read_text())}
    assert cloned <= {project["urls"]["Repository"]}
