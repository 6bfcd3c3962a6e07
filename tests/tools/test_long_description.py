"""The description of the package has absolute links."""

from email import message_from_string

import pytest
from setuptools import build_meta

from tools.long_description import LINK, absolute_links

REPOSITORY = "https://example.org/owner/name"


@pytest.mark.parametrize(
    ("text", "absolute"),
    [
        ("[live](docs/live.md#time)", f"[live]({REPOSITORY}/blob/main/docs/live.md#time)"),
        ("![scene](docs/scene.png)", f"![scene]({REPOSITORY}/raw/main/docs/scene.png)"),
        ("[here](#start)", "[here](#start)"),
        ("[ROS](https://docs.ros.org)", "[ROS](https://docs.ros.org)"),
        ("[mail](mailto:a@example.org)", "[mail](mailto:a@example.org)"),
        ("a[0](1 of 2)", "a[0](1 of 2)"),
    ],
)
def test_relative_links_become_absolute(text, absolute):
    assert absolute_links(text, REPOSITORY) == absolute


def test_metadata_of_the_wheel_have_no_relative_link(project_root, tmp_path, monkeypatch):
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        (tmp_path / name).write_bytes((project_root / name).read_bytes())
    (tmp_path / "app").symlink_to(project_root / "app")
    (tmp_path / "tools").symlink_to(project_root / "tools")
    (tmp_path / "wheel").mkdir()
    monkeypatch.chdir(tmp_path)
    folder = build_meta.prepare_metadata_for_build_wheel(str(tmp_path / "wheel"))
    metadata = message_from_string((tmp_path / "wheel" / folder / "METADATA").read_text("utf-8"))
    description = metadata.get_payload()
    assert "/blob/main/docs/" in description
    assert LINK.search(description) is None
