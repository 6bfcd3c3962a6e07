"""The warm-up step shows every kind of object that a picture contains."""

import pytest

from app.fixture import MarginState


def test_tumour_tool_line_and_plane_are_shown() -> None:
    pytest.importorskip("slicer")
    from app.cli.render_warmup import warmup_step
    from app.scene import StepScene

    scene = StepScene(*warmup_step()).scene
    margin = scene.margin
    assert margin is not None
    assert margin.state is MarginState.NEGATIVE
    shown = (scene.tumor, scene.tool, margin.line, margin.plane.node)
    assert all(node.GetDisplayNode().GetVisibility() for node in shown)
    assert margin.plane.node.GetCenterWorld() == pytest.approx((0.0, 0.0, 0.0))
