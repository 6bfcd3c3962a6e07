"""Expansion of xacro files, and refusal of files outside their packages."""

import os

import pytest

from app.robot import UrdfError, load_robot, robot_from_text, urdf_text, xacro_child
from app.robot.urdf import expand_xacro

pytestmark = pytest.mark.slow

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def start_fork(request):
    """Answer a request as the program `xacro_child` does, in a fork of this process."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        try:
            with os.fdopen(writing, "wb") as output:
                output.write(xacro_child.answer(request))
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        reply = pipe.read()
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), reply


@pytest.fixture(autouse=True)
def quick_start(request, monkeypatch):
    """Start no interpreter, except in the tests of what it prints."""
    if "capfd" not in request.fixturenames:
        monkeypatch.setitem(expand_xacro.__kwdefaults__, "ask", start_fork)


@pytest.fixture
def write(tmp_path):
    def write(name, body):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{HEAD}{body}</robot>" if name.endswith("xacro") else body)
        return path

    return write


CHAIN = """
<xacro:arg name="length" default="0.5"/>
<xacro:include filename="parts/part.xacro"/>
<link name="l0"/>
<xacro:part n="1"/><xacro:part n="2"/>
"""
PART = """
<xacro:macro name="part" params="n">
  <link name="l${n}"/>
  <joint name="j${n}" type="fixed"><parent link="l${n - 1}"/><child link="l${n}"/>
    <origin xyz="0 0 ${2 * $(arg length)}"/></joint>
</xacro:macro>
"""


@pytest.mark.parametrize(("arguments", "height_mm"), [({}, 2000.0), ({"length": "0.1"}, 400.0)])
def test_macros_includes_and_arguments_are_expanded(write, arguments, height_mm):
    path = write("arm.urdf.xacro", CHAIN)
    write("parts/part.xacro", PART)
    robot = load_robot(path, xacro_args=arguments)
    assert robot.forward_kinematics({})["l2"].translation_mm[2] == pytest.approx(height_mm)


def test_find_resolves_to_the_folder_of_the_package(write, tmp_path):
    path = write("robots/arm.xacro", '<xacro:include filename="$(find far)/a.xacro"/>')
    write("packages/far/a.xacro", '<link name="found"/>')
    robot = load_robot(path, package_dirs=[tmp_path / "packages"])
    assert robot.root_link == "found"
    with pytest.raises(UrdfError, match=r"\$\(find far\): package not found"):
        load_robot(path)


def test_optional_include_may_be_missing(write):
    body = '<link name="l"/><xacro:include filename="none.xacro" optional="true"/>'
    assert load_robot(write("a.xacro", body)).root_link == "l"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<xacro:include filename="../secret.xacro"/>', "secret.xacro is outside the allowed"),
        ('<xacro:include filename="/etc/hostname"/>', "/etc/hostname is outside the allowed"),
        ("<link name=\"${xacro.load_yaml('/etc/hostname')}\"/>", "outside the allowed"),
        ('<xacro:include filename="link.xacro"/>', "link.xacro is outside the allowed"),
        ('<xacro:include filename="missing.xacro"/>', "No such file"),
        ("<link name=\"${open('/etc/hostname')}\"/>", "cannot be expanded"),
        ('<link name="${1 / 0}"/>', "cannot be expanded.*division"),
        ("<xacro:unknown_macro/>", "cannot be expanded.*unknown"),
        ('<link name="$(arg nothing)"/>', "cannot be expanded.*nothing"),
    ],
)
def test_forbidden_or_failing_expansion_is_refused(write, tmp_path, body, message):
    write("secret.xacro", '<link name="secret"/>')
    path = write("inside/a.xacro", body)
    (path.parent / "link.xacro").symlink_to(tmp_path / "secret.xacro")
    with pytest.raises(UrdfError, match=message) as refused:
        load_robot(path)
    assert "\n" not in str(refused.value)


def test_entities_are_refused_in_included_files(write, tmp_path):
    path = write("a.xacro", '<xacro:include filename="bomb.xacro"/>')
    (tmp_path / "bomb.xacro").write_text('<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>')
    with pytest.raises(UrdfError, match="document type"):
        load_robot(path)


def test_xacro_module_is_restored_after_an_error(write):
    import xacro
    import xacro.substitution_args

    find = xacro.substitution_args._eval_find
    with pytest.raises(UrdfError):
        load_robot(write("a.xacro", "<xacro:x/>"))
    assert xacro.substitution_args._eval_find is find
    assert not hasattr(xacro, "open")


def test_arguments_for_a_urdf_are_refused(write_urdf):
    with pytest.raises(UrdfError, match=r"has xacro arguments \(a\); expected a \.xacro file"):
        load_robot(write_urdf('<link name="a"/>'), xacro_args={"a": "1"})


def test_argument_that_no_file_declares_is_refused_by_name(write):
    path = write("arm.urdf.xacro", CHAIN)
    write("parts/part.xacro", PART)
    message = "no xacro argument 'lenght'; expected length; did you mean 'length'"
    with pytest.raises(UrdfError, match=message):
        load_robot(path, xacro_args={"lenght": "0.1"})
    with pytest.raises(UrdfError, match=r"no xacro argument 'dof', 'wrist'; expected none$"):
        load_robot(write("b.xacro", '<link name="l"/>'), xacro_args={"dof": "6", "wrist": "a"})


def test_failed_expansion_names_the_argument_that_it_needs(write):
    """Universal Robots' description is like this: no default name, a default type without files."""
    path = write(
        "arm.xacro",
        '<xacro:arg name="ur_type" default="none"/>'
        "<link name=\"${xacro.load_yaml('$(arg ur_type).yaml')['name']}$(arg side)\"/>",
    )
    write("ur5e.yaml", "name: base")
    given = {"ur_type": "ur5e", "side": "_left"}
    assert load_robot(path, xacro_args=given).root_link == "base_left"
    with pytest.raises(UrdfError, match="argument side; expected it in xacro_args, as side: VALUE"):
        load_robot(path, xacro_args={"ur_type": "ur5e"})
    with pytest.raises(UrdfError, match=r"none\.yaml.*'ur_typ' was not read.*'ur_type'"):
        load_robot(path, xacro_args={"ur_typ": "ur5e", "side": "_left"})


