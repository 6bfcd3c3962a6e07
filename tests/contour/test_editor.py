"""Editing a contour: order of an outline, erasing, undo, and two pages at the same time."""

import pytest

from app.contour import MAX_POINTS, Change, ContourEditor
from app.geometry import InputError


def by(editor: ContourEditor, author: str = "me") -> Change:
    return Change(author, editor.revision)


@pytest.fixture
def editor():
    made = ContourEditor("needle")
    for column, row in ((0, 0), (10, 0), (10, 10), (0, 10)):
        made.add(by(made), (column, row, 0.0), 1, (column, row))
    return made


def numbers(editor: ContourEditor) -> list[int]:
    return [point.number for point in editor.contour.points]


def test_point_between_others_joins_the_outline_there(editor):
    editor.add(by(editor), (10.0, 5.0, 0.0), 1, (10, 5))
    editor.add(by(editor), (5.0, 5.0, 3.0))  # at the tip: of no outline
    editor.add(by(editor), (1.0, 1.0, 5.0), 2, (1, 1))
    assert numbers(editor) == [1, 2, 5, 3, 4, 6, 7]
    assert editor.contour.images == (1, 2)
    assert [point.number for point in editor.contour.outline(1)] == [1, 2, 5, 3, 4]


def test_erase_takes_the_points_within_the_radius_of_all_images(editor):
    editor.add(by(editor), (0.0, 1.0, 1.0), 2, (0, 1))
    assert editor.erase(by(editor), (0.0, 0.0, 0.0), 2.0) == 2
    assert numbers(editor) == [2, 3, 4]
    revision = editor.revision
    assert editor.erase(by(editor), (50.0, 0.0, 0.0), 2.0) == 0
    assert editor.revision == revision


def test_undo_restores_each_change_and_numbers_are_never_used_again(editor):
    before = editor.contour
    editor.delete_all(by(editor))
    assert numbers(editor) == []
    editor.undo(by(editor))
    assert editor.contour is before
    editor.undo(by(editor))
    assert numbers(editor) == [1, 2, 3]
    editor.add(by(editor), (0.0, 10.0, 0.0), 1, (0, 10))
    assert numbers(editor) == [1, 2, 3, 5]
    for _ in range(4):
        editor.undo(by(editor))
    assert (numbers(editor), editor.can_undo) == ([], False)
    with pytest.raises(InputError, match="no change to undo"):
        editor.undo(by(editor))


def test_change_of_what_another_page_has_changed_is_refused_and_loses_nothing(editor):
    mine, other = by(editor), by(editor, "other")
    editor.move(other, 2, (12.0, 0.0, 0.0), (12, 0))
    for change in (
        lambda: editor.undo(mine),
        lambda: editor.delete_all(mine),
        lambda: editor.erase(mine, (0.0, 0.0, 0.0), 2.0),
        lambda: editor.dilate(mine, 1.0),
        lambda: editor.move(mine, 2, (11.0, 0.0, 0.0), (11, 0)),
    ):
        with pytest.raises(InputError, match="another page has changed it meanwhile"):
            change()
    assert editor.contour.point(2).pixel == (12, 0)
    # Another point may be moved, and a point may be added: both lose nothing.
    editor.move(mine, 3, (11.0, 11.0, 0.0), (11, 11))
    editor.add(mine, (5.0, 12.0, 0.0), 1, (5, 12))
    assert len(numbers(editor)) == 5
    editor.undo(by(editor))
    assert numbers(editor) == [1, 2, 3, 4]


def test_one_page_may_send_faster_than_it_sees(editor):
    seen = by(editor)
    editor.add(seen, (5.0, -1.0, 0.0), 1, (5, -1))
    editor.move(seen, 5, (5.0, -2.0, 0.0), (5, -2))
    editor.undo(seen)
    assert editor.contour.point(5).pixel == (5, -1)


def test_point_that_was_erased_cannot_be_moved(editor):
    seen = by(editor)
    editor.erase(by(editor, "other"), (0.0, 0.0, 0.0), 2.0)
    with pytest.raises(InputError, match="point 1 does not exist, it was erased meanwhile"):
        editor.move(seen, 1, (1.0, 1.0, 0.0), (1, 1))


def test_history_that_is_no_longer_known_counts_as_changed(editor):
    old = by(editor)
    for n in range(250):
        editor.move(by(editor), 1, (n, 0.0, 0.0), (n, 0))
    with pytest.raises(InputError, match="another page"):
        editor.undo(old)


def test_points_are_limited():
    editor = ContourEditor("needle")
    for n in range(MAX_POINTS):
        editor.add(by(editor), (n, 0.0, 0.0))
    with pytest.raises(InputError, match="300 points; expected at most 300"):
        editor.add(by(editor), (0.0, 1.0, 0.0))
    assert len(editor.contour.points) == MAX_POINTS
