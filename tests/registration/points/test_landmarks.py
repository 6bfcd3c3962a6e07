"""Matching of dwells to landmarks, simulated and on a real recording."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from app.geometry import FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import (
    CollinearPointsError,
    NoValidSamplesError,
    ShapeError,
    TooFewError,
    detect_dwells,
    detect_landmarks,
    match_landmarks,
    register_points,
)
from tests.registration.helpers import random_transform
from tests.registration.plus_recording import numbers, recorded_tips, shipped_tips

NAMES = ("A", "B", "C", "D", "E", "F", "G", "H")


def scalene(rng: np.random.Generator, count: int) -> dict[str, FloatArray]:
    """Random landmarks by name whose mutual distances all differ by 1.2 mm or more."""
    while True:
        points = rng.uniform(-90.0, 90.0, (count, 3))
        distances = np.linalg.norm(points[:, None] - points[None], axis=2)
        gaps = np.sort(distances[np.triu_indices(count, 1)])
        if gaps[0] > 15.0 and np.diff(gaps).min() > 1.2:
            return dict(zip(NAMES, points, strict=False))


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(4, 6))
def test_dwells_in_any_order_are_matched(seed, count):
    rng = np.random.default_rng(seed)
    landmarks = scalene(rng, count)
    order = rng.permutation(count)
    pose = random_transform(rng)
    dwells = pose.apply(np.stack(list(landmarks.values())))[order]
    dwells += rng.normal(scale=0.05, size=dwells.shape)
    match = match_landmarks(dwells, landmarks, tolerance_mm=0.4)
    assert match.accepted, match.reason
    assert match.pairs == tuple((index, NAMES[place]) for index, place in enumerate(order))
    assert match.unmatched_dwells == () and match.missing == ()


def test_false_dwells_and_missing_landmarks_are_reported():
    rng = np.random.default_rng(1)
    landmarks = scalene(rng, 6)
    pose = random_transform(rng)
    dwells = pose.apply(np.stack([landmarks[name] for name in "FBDA"]))
    elsewhere = dwells.mean(axis=0) + np.array([37.0, -12.0, 5.0])
    dwells = np.insert(dwells, 2, elsewhere, axis=0)
    match = match_landmarks(dwells, landmarks, tolerance_mm=0.5)
    assert match.accepted, match.reason
    assert match.pairs == ((0, "F"), (1, "B"), (3, "D"), (4, "A"))
    assert match.unmatched_dwells == (2,) and match.missing == ("C", "E")


def test_symmetric_phantom_is_ambiguous():
    corners = {"A": (0, 0, 0), "B": (90, 0, 0), "C": (90, 60, 0), "D": (0, 60, 0)}
    match = match_landmarks(list(corners.values()), corners, tolerance_mm=1.0)
    assert not match.accepted and match.pairs == ()
    assert re.search(r"[24] assignments of 4 dwells .*0=A 1=B 2=C 3=D", match.reason)


def test_mirror_image_does_not_match():
    rng = np.random.default_rng(2)
    landmarks = scalene(rng, 6)
    mirrored = np.stack(list(landmarks.values())) * [1.0, 1.0, -1.0]
    match = match_landmarks(mirrored, landmarks, tolerance_mm=1.0)
    assert len(match.pairs) < 6


def test_dwells_on_another_object_do_not_match():
    rng = np.random.default_rng(3)
    landmarks = scalene(rng, 6)
    match = match_landmarks(rng.uniform(-90, 90, (8, 3)), landmarks, tolerance_mm=0.5)
    assert not match.accepted and "fit on landmarks within" in match.reason


def test_match_of_a_minority_of_dwells_is_not_accepted():
    rng = np.random.default_rng(4)
    landmarks = scalene(rng, 4)
    on_landmarks = random_transform(rng).apply(np.stack(list(landmarks.values())))
    elsewhere = on_landmarks.mean(axis=0) + rng.uniform(-20.0, 20.0, (5, 3))
    dwells = np.vstack([on_landmarks, elsewhere])
    assert match_landmarks(dwells[:8], landmarks, tolerance_mm=0.5).accepted
    match = match_landmarks(dwells, landmarks, tolerance_mm=0.5)
    assert not match.accepted and match.pairs == ()
    assert match.reason.startswith("4 of 9 dwells fit on landmarks")


def test_invalid_points_raise_specific_errors():
    landmarks = scalene(np.random.default_rng(4), 5)
    line = np.outer([1, 2, 3, 4.5], [10, 20, 30])
    for error, message, dwells, known, tolerance_mm in (
        (TooFewError, "2 dwells", np.eye(3)[:2], landmarks, 1.0),
        (TooFewError, "0 landmarks", np.eye(3), {}, 1.0),
        (CollinearPointsError, "dwells", line, landmarks, 1.0),
        (ShapeError, "tolerance_mm", np.eye(3), landmarks, 0.0),
    ):
        with pytest.raises(error, match=message):
            match_landmarks(dwells, known, tolerance_mm=tolerance_mm)
    invalid = TrackingStatus.INVALID
    lost = [TrackedTransform.lost("reference", "tip", Stamp(i), invalid) for i in range(3)]
    with pytest.raises(NoValidSamplesError, match="3 INVALID"):
        detect_landmarks(lost, landmarks)


def test_real_recording_of_eight_landmarks_agrees_with_the_published_registration(shared_data):
    """The order of the dwells is not an input."""
    folder = shared_data / "plus"
    samples, landmarks = recorded_tips(folder)
    result = detect_landmarks(samples, landmarks)
    assert result.match.accepted, result.match.reason
    assert len(result.dwells) == 8
    assert [name for _, name in result.match.pairs] == list(landmarks)

    registration = register_points(
        [result.dwells[dwell].position_mm for dwell, _ in result.match.pairs],
        [landmarks[name] for _, name in result.match.pairs],
        fixed_frame="reference",
        moving_frame="phantom",
    )
    expected = etree.parse(folder / "PhantomRegistrationLandmarkDetection.results.xml")
    published = Transform.from_matrix(
        numbers(expected.find(".//Transform[@From='Phantom']").get("Matrix")),
        target="reference",
        source="phantom",
    )
    assert registration.accepted, registration.reason
    assert registration.transform.distance_mm_to(published) < 0.10
    assert np.degrees(registration.transform.angle_to(published)) < 0.30
    assert registration.residuals_mm.mean() < 0.21


def swapped(samples: list[TrackedTransform]) -> list[TrackedTransform]:
    """The second half before the first, with samples of 1 s in a dwell that are INVALID."""
    half, offset = 500, samples[-1].stamp.ns + 10**9 - samples[0].stamp.ns
    later = [
        TrackedTransform(s.transform, s.stamp.shifted(offset, s.stamp.clock), s.status)
        for s in samples[:half]
    ]
    mixed = samples[half:] + later
    mixed[100:115] = [
        TrackedTransform.lost(s.target, s.source, s.stamp, TrackingStatus.INVALID)
        for s in mixed[100:115]
    ]
    return mixed


def assert_swapped_order_is_found(samples, landmarks):
    result = detect_landmarks(swapped(samples), landmarks)
    assert result.match.accepted, result.match.reason
    names = [name for _, name in result.match.pairs]
    assert names == ["#5", "#6", "#7", "#8", "#1", "#2", "#3", "#4"]


def test_shipped_recording_has_eight_dwells_also_in_another_order(project_root):
    """The case has one of the landmarks of the phantom: the centre of its sphere."""
    samples, landmark = shipped_tips(project_root / "data" / "phantom_case")
    dwells = np.stack([dwell.position_mm for dwell in detect_dwells(samples)])
    assert len(dwells) == 8
    assert np.sort(np.linalg.norm(dwells - landmark, axis=1))[0] < 0.7
    pose = random_transform(np.random.default_rng(7))
    landmarks = {f"#{n}": pose.apply(at) for n, at in enumerate(dwells, start=1)}
    assert_swapped_order_is_found(samples, landmarks)


def test_real_recording_is_matched_in_another_order_with_lost_samples(shared_data):
    """The halves are swapped, and samples of 1 s in a dwell are INVALID."""
    samples, landmarks = recorded_tips(shared_data / "plus")
    assert_swapped_order_is_found(samples, landmarks)
