"""How long one evaluation takes: ours beside FCL's and coal's distance, on the same poses.

    python -m benchmarks.fixture [--tumors 82000] [--tools 2000] [--poses 2000] [--json FILE]

Every engine is given the same wandering trajectory (1 kHz, within 10 mm) in one run. FCL and coal
know no inside: they are compared where the tool is outside.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import coal
import fcl
import numpy as np

from app.fixture import ProximityEngine
from app.geometry import SurfaceMesh, Transform
from benchmarks.fixture_shapes import cautery, lobed_tumor
from benchmarks.fixture_trajectory import wander

Measure = Callable[[Transform], float]


def ours(tumor: SurfaceMesh, tool: SurfaceMesh) -> Measure:
    engine = ProximityEngine(tumor, tool)
    return lambda pose: engine.evaluate(pose).signed_distance_mm


def fcl_distance(tumor: SurfaceMesh, tool: SurfaceMesh) -> Measure:
    def moving(mesh: SurfaceMesh) -> fcl.CollisionObject:
        model = fcl.BVHModel()
        model.beginModel(len(mesh.vertices_mm), len(mesh.faces))
        model.addSubModel(np.array(mesh.vertices_mm), np.array(mesh.faces))
        model.endModel()
        return fcl.CollisionObject(model, fcl.Transform())

    first, second, request = moving(tumor), moving(tool), fcl.DistanceRequest()

    def measure(pose: Transform) -> float:
        second.setTransform(fcl.Transform(pose.rotation, pose.translation_mm))
        return float(fcl.distance(first, second, request, fcl.DistanceResult()))

    return measure


def coal_distance(tumor: SurfaceMesh, tool: SurfaceMesh) -> Measure:
    def model(mesh: SurfaceMesh) -> coal.BVHModelOBBRSS:
        made = coal.BVHModelOBBRSS()
        made.beginModel(len(mesh.faces), len(mesh.vertices_mm))
        made.addVertices(np.array(mesh.vertices_mm))
        made.addTriangles(np.array(mesh.faces, dtype=np.int64))
        made.endModel()
        return made

    first, second, still = model(tumor), model(tool), coal.Transform3s()
    request, result = coal.DistanceRequest(), coal.DistanceResult()

    def measure(pose: Transform) -> float:
        result.clear()
        moved = coal.Transform3s(np.array(pose.rotation), np.array(pose.translation_mm))
        return float(coal.distance(first, still, second, moved, request, result))

    return measure


ENGINES = {"marginguard": ours, "fcl distance": fcl_distance, "coal distance": coal_distance}


def rows(tumor: SurfaceMesh, tool: SurfaceMesh, poses: int) -> list[dict[str, object]]:
    """One row an engine; agreement is with the first, outside the tumour."""
    trajectory = wander(tumor, tool, poses)
    found, reference = [], np.empty(0)
    for name, build in ENGINES.items():
        begin = time.perf_counter()
        measure = build(tumor, tool)
        build_s = time.perf_counter() - begin
        took, distance = np.empty(poses), np.empty(poses)
        for k, pose in enumerate(trajectory):
            # The time that this thread computes: what else the machine does is not counted.
            start = time.thread_time_ns()
            distance[k] = measure(pose)
            took[k] = (time.thread_time_ns() - start) / 1e6
        reference = reference if len(reference) else distance
        outside = reference > 0.0
        p50, p99, most = np.percentile(took, [50, 99, 100])
        found.append(
            {
                "tumor": len(tumor.faces), "tool": len(tool.faces), "engine": name,
                "p50_ms": float(p50), "p99_ms": float(p99), "max_ms": float(most),
                "build_s": build_s, "poses": poses, "inside": int((~outside).sum()),
                "differs_mm": float(np.abs(distance - reference)[outside].max()),
            }
        )  # fmt: skip
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tumors", type=int, nargs="+", default=[82_000 - 80])
    parser.add_argument("--tools", type=int, nargs="+", default=[2000])
    parser.add_argument("--poses", type=int, default=2000)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table = []
    print("  tumour   tool  engine          p50 ms   p99 ms   max ms  build s  differs mm")
    for tumor_size in options.tumors:
        for tool_size in options.tools:
            for row in rows(lobed_tumor(tumor_size), cautery(tool_size), options.poses):
                table.append(row)
                print(
                    f"{row['tumor']:>8} {row['tool']:>6}  {row['engine']:<14}"
                    f"{row['p50_ms']:>8.3f} {row['p99_ms']:>8.3f} {row['max_ms']:>8.3f}"
                    f" {row['build_s']:>8.1f} {row['differs_mm']:>11.4f}",
                    flush=True,
                )
    if options.json is not None:
        options.json.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
