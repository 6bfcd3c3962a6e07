"""Error messages of a failed installation."""

import pytest

from tools import install


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        (
            "ERROR: Could not find a version that satisfies the requirement uv==1\n"
            "ERROR: No matching distribution found for uv==1\n",
            "no wheel of uv==1 for Python",
        ),
        (
            "error: No solution found when resolving dependencies\n"
            "  cause: Because there is no version of numpy==99 and you require numpy==99, "
            "we can conclude that your requirements are unsatisfiable.\n",
            "no wheel of numpy==99 for Python",
        ),
        (
            "error: No solution found when resolving dependencies\n"
            "  cause: Because no-such-wheel was not found in the package registry and "
            "marginguard[ros] depends on no-such-wheel, we can conclude ...\n",
            "no wheel of no-such-wheel for Python",
        ),
        (
            "error: Failed to build `marginguard-interfaces @ file:///interfaces`\n"
            "  cause: The build backend returned an error\n"
            "         error: g++ was not found: install a C and a C++ compiler\n",
            "g++ not found: install a C and a C++ compiler",
        ),
        ("a.c:1:10: fatal error: Python.h: No such file\nERROR: Failed", "apt install python3-dev"),
        ("a.c:1:10: fatal error: rmw/types.h: No such file\nERROR: Failed", "rmw/types.h"),
        ("error: failed to write: No space left on device (os error 28)\n", "the disk is full"),
        (
            "WARNING: Retrying after connection broken by 'NewConnectionError(...)'\n"
            "ERROR: No matching distribution found for uv==1\n",
            "the package index could not be reached",
        ),
        (
            "error: Request failed after 3 retries in 5.3s\n"
            "  cause: Failed to fetch: https://index.example/simple/thing/\n"
            "  cause: error sending request for url (https://index.example/simple/thing/)\n",
            "the package index could not be reached",
        ),
        ("error: Something failed\n  cause: Something new\n", "Something new"),
        ("ERROR: Something new\n", "Something new"),
        ("", "the installation failed"),
    ],
)
def test_output_is_explained_in_one_sentence(output, expected):
    sentence = install.explain(output)
    assert expected in sentence
    assert "\n" not in sentence


def test_settings_of_pip_are_those_of_uv():
    lines = (
        "global.extra-index-url='https://one.example/simple\\nhttps://two.example/simple'",
        "global.index-url='https://first.example/simple'",
        "install.find-links='/wheels'",
        "global.timeout='60'",
        ":env:.index-url='https://own.example/simple'",
    )
    assert install.settings("\n".join(lines)) == {
        "UV_INDEX": "https://one.example/simple https://two.example/simple",
        "UV_DEFAULT_INDEX": "https://own.example/simple",
        "UV_FIND_LINKS": "/wheels",
    }
