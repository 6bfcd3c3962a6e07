"""The C++ rule of a controller decides as the Python rule in longer loops and more lives."""

import pytest

from tests.examples.cpp_rule import check_closed_loops, check_random_lives
from tests.fixture.control.closed_loops import TUMORS

pytestmark = pytest.mark.exhaustive


@pytest.mark.parametrize("tumor_kind", TUMORS)
def test_cpp_rule_decides_as_the_python_rule_in_closed_loops(cpp_driver, tumor_kind, project_root):
    check_closed_loops(cpp_driver, tumor_kind, project_root, steps=200)


def test_cpp_rule_decides_as_the_python_rule_and_keeps_every_plane(cpp_driver):
    check_random_lives(cpp_driver, controllers=300)
