"""Checks of the shipped files, in the checkout and with files that are missing."""

import shutil

import pytest

from app.cli import installation_checks

SHIPPED = [(name, path) for name, paths in installation_checks.SHIPPED.items() for path in paths]


@pytest.fixture(scope="module")
def copied(project_root, tmp_path_factory):
    """A folder as ``app/share`` of a wheel, with the files that are checked."""
    folder = tmp_path_factory.mktemp("share")
    for _, path in SHIPPED:
        (folder / path.parent).mkdir(parents=True, exist_ok=True)
        shutil.copy(project_root / path, folder / path)
    return folder


@pytest.fixture
def share(copied, monkeypatch):
    monkeypatch.setattr("app.files.paths._SHARE", copied)
    return copied


def failed():
    """Checks that found something missing, without that of the installed wheel."""
    checks = installation_checks.check_shipped()
    return {c.name: c.found for c in checks if not c.ok and c.name != "installed files"}


def test_everything_is_in_the_checkout():
    assert failed() == {}


def test_page_is_checked_completely(project_root):
    web = project_root / "app" / "viewer" / "web"
    assert set(installation_checks.PAGE) == {path.name for path in web.iterdir()}


def test_complete_wheel_has_no_missing_files(share):
    assert failed() == {}


@pytest.mark.parametrize(("name", "path"), SHIPPED)
def test_missing_or_empty_file_is_named(share, name, path):
    content = (share / path).read_bytes()
    try:
        for change in ((share / path).unlink, (share / path).touch):
            change()
            assert failed() == {name: f"not found: {share / path}"}
    finally:
        (share / path).write_bytes(content)


def test_remedy_names_pip_in_a_wheel_only(tmp_path, monkeypatch):
    monkeypatch.setattr("app.files.paths._SHARE", tmp_path)
    remedy = installation_checks.check_shipped()[0].remedy
    assert "pip install --force-reinstall --no-deps WHEEL_FILE" in remedy
    assert "docs/installation.md" in remedy
    monkeypatch.setattr("app.files.paths._SHARE", tmp_path / "none")
    monkeypatch.setattr(installation_checks, "PAGE", ("no.html",))
    (page,) = [c for c in installation_checks.check_shipped() if c.name == "page"]
    assert "git status" in page.remedy
