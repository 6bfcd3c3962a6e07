"""Error messages of a failed installation."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """`tools/install.py`, loaded from its file, with its log in a temporary folder."""
    spec = importlib.util.spec_from_file_location("install", ROOT / "tools" / "install.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "LOG", tmp_path / "install.log")
    return module


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        (
            "ERROR: Could not find a version that satisfies the requirement thing==1\n"
            "ERROR: No matching distribution found for thing==1\n",
            "no wheel of thing==1 for Python",
        ),
        (
            "ERROR: Cannot install marginguard because these have conflicting dependencies.\n"
            "    marginguard 0.1.0 depends on thing\n"
            "    The user requested (constraint) thing==99\n",
            "no wheel of thing==99 for Python",
        ),
        (
            "      error: g++ was not found: install a C and a C++ compiler\n"
            "ERROR: Failed building wheel for marginguard-interfaces\n",
            "g++ not found: install a C and a C++ compiler",
        ),
        ("a.c:1:10: fatal error: Python.h: No such file\nERROR: Failed", "apt install python3-dev"),
        ("a.c:1:10: fatal error: rmw/types.h: No such file\nERROR: Failed", "rmw/types.h"),
        ("ERROR: [Errno 28] No space left on device\n", "the disk is full"),
        (
            "WARNING: Retrying after connection broken by 'NewConnectionError(...)'\n"
            "ERROR: No matching distribution found for thing==1\n",
            "the package index could not be reached",
        ),
        ("ERROR: Something new\n", "Something new"),
        ("", "pip failed"),
    ],
)
def test_output_of_pip_is_explained_in_one_sentence(
    install: ModuleType, output: str, expected: str
) -> None:
    sentence = install.explain(output)
    assert expected in sentence
    assert "\n" not in sentence


def test_missing_wheel_is_reported_in_one_line_and_logged_in_full(
    install: ModuleType, capfd: pytest.CaptureFixture[str]
) -> None:
    status = install.main(["--no-index", "no-such-wheel==1.2.3"])
    error = capfd.readouterr().err
    assert status != 0
    assert error.startswith("marginguard: no wheel of no-such-wheel==1.2.3")
    assert error.count("\n") == 1
    assert "ERROR" in install.LOG.read_text()