@pytest.mark.parametrize("name", ["$(arg first)", "${xacro.arg('first')}"])
def test_argument_that_is_read_but_not_declared_is_accepted(write, name):
    path = write("a.xacro", f'<link name="{name}"/>')
    assert load_robot(path, xacro_args={"first": "l"}).root_link == "l"


def test_commented_declaration_does_not_count(write):
    path = write("a.xacro", '<!-- <xacro:arg name="old" default="1"/> --><link name="l"/>')
    with pytest.raises(UrdfError, match="no xacro argument 'old'"):
        load_robot(path, xacro_args={"old": "2"})


def test_messages_name_the_line_of_the_expanded_text_and_no_python_class(write):
    joint = '<joint name="j" type="planar"><parent link="a"/><child link="b"/></joint>'
    path = write("a.xacro", f'<link name="a"/>\n<link name="b"/>\n{joint}')
    text = urdf_text(path).splitlines()
    line = 1 + next(n for n, each in enumerate(text) if '"planar"' in each)
    assert line > 5
    message = f"expanded by xacro: joint 'j' in line {line} has the type"
    with pytest.raises(UrdfError, match=message):
        load_robot(path)
    with pytest.raises(UrdfError, match=r"cannot be expanded: \$\(find pkg\) accepts") as refused:
        load_robot(write("b.xacro", '<link name="$(find )"/>'))
    assert "<class" not in str(refused.value)


def test_text_from_the_network_is_not_expanded():
    with pytest.raises(UrdfError, match="xacro element"):
        robot_from_text(f'{HEAD}<link name="a"/><xacro:arg name="x"/></robot>')


def test_urdf_text_is_the_expanded_text(write, touch_urdf, tmp_path):
    path = write("a.xacro", '<xacro:property name="n" value="link"/><link name="${n}"/>')
    assert robot_from_text(urdf_text(path)).root_link == "link"
    assert urdf_text(touch_urdf) == touch_urdf.read_text()
    assert urdf_text(tmp_path / "model.yaml") is None


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("<link name=\"${'a' * 10**10}\"/>", "needs more than 512 MiB"),
        ('<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', "recursion"),
        ('<xacro:include filename="a.xacro"/>', "recursion"),
    ],
)
def test_expansion_without_end_is_refused_in_one_line(write, body, message, capfd):
    with pytest.raises(UrdfError, match=message) as caught:
        load_robot(write("a.xacro", body))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_expansion_that_computes_without_end_is_refused(write, monkeypatch):
    monkeypatch.setattr("app.robot.urdf.MAX_CPU_S", 0.25)
    with pytest.raises(UrdfError, match=r"takes more than 0\.25 s of processor time; expand"):
        load_robot(write("a.xacro", '<link name="a${10**10**8}"/>'))


def test_warning_of_xacro_is_not_printed(write, capfd):
    load_robot(write("a.xacro", '<xacro:property name="a" value="1" xyz="2"/><link name="l"/>'))
    assert capfd.readouterr() == ("", "")
