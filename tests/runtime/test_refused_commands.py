"""A command with wrong values is refused: session, content and outputs stay as they are."""

from dataclasses import replace

import pytest

from app.geometry import FrameError, InputError, MeshError, SurfaceMesh, Transform
from app.registration import given_registration
from app.runtime import ITEM_COMMANDS, ChooseDepth, LocalOperator
from tests.runtime.command_world import (
    DEPTHS,
    LARGER,
    MOUNTED,
    MOVED_BASE,
    NEEDLE,
    PREPARED,
    STYLUS,
    STYLUS_TIP,
    TOOL_EDGE,
    TUMOR_EDGE,
    LengthenNeedle,
    SetStylusTip,
    World,
)
from tests.session_content import FACES, TETRAHEDRON

NAN = float("nan")
ORIGIN = Transform.identity("pointer", "pointer_tip")
TURNED = Transform.from_rotation_vector(
    [0.01, 0.0, 0.0], TOOL_EDGE.translation_mm, target="cautery", source="cautery_tip"
)
REGISTRATION = given_registration(MOVED_BASE)


def needle(by_mm):
    return lambda commands: LocalOperator(commands, "a test").request(LengthenNeedle(by_mm))


def depth(commands):
    LocalOperator(commands, "a test").request(ChooseDepth(50.0))


def stylus(edge=STYLUS_TIP, sigma_mm=0.0):
    command = SetStylusTip(edge, sigma_mm)
    return lambda commands: LocalOperator(commands, "a test").request(command)


def tip(edge=TOOL_EDGE, sigma_mm=0.0):
    return lambda commands: commands.set_tip(edge, sigma_mm=sigma_mm, origin="a test")


def tumor(edge=TUMOR_EDGE, sigma_mm=0.0, surface=LARGER):
    return lambda commands: commands.set_tumor(edge, surface, sigma_mm=sigma_mm, origin="a test")


def surface(frame, faces=FACES):
    return tumor(surface=SurfaceMesh(frame, TETRAHEDRON, faces))


def use(registration):
    return lambda commands: commands.set_registration(registration, origin="a test")


def registration(target, source):
    return use(given_registration(Transform.identity(target, source)))


EVERYTHING = {"items": (NEEDLE, STYLUS), "image_depth": DEPTHS, "robot": MOUNTED}
LENGTH = "^needle: a length of .* mm; expected 1 to 500 mm$"
SIGMA = "^uncertainty of the {}: is {} mm; expected 0 to 10 mm"
WRONG = {
    **{f"needle of {60 + by_mm} mm": (needle(by_mm), LENGTH) for by_mm in (-60.0, 440.5, NAN)},
    "depth": (depth, "^depth of the images: 50 mm; expected one of 40, 60$"),
    "frame of the stylus tip": (
        stylus(TOOL_EDGE),
        "^stylus: the tip is cautery_from_cautery_tip; expected pointer_from_",
        FrameError,
    ),
    "stylus tip at its sensor": (
        stylus(ORIGIN),
        "^stylus: the tip is 0 mm from the sensor's origin; expected 1 mm or more",
    ),
    **{
        f"{name} sigma of {sigma_mm}": (command(sigma_mm=sigma_mm), SIGMA.format(of, sigma_mm))
        for command, name, of in (
            (stylus, "stylus", "stylus' tip"),
            (tip, "tip", "tip"),
            (tumor, "tumour", "tumour"),
        )
        for sigma_mm in (-0.1, 10.5, NAN)
    },
    "frame of the tip": (
        tip(Transform.identity("drill", "cautery_tip")),
        "expected cautery_from",
        FrameError,
    ),
    "other axis of a mounted tool": (tip(TURNED), "has another axis than the one"),
    "frame of the tumour": (
        tumor(Transform.identity("reference", "tumor")),
        "expected 'needle'",
        FrameError,
    ),
    "name of the tumour": (tumor(Transform.identity("needle", "lesion")), "tumour", FrameError),
    "open surface": (surface("tumor", FACES[:3]), "open|closed", MeshError, PREPARED),
    "frame of the surface": (surface("needle"), "needle", FrameError, PREPARED),
    "registration that is not accepted": (
        use(replace(REGISTRATION, accepted=False, reason="too few points")),
        "too few points",
    ),
    "frame of the registration": (registration("tracker", "robot_base"), "reference", FrameError),
    "base of the registration": (registration("reference", "other"), "robot_base", FrameError),
}
"""Wrong value -> command, problem, class of the error, calls of outputs that may be made."""
MISSING = {
    "needle": (needle(1.0), "^needle: the session has none; expected 'needle' in"),
    "stylus": (stylus(), "^stylus: the session has none; expected 'stylus' in"),
    "image_depth": (
        depth,
        r"^depth of the images: the session has one calibration; expected 'images\.",
    ),
    "tool": (tumor(), "expected a session with a tool mesh", InputError, PREPARED),
    "robot": (use(REGISTRATION), "the session has no robot; expected one"),
}
"""Missing part of the session -> the same."""


@pytest.mark.parametrize(
    ("content", "row"),
    [
        *(pytest.param(EVERYTHING, row, id=f"wrong {name}") for name, row in WRONG.items()),
        *(
            pytest.param({} if name in ITEM_COMMANDS else {name: None}, row, id=f"no {name}")
            for name, row in MISSING.items()
        ),
    ],
)
def test_refused_command_changes_nothing_and_switches_no_output(content, row):
    command, problem, error, calls = (*row, *(InputError, [])[len(row) - 2 :])
    world = World(**content)
    with pytest.raises(error, match=problem):
        command(world.commands)
    world.assert_unchanged()
    assert not world.commands.requests.last.accepted
    assert world.output_events in ([], calls)
