"""Follow tf: one lookup of all links of a robot at one stamp."""

from app.bridge.robots.settings import RobotSettings
from app.bridge.robots.state import RobotState, age_problem
from app.bridge.tf import TfError, TransformBuffer
from app.geometry import FloatArray
from app.robot import Robot


class TfFollower:
    """Reads the links' poses from ``buffer``, which a `TfListener` fills. Not thread-safe."""

    def __init__(self, robot: Robot, settings: RobotSettings, buffer: TransformBuffer) -> None:
        self._settings = settings
        self._buffer = buffer
        self._root = settings.root_frame(robot)
        self._links = tuple(link.name for link in robot.links)
        self._frames = tuple(settings.frame(name) for name in self._links)
        self._last: tuple[FloatArray, int | None] | None = None

    def state(self, now_ns: int) -> RobotState:
        """Poses at the latest common time of all links; stale with the previous ones on error."""
        problem = ""
        try:
            found = self._buffer.poses(self._root, self._frames)
            found.matrices.flags.writeable = False
            self._last = (found.matrices, found.stamp_ns)
        except TfError as error:
            problem = str(error)
        poses, stamp_ns = self._last or (None, None)
        old = age_problem(stamp_ns, now_ns, self._settings.freshness_limits)
        problems = tuple(filter(None, (problem, old)))
        return RobotState(self._root, self._links, poses, stamp_ns, bool(problems), problems)
