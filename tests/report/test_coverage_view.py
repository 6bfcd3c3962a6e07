"""The turnable coverage: its data against the coverage by brute force, its mesh, its colours."""

import base64
import itertools
import json
import re

import numpy as np
import pytest
from markupsafe import Markup
from scipy.spatial import cKDTree

from app.analysis.coverage import WITHIN_MM, Coverage, spread_faces
from app.geometry import ANATOMICAL_AXES, SurfaceMesh
from app.report.coverage_figures import (
    FARTHER,
    MAX_FACES,
    MAX_VERTICES,
    CoveredSurface,
    coverage_document,
    coverage_figure,
    covered_surface,
)
from app.report.page import AMBIENT, CLASS_NAMES, COLORS
from app.synthetic.tumour_and_tool import icosphere
from tests.fixture.control.test_state_display import each_vision, seen_ratio

pytestmark = pytest.mark.slow

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def unpacked(document):
    """Vertices in mm (n, 3), faces (m, 3) and distances in mm (m,) of the data of a page."""
    raw = {key: base64.b64decode(document[key]) for key in ("vertices", "faces", "nearest")}
    vertices = np.frombuffer(raw["vertices"], "<i2").reshape(-1, 3) * document["vertex_mm"]
    steps = np.frombuffer(raw["nearest"], "<u2")
    nearest = np.where(steps == document["farther"], np.inf, steps * document["nearest_mm"])
    return vertices, np.frombuffer(raw["faces"], "<u2").reshape(-1, 3), nearest


def bumpy(subdivisions):
    """A closed surface without symmetries, about 12 mm in radius, away from the origin."""
    units, faces = icosphere(subdivisions)
    x, y, z = units.T
    radius = 12.0 + 2.0 * np.sin(3.0 * x + y) + 1.5 * np.cos(2.0 * z - x)
    return SurfaceMesh("tumor", radius[:, None] * units + [30.0, -8.0, 5.0], faces)


def coverage_by_height(tumor):
    """Distances from 0 mm at one end to 14 mm at the other, of spread faces; infinite above 10."""
    faces = spread_faces(tumor.triangles_mm.mean(axis=1), 1500)
    centres = tumor.triangles_mm[faces].mean(axis=1)
    heights = centres @ [0.6, 0.0, 0.8]
    nearest = 14.0 * (heights - heights.min()) / np.ptp(heights)
    nearest[nearest > 10.0] = np.inf
    return Coverage(faces, centres, nearest, np.ones(len(faces)), 9)


@pytest.mark.parametrize("subdivisions", [3, 5], ids=["1280 faces", "20480 faces"])
def test_data_of_the_page_are_the_distances_of_the_coverage(subdivisions):
    tumor = bumpy(subdivisions)
    coverage = coverage_by_height(tumor)
    surface = covered_surface(tumor, coverage, [], TURN)
    vertices, faces, nearest = unpacked(json.loads(json.dumps(coverage_document(surface))))
    assert len(faces) == len(nearest) <= MAX_FACES
    in_file = vertices @ TURN + tumor.centroid_mm
    centres = tumor.triangles_mm[coverage.faces].mean(axis=1)
    apart = np.linalg.norm(in_file[faces].mean(axis=1)[:, None] - centres[None], axis=2)
    matched = np.zeros(len(faces), dtype=bool)
    for column in range(3):  # the nearest by brute force; rounding can change it between equals
        chosen = np.argsort(apart, axis=1)[:, column]
        near = apart[np.arange(len(faces)), chosen] <= apart.min(axis=1) + 2e-3
        found = coverage.nearest_mm[chosen]
        finite = np.isfinite(found) & np.isfinite(nearest)
        up = np.where(finite, nearest, 0.0) - np.where(finite, found, 0.0)
        same_class = np.searchsorted(WITHIN_MM, nearest) == np.searchsorted(WITHIN_MM, found)
        matched |= (
            near & (finite | (found == nearest)) & (up >= -1e-9) & (up <= 1e-3 + 1e-9) & same_class
        )
    assert matched.all()
    assert np.isinf(nearest).any() and (np.searchsorted(WITHIN_MM, nearest) == 0).any()
    if len(tumor.faces) <= MAX_FACES:  # each face has its own value
        np.testing.assert_allclose(apart.min(axis=1), 0.0, atol=2e-3)


