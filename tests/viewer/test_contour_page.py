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
from tests.viewer.conftest import wait_until_uncovered, watching

TO_SCREEN = """([column, row]) => {
  const svg = document.querySelector("#us-image");
  const { x, y } = new DOMPoint(column + 0.5, row + 0.5).matrixTransform(svg.getScreenCTM());
  return [x, y];
}"""

ANSWER = """([name, args]) => trame.trigger(name, args)
  .then(() => "done", (error) => error.message)"""
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


@pytest.fixture(scope="module")
def watched(browser, server):
    with watching(browser, server) as found:
        yield found


@pytest.fixture(autouse=True)
def no_points(watched):
    yield
    page = watched.page
    if page.evaluate("trame.state.get('contour').count") != "no points":
        page.click("#contour-clear summary")
        page.click("#contour-clear-confirm")
    expect(page.locator("#contour-count")).to_have_text("no points")
    for button in ("#contour-add", "#contour-erase"):
        if page.locator(button).get_attribute("aria-pressed") == "true":
            page.click(button)


def go_to(page, frame):
    page.evaluate("frame => trame.trigger('frame', [frame])", frame)
    expect(page.locator("#ultrasound > div")).to_have_attribute("data-image", str(frame))


def place(page, column, row):
    x, y = page.evaluate(TO_SCREEN, [column, row])
    return x, y


def click(page, column, row):
    wait_until_uncovered(page)
    page.mouse.click(*place(page, column, row))


def points(page):
    found: list[dict[str, float]] = page.evaluate("trame.state.get('contour').points")
    return found


def has_points(page, count):
    page.wait_for_function("n => trame.state.get('contour').points.length === n", arg=count)


def contains(mesh, places):
    vertices, faces, _ = weld_vertices(mesh.vertices_mm, mesh.faces)
    return winding_numbers(dipoles_of(indexed_bvh(vertices, faces)), places) > 0


def test_clicks_on_the_images_become_a_surface_file_of_the_true_tumour(
    watched, server, tmp_path_factory
):
    page, random, count = watched.page, np.random.default_rng(3), 0
    images = [slice_of(tumour(), tumor_from_image(offset_mm(n)), random) for n in range(40)]
    page.click("#contour-add")
    for frame in CLICKED:
        go_to(page, frame)
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
    page.wait_for_function("() => trame.state.get('contour').ready")
    expect(page.locator("#contour-sigma")).to_contain_text("calibration 0.50, pixel 0.07, spacing")
    with page.expect_download() as download:
        page.click("#contour-stl")
    folder = tmp_path_factory.mktemp("saved")
    download.value.save_as(folder / "contour.stl")
    mesh = load_mesh(folder / "contour.stl", units="mm", frame="tumor")
    axis = np.arange(-14.0, 14.0, 0.5)
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    true = is_inside(tumour(), grid)
    assert dice(true, contains(mesh, grid)) >= 0.90
    assert mesh.signed_volume_mm3 / (true.sum() * 0.5**3) == pytest.approx(1.0, abs=0.10)
    # As the tumour of a case, with its uncertainty.
    case = write_phantom_case(folder / "case")
    (case / "tumor.stl").write_bytes((folder / "contour.stl").read_bytes())
    sigma = page.evaluate("trame.state.get('contour').sigma_mm")
    manifest = (case / "case.yaml").read_text()
    (case / "case.yaml").write_text(manifest.replace("tumor:", f"tumor:\n  sigma_mm: {sigma}", 1))
    assert open_case(case).manifest.tumor.sigma_mm == float(sigma)
    assert not watched.external_requests()
    assert watched.errors == [
        "Failed to load resource: the server responded with a status of 409 (Conflict)"
    ]
    watched.errors.clear()


def test_drag_erase_undo_and_the_tip(watched):
    page = watched.page
    go_to(page, 20)
    page.click("#contour-add")
    for column, row in ((60, 60), (140, 60), (140, 120)):
        click(page, column, row)
    has_points(page, 3)
    wait_until_uncovered(page)
    page.mouse.move(*place(page, 140, 120))
    page.mouse.down()
    page.mouse.move(*place(page, 90, 110), steps=4)
    page.mouse.up()
    page.wait_for_function(
        "() => trame.state.get('contour').points.some((p) => p.y < 112 && p.y > 109)"
    )
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


def test_keys_move_a_cross_and_add_a_point(watched):
    page = watched.page
    go_to(page, 20)
    page.click("#contour-add")
    page.focus("#us-image")
    for key in ("ArrowRight", "Shift+ArrowDown", "Enter"):
        page.keyboard.press(key)
    has_points(page, 1)
    (point,) = points(page)
    assert (point["x"], point["y"]) == (101.5, 90.5)
    assert page.evaluate("trame.state.get('now').frame") == 20


def test_a_click_on_a_clip_becomes_a_ball_of_the_stated_radius(watched):
    page = watched.page
    go_to(page, 20)
    page.click("#contour-add")
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


def test_second_page_that_edits_at_the_same_time_loses_nothing(browser, server, watched):
    page = watched.page
    go_to(page, 20)
    page.click("#contour-add")
    with watching(browser, server) as other:
        second = other.page
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
        text = second.evaluate(ANSWER, ["contour_undo", ["second", stale]])
        assert text == (
            "contour: another page has changed it meanwhile, and nothing was done here; expected "
            "the same request again, after a look at it"
        )
        has_points(page, 3)
        second.click("#contour-undo")
        has_points(page, 2)
        expect(second.locator("#contour-note")).to_have_text("")


def test_contouring_has_no_violations(watched):
    page = watched.page
    go_to(page, 20)
    page.click("#contour-add")
    click(page, 60, 60)
    has_points(page, 1)
    page.click("#contour-clear summary")
    for width, height in ((1280, 720), (390, 844), (768, 1024)):
        page.set_viewport_size({"width": width, "height": height})
        assert violations(page) == []
    page.set_viewport_size({"width": 1280, "height": 720})
    page.click("#contour-clear summary")


def test_viewer_sees_the_contour_and_has_no_tools(browser, server, watched):
    page = watched.page
    go_to(page, 20)
    page.click("#contour-add")
    click(page, 60, 60)
    context = browser.new_context()
    viewer = context.new_page()
    viewer.goto(server.view_url)
    expect(viewer.locator("#contour-count")).to_have_text("1 point, 1 image")
    expect(viewer.locator("#us-contour .us-point")).to_have_count(1)
    assert viewer.locator("#contour button, #contour input, #contour summary").count() == 0
    for name, args in VIEW_REFUSED.items():
        text = viewer.evaluate(ANSWER, [name, args])
        assert "role view; expected operate" in text, name
    status = viewer.evaluate(
        "() => fetch('contour.stl?revision=1').then((answer) => answer.status)"
    )
    assert status == 403
    context.close()
    has_points(page, 1)
