"""50,000 malformed inputs of each parser; a finding is stored as a file.

``MARGINGUARD_FUZZ_INPUTS`` is another number of inputs, ``MARGINGUARD_FUZZ_SEED`` another seed. The
file of a finding that is mended goes to ``regressions``, into the folder of its parser.
"""

import os

import pytest

from tests.fuzz.parsers import PARSERS
from tests.fuzz.worker import Fuzzer

pytestmark = [pytest.mark.exhaustive, pytest.mark.timeout(0)]

INPUTS = int(os.environ.get("MARGINGUARD_FUZZ_INPUTS", "50000"))
SEED = int(os.environ.get("MARGINGUARD_FUZZ_SEED", "1"))
MAX_FINDINGS = 10


@pytest.mark.parametrize("name", sorted(PARSERS))
def test_malformed_inputs_have_a_value_or_a_typed_error(name, tmp_path):
    findings = []
    with Fuzzer("tests.fuzz.parsers") as fuzzer:
        for number in range(INPUTS):
            data = PARSERS[name].input(SEED, number)
            outcome = fuzzer.run(name, data)
            if outcome.is_finding and len(findings) < MAX_FINDINGS:
                path = tmp_path / f"{outcome.kind}-{number}"
                path.write_bytes(data)
                findings.append((path, outcome))
    assert findings == []
