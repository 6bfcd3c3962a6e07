"""A scene of its own for steps of a session, and a picture of one step."""

from slicer import vtkMRMLScene

from app.runtime import SessionContent
from app.scene.application import SceneApplication
from app.scene.errors import SceneError
from app.scene.pictures.picture import SIZE, scene_png
from app.scene.presenter import ScenePresenter
from app.scene.scene import MarginGuardScene
from app.session import StepResult


class StepScene:
    """A new scene that shows ``step``; ``presenter`` then shows other steps of the session.

    Raises `SceneError` if ``step`` does not place the tumour and the tool.
    """

    def __init__(self, content: SessionContent, step: StepResult) -> None:
        self.application = SceneApplication(vtkMRMLScene())
        self.presenter = ScenePresenter(self.application.scene, content)
        self.presenter.show(step)
        self.scene = _with_tumor_and_tool(self.presenter, step)


def step_png(content: SessionContent, step: StepResult, size: tuple[int, int] = SIZE) -> bytes:
    """Draw ``step`` in a new scene, as PNG of ``size`` (width, height) in pixels.

    Raises `OffscreenError` where nothing can be drawn without a screen, `SceneError` as
    `StepScene`.
    """
    shown = StepScene(content, step)
    return scene_png(shown.application, shown.scene, size)


def _with_tumor_and_tool(presenter: ScenePresenter, step: StepResult) -> MarginGuardScene:
    content, scene = presenter.content, presenter.scene
    if scene is not None and scene.tumor is not None and scene.tool is not None:
        return scene
    no_tumor = scene is None or scene.tumor is None
    frame = content.tumor.frame if no_tumor else content.tip_frame
    raise SceneError(
        f"step {step.index}: frame {frame!r} has no pose; expected a step that places the tumour "
        "and the tool"
    )
