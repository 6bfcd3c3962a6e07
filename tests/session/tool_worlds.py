"""Random tools around the guarded one, as one session and as a session for each pair."""

from dataclasses import replace

import numpy as np
import trimesh

from app.fixture import MarginState
from app.fixture.proximity.engine import prepared_tumor
from app.geometry import NS_PER_MS, SurfaceMesh, TrackedTransform, TrackingStatus, Transform
from app.session import Session, ToolDistance
from app.session.setup import OtherTool
from tests.oracles.fixture_oracle import Oracle, random_pose
from tests.session.structure_worlds import (
    FIELD_NODES,
    TIP,
    TOOL,
    assert_same_decision,
    faulty_frames,
    first_engine,
    of_all,
    random_bodies,
    random_mesh,
    setup_of,
)

WARN_MM = 8.0


def other_tool(mesh, *, tip_mm=(0.0, 0.0, 50.0)):
    """The tool ``arm1`` of the mesh in ``arm1_tip``, at ``tip_mm`` in its sensor."""
    name = mesh.frame.removesuffix("_tip")
    engine = first_engine().with_tumor(prepared_tumor(mesh, FIELD_NODES))
    return OtherTool(name, Transform(name, mesh.frame, np.eye(3), tip_mm), engine, WARN_MM)


def box(name="arm1_tip", sides_mm=(6.0, 6.0, 6.0)):
    made = trimesh.creation.box(sides_mm)
    return SurfaceMesh(name, made.vertices, made.faces)


def with_tools(frames, rng, tools, share_of_faults=0.3):
    """Add poses of ``tools`` around the guarded one to ``frames``; some are lost, stale or gone."""
    for frame in frames:
        samples = []
        for tool in tools:
            pose = random_pose(rng, 25.0, "tracker", tool.tool_from_tip.source)
            pose = pose @ tool.tool_from_tip.inverse()
            stamp = frame.stamp
            fault = rng.choice(["lost", "gone", "stale"]) if rng.random() < share_of_faults else ""
            if fault == "lost":
                samples.append(
                    TrackedTransform.lost("tracker", tool.name, stamp, TrackingStatus.OUT_OF_VIEW)
                )
            elif fault != "gone":
                age_ns = 400 * NS_PER_MS if fault == "stale" else 0
                samples.append(TrackedTransform.valid(pose, stamp.shifted(-age_ns, stamp.clock)))
        yield replace(frame, poses=(*frame.poses, *samples))


def assert_same_distance(found: ToolDistance, alone: ToolDistance):
    assert (found.name, found.state, found.reasons) == (alone.name, alone.state, alone.reasons)
    assert (found.proximity is None) == (alone.proximity is None)
    if found.proximity is not None:
        np.testing.assert_array_equal(
            found.proximity.witnesses.rows, alone.proximity.witnesses.rows
        )


def compare_with_single_pairs(rng, structures, count, frames):
    """Decisions are those without other tools, distances those of each alone and of libigl.

    Returns the number of known and of unknown distances.
    """
    bodies = random_bodies(rng, structures)
    meshes = [random_mesh(rng, f"arm{number}_tip") for number in range(count)]
    tools = [other_tool(mesh) for mesh in meshes]
    names = tuple(tool.name for tool in tools)
    setup = replace(setup_of(bodies), other_tools=tuple(tools), shown_frames=names)
    together = Session(setup, free_motion=True)
    without = Session(setup_of(bodies), free_motion=True)
    pairs = [Session(replace(setup_of(bodies), other_tools=(other_tool(mesh),))) for mesh in meshes]
    oracles = [Oracle.of(mesh, TOOL) for mesh in meshes]
    found = [0, 0]
    steps = with_tools(faulty_frames(rng, frames, jumping=("cautery",)), rng, tools)
    for frame in steps:
        step = together.step(frame)
        own = tuple(each for each in frame.poses if each.source not in names)
        expected = without.step(replace(frame, poses=own))
        assert_same_decision(step.decision, expected.decision)
        for one, other in zip(of_all(step), of_all(expected), strict=True):
            assert_same_decision(one, other)
        assert step.hold_causes == expected.hold_causes
        for number, each in enumerate(step.tools):
            (alone,) = pairs[number].step(frame).tools
            assert_same_distance(each, alone)
            found[each.proximity is None] += 1
            if each.proximity is None:
                assert each.state is MarginState.UNKNOWN
                continue
            used = filter(None, step.edges.measured.values())
            latest = {sample.source: sample.transform for sample in used}
            tip_from_tip = (
                (latest[each.name] @ tools[number].tool_from_tip).inverse()
                @ latest["cautery"]
                @ TIP
            )
            if not oracles[number].tool_contains_tumor(tip_from_tip):
                true_mm = oracles[number].signed_distance_mm(tip_from_tip)
                # The engine's accuracy, and that of the oracle.
                tolerance_mm = 0.005 + 0.002 * abs(true_mm) + 0.04
                assert abs(each.proximity.signed_distance_mm - true_mm) <= tolerance_mm
            is_near = each.proximity.lower_bound_mm <= WARN_MM
            assert each.state is (MarginState.WARNING if is_near else MarginState.NEGATIVE)
    return found
