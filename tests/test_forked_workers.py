"""Tests in forked workers run once, and none is lost without a word."""

from textwrap import dedent

import pytest

from tests.python_process import run_python

pytestmark = pytest.mark.slow

CONFTEST = """
    from tests.forked_workers import ForkedWorkers

    def pytest_collection_modifyitems(config, items):
        config.pluginmanager.register(ForkedWorkers(2, [3, len(items) - 3]))
"""
FIRST = """
    import warnings

    def test_first(tmp_path):
        warnings.warn("seen")

    def test_wrong():
        print("printed")
        assert 1 == 2

    def test_last():
        pass
"""


SECOND = """
    import os

    def test_other():
        pass

    def test_dies():
        os._exit(0)

    def test_never():
        pass
"""


def test_reports_come_back_and_a_worker_that_dies_fails_the_run(tmp_path, project_root):
    for name, text in (("conftest", CONFTEST), ("test_first", FIRST), ("test_second", SECOND)):
        (tmp_path / f"{name}.py").write_text(dedent(text))
    command = ["-m", "pytest", "-c", "/dev/null", f"--rootdir={tmp_path}", "-p", "no:cacheprovider"]
    done = run_python(
        *command, "--junitxml", tmp_path / "results.xml", tmp_path, status=1, cwd=project_root
    )
    assert "1 failed, 3 passed, 1 warning" in done.stdout
    assert "UserWarning: seen" in done.stdout
    assert "printed" in done.stdout
    assert "worker ended with status 0 in test_second.py::test_dies" in done.stdout
    results = (tmp_path / "results.xml").read_text()
    for name in ("test_first", "test_wrong", "test_last", "test_other"):
        assert results.count(f' name="{name}"') == 1
