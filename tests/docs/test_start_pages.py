"""The pages for new users work: every block is executed from the text of the page."""

import pytest

from tests.docs.page_run import PageRun
from tests.ros_domain import environment_of, reserved_domain

# Longer than the waits of a page, which fail with the line of their block.
pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

NOT_RUN: dict[str, list[str]] = {
    "start_controller.md": [],
    "start_live.md": [],
    "start_review.md": [],
}
"""Page -> reasons of the blocks that are not executed, in their order."""


@pytest.mark.parametrize("page", NOT_RUN)
def test_every_block_of_the_page_works(page, project_root, tmp_path):
    with reserved_domain() as domain:
        run = PageRun(project_root, tmp_path, environment_of(domain))
        run.run(project_root / "docs" / page)
    assert run.not_run == NOT_RUN[page]


def test_all_pages_for_new_users_are_executed(project_root):
    assert {path.name for path in (project_root / "docs").glob("start_*.md")} == set(NOT_RUN)
