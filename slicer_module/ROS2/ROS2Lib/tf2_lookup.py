"""Poses of tf in the scene: a transform node that knows how old it is."""

from slicer import vtkMRMLLinearTransformNode

from app.bridge.robots.settings import STALE_AFTER_NS, pose_limits
from app.bridge.tf import Lookup, TfError
from app.geometry import NS_PER_S, Freshness, check_frame, freshness_of
from app.scene.nodes.convert import is_at, vtk_matrix
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Member, Owner

MISSING, VALID, STALE = "missing", "valid", "stale"


class vtkMRMLROS2Tf2LookupNode(Member, vtkMRMLLinearTransformNode):
    """Where the child is in its parent, in mm; ``TransformModifiedEvent`` once for each new sample.

    Its state is ``missing`` before the first sample, ``valid``, or ``stale``: while the oldest of
    the newest samples on the way is older than `GetStaleAfterSeconds` or from as far in the
    future, and while tf has no answer. A stale node keeps its pose, and one that somebody moved is
    back at the next `Spin` where tf has it. The attributes ``ros2.state`` and ``ros2.stamp_ns``,
    that sample's own stamp, are as the last `Spin` has seen them.
    """

    ROLE = "lookup"

    def __init__(self) -> None:
        self._parent = ""
        self._child = ""
        self._found: Lookup | None = None
        self._problem = ""
        self._stale_after_ns = STALE_AFTER_NS
        self._always_modified = False

    def GetParentID(self) -> str:
        """The parent's frame."""
        return self._parent

    def GetChildID(self) -> str:
        """The child's frame."""
        return self._child

    def IsParentAndChildSet(self) -> bool:
        """Whether both are known."""
        return bool(self._parent and self._child)

    def SetModifiedOnLookup(self, always: bool) -> None:
        """Whether each `Spin` that finds a pose is an event, new or not; False at first."""
        self._always_modified = always

    def GetModifiedOnLookup(self) -> bool:
        """Whether each `Spin` that finds a pose is an event."""
        return self._always_modified

    def GetState(self) -> str:
        """``missing``, ``valid`` or ``stale``, now: also when nobody spins any more."""
        if self._found is None:
            return MISSING
        if self._owner is None or self._problem:
            return STALE
        stamp_ns = self._found.stamp_ns
        if stamp_ns is None:  # static edges alone, which hold at any time
            return VALID
        limits = pose_limits(self._stale_after_ns)
        freshness = freshness_of(stamp_ns, self._owner.now_ns(), limits)
        return VALID if freshness is Freshness.VALID else STALE

    def IsStale(self) -> bool:
        """Whether the pose must not be trusted: too old, or not there."""
        return self.GetState() != VALID

    def GetProblem(self) -> str:
        """Why tf has no answer now; empty where it has one."""
        return self._problem

    def GetStampNanoseconds(self) -> int | None:
        """The stamp of the oldest of the samples of the pose; None: none, or they hold always."""
        return None if self._found is None else self._found.stamp_ns

    def GetAgeSeconds(self) -> float | None:
        """How old that is on the node's clock; None before the first, 0 for what holds always."""
        if self._found is None or self._owner is None:
            return None
        stamp_ns = self._found.stamp_ns
        return 0.0 if stamp_ns is None else (self._owner.now_ns() - stamp_ns) / NS_PER_S

    def SetStaleAfterSeconds(self, seconds: float) -> None:
        """From what age on the pose is stale."""
        if not seconds > 0.0:
            raise Ros2Error(f"{self.GetName()}: stale after {seconds} s: more than 0 wanted")
        self._stale_after_ns = round(seconds * NS_PER_S)

    def GetStaleAfterSeconds(self) -> float:
        """From what age on the pose is stale."""
        return self._stale_after_ns / NS_PER_S

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """Parent and child."""
        parent, child = names
        return (check_frame(parent), check_frame(child))

    def status(self) -> str:
        """Whether its pose can be trusted, and how old it is."""
        age = self.GetAgeSeconds()
        state = self.GetState()
        return state if age is None else f"{state}, {age:.1f} s old"

    def spin(self) -> None:
        """Look the pose up, and how old it is."""
        if self._owner is None:
            return
        try:
            found = self._owner.buffer.lookup(self._parent, self._child)
            self._problem = ""
        except TfError as error:
            found, self._problem = None, str(error)
        modifying = self.StartModify()
        if found is not None and (self._always_modified or self._is_news(found)):
            self._found = found
            self.SetAttribute("ros2.stamp_ns", str(found.stamp_ns or 0))
            self.SetMatrixTransformToParent(vtk_matrix(found.transform))
        self._judge()
        self.EndModify(modifying)

    def _is_news(self, found: Lookup) -> bool:
        """Another sample, or the node is not where it is: somebody has moved it."""
        last = self._found
        return (
            last is None
            or last.stamp_ns != found.stamp_ns
            or not is_at(self, vtk_matrix(found.transform))
        )

    def _judge(self) -> None:
        state = self.GetState()
        if state != self.GetAttribute("ros2.state"):
            self.SetAttribute("ros2.state", state)

    def _start(self, owner: Owner, parent: str, child: str) -> None:
        self._parent, self._child = parent, child
        self._found, self._problem = None, ""
        _ = owner.buffer  # hears tf from here on
        self.SetName(f"ros2:tf2lookup:{parent}To{child}")
        self._judge()

    def _stop(self) -> None:
        self._problem = "nobody looks it up any more"
        self._judge()
