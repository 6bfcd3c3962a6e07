"""Landmark detection and registration on a real stylus recording."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from app.geometry import Transform
from app.registration import detect_landmarks, register_points
from benchmarks.registration.figures import Figure

ROOT = Path(__file__).resolve().parents[2]


def recording(_: int) -> Iterator[Figure]:
    """Yield match and errors against the published registration."""
    folder = ROOT.parent / "shared" / "data" / "plus"
    if not folder.is_dir():
        yield Figure("recording", "eight landmarks", "recording not available", "", "", None)
        return
    from lxml import etree

    from tests.registration.plus_recording import numbers, recorded_tips

    samples, landmarks = recorded_tips(folder)
    expected = etree.parse(folder / "PhantomRegistrationLandmarkDetection.results.xml")
    entry = expected.find(".//Transform[@From='Phantom']")
    published = Transform.from_matrix(
        numbers(entry.get("Matrix")), target="reference", source="phantom"
    )
    begin = time.perf_counter()
    detected = detect_landmarks(samples, landmarks)
    pairs = detected.match.pairs
    result = register_points(
        [detected.dwells[dwell].position_mm for dwell, _ in pairs],
        [landmarks[name] for _, name in pairs],
        fixed_frame="reference",
        moving_frame="phantom",
    )
    elapsed_s = time.perf_counter() - begin
    yield Figure(
        "recording",
        "landmarks detected and matched, order unknown",
        f"{len(pairs)} of {len(landmarks)} in {1e3 * elapsed_s:.0f} ms",
        "8 of 8",
        "PLUS requires the order",
        len(pairs) == 8,
    )
    distance = result.transform.distance_mm_to(published)
    angle = float(np.degrees(result.transform.angle_to(published)))
    yield Figure(
        "recording",
        "PhantomToReference, difference to the published one",
        f"{distance:.3f} mm, {angle:.3f} degrees",
        "0.10 mm, 0.30 degrees",
        "",
        distance <= 0.10 and angle <= 0.30,
    )
    mean = float(result.residuals_mm.mean())
    yield Figure(
        "recording",
        "mean residual",
        f"{mean:.3f} mm",
        "0.21 mm",
        f"PLUS {float(entry.get('Error')):.3f} mm",
        mean <= 0.21,
    )
