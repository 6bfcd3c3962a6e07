"""Checks of the shipped files, in the checkout and with files that are missing."""

import shutil
from pathlib import Path

import pytest

from app.cli import shipped_checks


@pytest.fixture
def share(project_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as ``app/share`` of a wheel, with the files that are checked."""
    for paths in shipped_checks.SHIPPED.values():
        for path in paths:
            (tmp_path / path.parent).mkdir(parents=True, exist_ok=True)
            shutil.copy(project_root / path, tmp_path / path)
    monkeypatch.setattr("app.files.shipped._SHARE", tmp_path)
    return tmp_path


def failed() -> dict[str, str]:
    """Checks that found something missing, without that of the installed wheel."""
    checks = shipped_checks.check_shipped()
    return {c.name: c.found for c in checks if not c.ok and c.name != "installed files"}


def test_everything_is_in_the_checkout() -> None:
    assert failed() == {}


def test_page_is_checked_completely(project_root: Path) -> None:
    web = project_root / "app" / "viewer" / "web"
    assert set(shipped_checks.PAGE) == {path.name for path in web.iterdir()}


def test_complete_wheel_has_no_missing_files(share: Path) -> None:
    assert failed() == {}


@pytest.mark.parametrize("empty", [False, True])
@pytest.mark.parametrize(
    ("name", "path"), [(n, p) for n, paths in shipped_checks.SHIPPED.items() for p in paths]
)
def test_missing_or_empty_file_is_named(share: Path, name: str, path: Path, empty: bool) -> None:
    (share / path).unlink()
    if empty:
        (share / path).touch()
    assert failed() == {name: f"not found: {share / path}"}


def test_remedy_names_pip_in_a_wheel_only(share: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.rmtree(share)
    monkeypatch.setattr("app.files.shipped._SHARE", share)
    share.mkdir()
    remedy = shipped_checks.check_shipped()[0].remedy
    assert "pip install --force-reinstall --no-deps WHEEL_FILE" in remedy
    assert "docs/installation.md" in remedy
    share.rmdir()
    monkeypatch.setattr(shipped_checks, "PAGE", ("no.html",))
    (page,) = [c for c in shipped_checks.check_shipped() if c.name == "page"]
    assert "git status" in page.remedy
