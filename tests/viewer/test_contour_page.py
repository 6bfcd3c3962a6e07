"""Contouring on the page: clicks on phantom images become a tumour; two pages at the same time."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from app.case import open_case
from app.files.meshes import load_mesh
from app.fixture.surfaces.bvh import indexed_bvh
from app.fixture.surfaces.winding_number import dipoles_of, winding_numbers
from app.geometry import weld_vertices
from tests.contour.phantom import clicks_on, dice, is_inside, slice_of, tumor_from_image, tumour
from tests.contour.phantom_case import CLICKED, offset_mm, write_phantom_case
from tests.page_rules import violations
from tests.viewer.conftest import watching
from tests.viewer.page_actions import (
    answer,
    choose,
    click_at,
    confirm,
    download,
    drag,
    read,
    resize,
    show_frame,
    wait_for,
)

pytestmark = pytest.mark.long

TO_SCREEN = """([column, row]) => {
  const svg = document.querySelector("#us-image");
  const { x, y } = new DOMPoint(column + 0.5, row + 0.5).matrixTransform(svg.getScreenCTM());
  return [x, y];
}"""

VIEW_REFUSED = {
    "contour_add": ["v", 20, 1, 1],
    "contour_tip": ["v", "cautery"],
    "contour_move": ["v", 9, 1, 1, 1],
    "contour_erase": ["v", 9, 20, 1, 1, 5],
    "contour_undo": ["v", 9],
    "contour_delete_all": ["v", 9],
    "contour_dilation": ["v", 9, 1],
    "contour_calibration": ["v", 9, 1],
    "contour_hydromark": ["v", 9, 1],
}


@pytest.fixture(scope="module")
def server(serve, tmp_path_factory):
    return serve(str(write_phantom_case(tmp_path_factory.mktemp("phantom") / "case")))


@pytest.fixture
def page(page):
    """The page with image 20, on which a click adds a point; afterwards there are none."""
    choose(page, "prepare", "contour")
    show_image(page, 20)
    page.click("#contour-add")
    yield page
    if page.evaluate("trame.state.get('contour').count") != "no points":
        confirm(page, "contour-clear")
    expect(page.locator("#contour-count")).to_have_text("no points")
    for button in ("#contour-add", "#contour-erase"):
        if page.locator(button).get_attribute("aria-pressed") == "true":
            page.click(button)


def show_image(page, frame):
    show_frame(page, frame)
    expect(page.locator("#ultrasound > div")).to_have_attribute("data-image", str(frame))


def place(page, column, row):
    x, y = page.evaluate(TO_SCREEN, [column, row])
    return x, y


def click(page, column, row):
    click_at(page.locator("#us-image"), *place(page, column, row))


def has_points(page, count):
    wait_for(page, "trame.state.get('contour').points.length === arg", count)


def contains(mesh, places):
    vertices, faces, _ = weld_vertices(mesh.vertices_mm, mesh.faces)
    return winding_numbers(dipoles_of(indexed_bvh(vertices, faces)), places) > 0


def test_clicks_on_the_images_become_a_surface_file_of_the_true_tumour(page, watched, tmp_path):
    random, count = np.random.default_rng(3), 0
    images = [slice_of(tumour(), tumor_from_image(offset_mm(n)), random) for n in range(40)]
    for frame in CLICKED:
        show_image(page, frame)
        for column, row in clicks_on(images[frame], 9):
            click(page, column, row)
            count += 1
        has_points(page, count)
    assert count >= 36
    page.click("#contour-stl")
    expect(page.locator("#contour-note")).to_have_text(
        re.compile("^contour: the error of its points is not stated; expected that of the calib")
    )
    page.fill("#contour-calibration", "0.5")
    page.press("#contour-calibration", "Tab")
    wait_for(page, "trame.state.get('contour').ready")
    expect(page.locator("#contour-sigma")).to_contain_text("calibration 0.50, pixel 0.07, spacing")
    surface = tmp_path / "contour.stl"
    surface.write_bytes(download(page, "#contour-stl").read_bytes())
    mesh = load_mesh(surface, units="mm", frame="tumor")
    axis = np.arange(-14.0, 14.0, 0.5)
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    true = is_inside(tumour(), grid)
    assert dice(true, contains(mesh, grid)) >= 0.90
    assert mesh.signed_volume_mm3 / (true.sum() * 0.5**3) == pytest.approx(1.0, abs=0.10)
    # As the tumour of a case, with its uncertainty.
    case = write_phantom_case(tmp_path / "case")
    surface.replace(case / "tumor.stl")
    sigma = page.evaluate("trame.state.get('contour').sigma_mm")
    manifest = (case / "case.yaml").read_text()
    (case / "case.yaml").write_text(manifest.replace("tumor:", f"tumor:\n  sigma_mm: {sigma}", 1))
    assert open_case(case).manifest.tumor.sigma_mm == float(sigma)
    assert not watched.external_requests()
    assert watched.errors == [
        "Failed to load resource: the server responded with a status of 409 (Conflict)"
    ]
    watched.errors.clear()


def test_drag_erase_undo_and_the_tip(page):
    for column, row in ((60, 60), (140, 60), (140, 120)):
        click(page, column, row)
    has_points(page, 3)
    drag(page.locator("#us-image"), place(page, 140, 120), place(page, 90, 110))
    wait_for(page, "trame.state.get('contour').points.some((p) => p.y < 112 && p.y > 109)")
    page.click("#contour-tip")
    expect(page.locator("#contour-count")).to_have_text("4 points, 1 image, 1 at the tip")
    page.click("#contour-erase")
    page.fill("#contour-radius", "1")
    click(page, 61, 60)
    has_points(page, 2)
    for _ in range(2):
        page.click("#contour-undo")
    has_points(page, 3)
    expect(page.locator("#contour-count")).to_have_text("3 points, 1 image")
    expect(page.locator("#contour-problem")).to_have_text(
        "contour: 3 points; expected 4 or more that are not in one plane"
    )


def test_click_on_a_point_adds_none_and_a_click_beside_it_one(page):
    click(page, 60, 60)
    has_points(page, 1)
    image, (x, y) = page.locator("#us-image"), place(page, 60, 60)
    click_at(image, x + 2, y)
    click_at(image, x + 9, y)
    has_points(page, 2)
    first, second = read(page, "trame.state.get('contour').points")
    assert (first["x"], first["y"]) == pytest.approx((60.5, 60.5), abs=0.02)
    assert second["x"] > first["x"]


def test_keys_move_a_cross_and_add_a_point(page):
    page.focus("#us-image")
    for key in ("ArrowRight", "Shift+ArrowDown", "Enter"):
        page.keyboard.press(key)
    has_points(page, 1)
    (point,) = read(page, "trame.state.get('contour').points")
    assert (point["x"], point["y"]) == (101.5, 90.5)
    assert page.evaluate("trame.state.get('now').frame") == 20


def test_a_click_on_a_clip_becomes_a_ball_of_the_stated_radius(page):
    click(page, 60, 60)
    has_points(page, 1)
    page.fill("#contour-hydromark", "3")
    page.locator("#contour-hydromark").blur()
    expect(page.locator("#contour-size")).to_have_text(
        re.compile(r"^0\.11 cm., 6\.\d x 6\.\d x 6\.\d mm")
    )
    click(page, 100, 60)
    has_points(page, 2)
    expect(page.locator("#contour-size")).not_to_have_text(re.compile(r"^0\.11 cm"))
    page.fill("#contour-hydromark", "0")
    page.locator("#contour-hydromark").blur()
    expect(page.locator("#contour-problem")).to_have_text(
        re.compile("^contour: 2 points; expected 4")
    )


def test_second_page_that_edits_at_the_same_time_loses_nothing(browser, server, page):
    with watching(browser, server) as other:
        second = other.page
        choose(second, "prepare", "contour")
        expect(second.locator("#ultrasound > div")).to_have_attribute("data-image", "20")
        second.click("#contour-add")
        click(page, 60, 60)
        click(second, 140, 60)
        for each in (page, second):
            has_points(each, 2)
        stale = second.evaluate("trame.state.get('contour').revision")
        click(page, 100, 120)
        has_points(second, 3)
        # The second page asks for what it saw before the last click of the first one.
        assert answer(second, "contour_undo", "second", stale) == (
            "contour: another page has changed it meanwhile, and nothing was done here; expected "
            "the same request again, after a look at it"
        )
        has_points(page, 3)
        second.click("#contour-undo")
        has_points(page, 2)
        expect(second.locator("#contour-note")).to_have_text("")


def test_contouring_has_no_violations(page):
    click(page, 60, 60)
    has_points(page, 1)
    page.click("#contour-clear summary")
    for width, height in ((390, 844), (768, 1024), (1280, 720)):
        resize(page, width, height)
        assert violations(page) == []
    page.click("#contour-clear summary")


def test_viewer_sees_the_contour_and_has_no_tools(browser, server, page):
    click(page, 60, 60)
    with watching(browser, server, server.view_url) as watched:
        viewer = watched.page
        expect(viewer.locator("#contour-count")).to_have_text("1 point, 1 image")
        expect(viewer.locator("#us-contour .us-point")).to_have_count(1)
        assert viewer.locator("#contour button, #contour input, #contour summary").count() == 0
        for name, args in VIEW_REFUSED.items():
            assert "role view; expected operate" in answer(viewer, name, *args), name
        status = viewer.evaluate(
            "() => fetch('contour.stl?revision=1').then((answer) => answer.status)"
        )
        assert status == 403
    has_points(page, 1)
