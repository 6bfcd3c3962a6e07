"""Sentences that name what to install for a missing module."""

import pytest

from app.files import extras
from app.geometry import InputError


@pytest.fixture(params=["checkout", "wheel"])
def installed_as(request, tmp_path, monkeypatch):
    if request.param == "wheel":
        monkeypatch.setattr("app.files.paths._SHARE", tmp_path)
    return request.param


@pytest.mark.parametrize(
    ("module", "extra"),
    [
        ("rclpy", "ros"),
        ("std_msgs.msg", "ros"),
        ("slicer", "scene"),
        ("vtkmodules.vtkCommonCore", "scene"),
        ("trame_server", "scene"),
    ],
)
def test_missing_module_of_an_extra_names_its_command(installed_as, module, extra):
    hint = extras.install_hint(ModuleNotFoundError(name=module))
    command = {
        "checkout": f"`pip install -c constraints.txt -e '.[{extra}]'`",
        "wheel": f"`pip install 'marginguard[{extra}]'`",
    }
    assert command[installed_as] in hint
    assert ("interfaces" in hint) is (extra == "ros")


def test_missing_messages_of_this_project_need_no_extra(installed_as):
    hint = extras.install_hint(ModuleNotFoundError(name="marginguard_msgs.msg"))
    assert "[ros]" not in hint
    what = {"checkout": "./interfaces", "wheel": "the wheel of marginguard-interfaces"}
    assert what[installed_as] in hint


@pytest.mark.parametrize(
    "error",
    [
        ModuleNotFoundError(name="app.nothing"),
        ImportError("libGL.so.1: cannot open shared object file", name="vtkmodules.vtkRendering"),
        ImportError("no name"),
    ],
)
def test_another_import_error_refers_to_doctor(error):
    assert "'marginguard doctor'" in extras.install_hint(error)


def test_module_that_does_not_exist_is_an_error():
    extras.check_installed("json", "numpy")
    with pytest.raises(InputError, match=r"^trame_none is not installed: .*\[scene\]'`, or wait$"):
        extras.check_installed("json", "trame_none", otherwise="wait")
