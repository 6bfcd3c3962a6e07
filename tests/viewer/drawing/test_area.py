"""The area of the picture on the page."""

from app.viewer.drawing.area import PictureArea
from app.viewer.drawing.scene_view import SceneView


def test_size_is_used_with_the_next_picture_and_within_limits(can_draw, parts):
    area = PictureArea(SceneView(parts.content).view)
    assert area.take_resized()  # the size before the first page
    for size in ((320, 240), (100_000, 1)):
        area.process_resize_event(*size)
    assert area.take_resized()
    assert area.render_window.GetSize() == (4096, 16)
    assert not area.take_resized()
