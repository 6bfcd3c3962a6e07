"""The C++ rule of a controller: compiled without warnings, compared with Python and an oracle."""

import pytest

from tests.examples.cpp_rule import check_random_lives

pytestmark = pytest.mark.slow


def test_cpp_rule_decides_as_the_python_rule_and_keeps_every_plane(cpp_driver):
    check_random_lives(cpp_driver, controllers=15)
