"""The recorded case of the tests of runs."""

from tests.runtime.conftest import recorded_case as recorded_case