def test_fewer_faces_are_a_closed_surface_near_the_tumour():
    tumor = bumpy(5)
    surface = covered_surface(tumor, coverage_by_height(tumor))
    directed = np.concatenate([surface.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    edges = {tuple(edge) for edge in directed.tolist()}
    assert len(edges) == len(directed) and {(b, a) for a, b in edges} == edges
    volume = np.linalg.det(surface.corners_mm).sum() / 6.0
    assert volume == pytest.approx(np.linalg.det(tumor.triangles_mm).sum() / 6.0, rel=0.02)
    around = surface.vertices_mm + tumor.centroid_mm
    assert cKDTree(tumor.vertices_mm).query(around)[0].max() < 0.4
    longest = np.linalg.norm(np.diff(surface.corners_mm[:, [0, 1, 2, 0]], axis=1), axis=2).max()
    assert longest < 5.0


def test_view_begins_where_the_tool_came_nearest_and_breaches_are_at_their_places():
    tumor = bumpy(3)
    coverage = coverage_by_height(tumor)
    place = tumor.centroid_mm - np.array([0.0, 11.0, 0.0])
    unknown = (np.nan, 0.0, 0.0)
    document = coverage_document(covered_surface(tumor, coverage, [place, unknown, place]))
    assert [each["number"] for each in document["breaches"]] == ["1", "3"]
    breach = document["breaches"][0]
    np.testing.assert_allclose(breach["place"], [0.0, -11.0, 0.0], atol=1e-3)
    assert (abs(breach["azimuth"]), breach["elevation"]) == (180.0, 0.0)  # from posterior
    azimuth, elevation = np.radians([document["start"][key] for key in ("azimuth", "elevation")])
    seen = [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation)]
    nearest = tumor.triangles_mm[coverage.faces[coverage.nearest_mm.argmin()]].mean(axis=0)
    direction = nearest - tumor.centroid_mm
    direction /= np.linalg.norm(direction)
    np.testing.assert_allclose([*seen, np.sin(elevation)], direction, atol=2e-3)
    for side in document["sides"]:
        np.testing.assert_array_equal(side["axis"], ANATOMICAL_AXES[side["letter"]])
    angles = {side["letter"]: (side["azimuth"], side["elevation"]) for side in document["sides"]}
    assert (angles["R"], angles["A"]) == ((90.0, 0.0), (0.0, 0.0))
    assert (angles["S"], angles["I"]) == ((180.0, 90.0), (0.0, -90.0))  # anterior is up


def test_tumour_that_the_tool_never_came_near_is_all_farther():
    tumor = bumpy(2)
    faces = np.arange(len(tumor.faces))
    centres = tumor.triangles_mm.mean(axis=1)
    coverage = Coverage(faces, centres, np.full(len(faces), np.inf), np.ones(len(faces)), 0)
    document = coverage_document(covered_surface(tumor, coverage))
    assert set(np.frombuffer(base64.b64decode(document["nearest"]), "<u2").tolist()) == {FARTHER}


def test_figure_has_the_views_and_names_all_classes():
    tumor = bumpy(3)
    figure = coverage_figure(
        covered_surface(tumor, coverage_by_height(tumor)), Markup("<b>views</b>")
    )
    assert re.search(r'<div class="static"[^>]*><b>views</b></div>', figure)
    legend = re.search(r'(?s)<ul class="legend">(.*?)</ul>', figure).group(1)
    assert re.findall(r'<rect [^>]*fill="(#\w+)"', legend) == list(COLORS)
    assert re.findall(r"</svg>([^<]+)</li>", legend) == [*CLASS_NAMES, "place of a breach"]
    (data,) = re.findall(r"<script type=.application/json.>(.*?)</script>", figure)
    assert "<" not in data and len(figure) < 60_000


def test_surface_with_too_many_vertices_is_shown_by_its_views_alone():
    vertices = np.zeros((MAX_VERTICES + 1, 3))
    surface = CoveredSurface(vertices, np.zeros((1, 3), int), np.zeros(1), np.zeros((0, 3)))
    figure = coverage_figure(surface, Markup("<b>x</b>"))
    assert figure.startswith('<div class="figure" ') and "><b>x</b></div>" in figure
    assert "canvas" not in figure


@each_vision
def test_classes_differ_in_luminance_in_any_light(vision):
    def rgb(color, light=1.0):
        return tuple(int(color[k : k + 2], 16) * light / 255.0 for k in (1, 3, 5))

    for nearer, farther in itertools.pairwise(COLORS):
        assert seen_ratio(rgb(nearer), rgb(farther), vision) >= 1.5
        # The farther class at the edge of the picture against the nearer one in full light.
        assert seen_ratio(rgb(nearer), rgb(farther, AMBIENT), vision) >= 1.25
        black = (0.0, 0.0, 0.0)
        assert seen_ratio(rgb(nearer), black, vision) < seen_ratio(
            rgb(farther, AMBIENT), black, vision
        )
