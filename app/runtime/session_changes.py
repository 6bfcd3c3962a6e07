"""Changes of a running session, each between two steps, checked, completely or not at all."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from app.case.manifest.structures import MAX_STRUCTURES
from app.fixture import MarginParameterError, ProximityEngine, TipProximity
from app.fixture.meshes.mesh_checks import checked_mesh
from app.geometry import FrameError, InputError, SurfaceMesh, Transform
from app.hold import Holds
from app.runtime.case_recorder import CaseRecorder
from app.runtime.compute import Compute, compute_here
from app.runtime.content import SessionContent, StructureContent
from app.runtime.outputs import Output, SwitchContent
from app.runtime.requests import RequestLog
from app.session import (
    REFERENCE,
    ProximityModel,
    Session,
    SessionSetup,
    prepare_replacement,
    tumor_change,
)
from app.session.tumor_replacement import TUMOR, mesh_of

MAX_LIVE_TRIANGLES = 400_000
"""Triangles of a surface that a live session is given. They are prepared in seconds,
in compiled code and NumPy, which release the interpreter, so that the constraint is sent
meanwhile."""


MAX_REASON = 200
"""Characters of the reason for which a structure is switched off."""

MAX_SURFACE_SIGMA_MM = 10.0
"""Largest uncertainty of a surface, as in ``tumor.sigma_mm`` of a ``case.yaml``."""


def check_surface(
    surface: SurfaceMesh, sigma_mm: float, max_triangles: int | None, what: str = TUMOR
) -> None:
    """Raise `InputError` for more triangles, where None allows all, or a wrong uncertainty."""
    if max_triangles is not None and len(surface.faces) > max_triangles:
        raise InputError(
            f"{what}: has {len(surface.faces)} triangles; expected at most {max_triangles} in a "
            "live session: reduce its resolution"
        )
    if not 0.0 <= sigma_mm <= MAX_SURFACE_SIGMA_MM:
        of_what = "the tumour" if what == TUMOR else what
        raise InputError(
            f"uncertainty of {of_what}: is {sigma_mm:.6g} mm; expected 0 to "
            f"{MAX_SURFACE_SIGMA_MM:g} mm"
        )


def check_structure(
    setup: SessionSetup,
    known_frames: Iterable[str],
    structure: StructureContent,
    frame_from_structure: Transform,
) -> None:
    """Raise unless ``structure`` can be guarded beside the tumour of ``setup``.

    `FrameError` for the name of the tumour or of another frame, such as one of ``known_frames``,
    and for a frame that moves with the tool or is itself a structure. `InputError` for too many
    structures and for margins out of range.
    """
    what, frame = f"structure {structure.name!r}", frame_from_structure.target
    tumor, *others = (each.name for each in setup.guarded)
    if structure.name == tumor:
        raise FrameError(f"{what}: is the tumour; expected another name, or ~/set_tumor")
    frames = {REFERENCE, setup.tool_from_tip.source, *setup.shown_frames, *known_frames}
    frames |= {*setup.tool_names, *(name for ends in setup.measured_ends for name in ends)}
    if setup.robot is not None:
        frames |= {setup.robot.base_frame, *(link.name for link in setup.robot.robot.links)}
    if structure.name in {frame, *frames} - {*others}:
        raise FrameError(f"{what}: has the name of another frame; expected a name of its own")
    tool = setup.tool_from_tip
    if frame in {tumor, *others, *setup.off, tool.target, tool.source}:
        raise FrameError(
            f"{what}: is given in frame {frame!r}, that of a structure or of the tool; expected a "
            "tracked frame that does not move with the tool"
        )
    if structure.name not in {*others, *setup.off}:
        count = len(setup.guarded) + len(setup.off)
        if count >= MAX_STRUCTURES:
            raise InputError(
                f"{what}: the session has {count} structures; expected at most {MAX_STRUCTURES}"
            )
    try:
        setup.margins.replaced(stop_mm=structure.stop_mm, warn_mm=structure.warn_mm)
    except MarginParameterError as error:
        raise InputError(f"{what}: {error}") from error


def checked_reason(reason: str, name: str) -> str:
    """``reason`` in one line; raises `InputError` if it is empty or above `MAX_REASON` characters.

    Characters that cannot be printed are replaced by question marks.
    """
    line = "".join(each if each.isprintable() else "?" for each in " ".join(reason.split()))
    if not 0 < len(line) <= MAX_REASON:
        raise InputError(
            f"structure {name!r}: the reason has {len(line)} characters; expected 1 to "
            f"{MAX_REASON} that say why it is not guarded any more"
        )
    return line


def model_of(
    surface: SurfaceMesh,
    frame_from_surface: Transform,
    before: SurfaceMesh | None,
    setup: SessionSetup,
    tool: SurfaceMesh | None,
    compute: Compute,
    what: str = TUMOR,
) -> tuple[ProximityModel, str]:
    """The model of ``surface`` and ``tool``, and the change from ``before``, None for a new one.

    ``before`` is in the frame that it moves with. ``compute`` calls what takes long. Raises
    `InputError` for a session whose tool is unknown, `MeshError` for a surface that is not closed.
    """
    moved = ""
    if before is not None and before.frame != frame_from_surface.target:
        moved = (
            f"{what} replaced: it moves with {frame_from_surface.target!r}, not {before.frame!r}"
        )
        before = None
    is_tip = isinstance(setup.proximity, TipProximity)
    if tool is None and not is_tip:
        verb = "guarded" if before is None and not moved else "replaced"
        raise InputError(
            f"{what}: cannot be {verb}, because the tool's surface is unknown; expected a "
            "session with a tool mesh"
        )
    if isinstance(setup.proximity, ProximityEngine):
        made = compute(prepare_replacement, before, surface, frame_from_surface, what)
        text = moved if made.change is None else made.change.text
        return setup.proximity.with_tumor(made.prepared), text
    checked_mesh(surface, mesh_of(what))
    model = TipProximity(surface) if tool is None or is_tip else ProximityEngine(surface, tool)
    if before is None:
        return model, moved
    placed = surface.transformed(frame_from_surface)
    return model, compute(tumor_change, before, placed, None, what).text


MAX_TIP_SIGMA_MM = 10.0
"""Largest uncertainty of a calibrated tip."""

_SAME_AXIS_RAD = 1e-6


def check_tip(setup: SessionSetup, tool_from_tip: Transform, sigma_mm: float) -> None:
    """Raise unless ``tool_from_tip`` can replace the tip of the tool of ``setup``.

    `FrameError` for a tip between other frames, `InputError` for an uncertainty out of range, and
    for another axis of a tool whose mount on a robot was found with the axis in use.
    """
    known, robot = setup.tool_from_tip, setup.robot
    if (tool_from_tip.target, tool_from_tip.source) != (known.target, known.source):
        raise FrameError(
            f"tip: is {tool_from_tip.target}_from_{tool_from_tip.source}; expected "
            f"{known.target}_from_{known.source}"
        )
    if not 0.0 <= sigma_mm <= MAX_TIP_SIGMA_MM:
        raise InputError(
            f"uncertainty of the tip: is {sigma_mm:.6g} mm; expected 0 to {MAX_TIP_SIGMA_MM:g} mm"
        )
    is_mounted = robot is not None and robot.link_from_tip is not None
    if is_mounted and known.angle_to(tool_from_tip) > _SAME_AXIS_RAD:
        raise InputError(
            "tip: has another axis than the one with which the robot was registered; "
            "expected the same axis, or a session that is registered with the new one"
        )


BetweenSteps = Callable[[], AbstractContextManager[Session]]
"""Gives exclusive access to the session between two steps, as `LiveSession.between_steps` does."""

ContentChange = Callable[[SessionContent], SessionContent]
SetupChange = Callable[[SessionSetup], SessionSetup]

_SHORT_WAIT_S = 0.05


class SessionChanges:
    """Changes session, content and outputs together, and lists what is requested in ``requests``.

    ``between_steps`` gives access to the session. ``holds`` identifies the present hold.
    ``max_triangles`` limits a new structure, which ``compute`` prepares. ``recorder`` records the
    session; None for one that cannot be.
    """

    def __init__(
        self,
        between_steps: BetweenSteps,
        content: SessionContent,
        outputs: Sequence[Output],
        *,
        holds: Holds,
        max_triangles: int | None = None,
        requests: RequestLog | None = None,
        compute: Compute = compute_here,
        recorder: CaseRecorder | None = None,
    ) -> None:
        self._between_steps = between_steps
        self._compute = compute
        self._recorder = recorder
        self._content = self._initial = content
        self._outputs = outputs
        self._changing = threading.Lock()
        """One change at a time: its outputs prepare before the session is locked. A re-arm does not
        wait for it."""
        self._holds = holds
        self._max_triangles = max_triangles
        self._acknowledged = content
        self.requests = requests or RequestLog(time.time_ns, time.monotonic_ns)

    @property
    def compute(self) -> Compute:
        """Calls a function that computes for long, where it does not delay the session."""
        return self._compute

    @property
    def content(self) -> SessionContent:
        """The content in use."""
        return self._content

    @property
    def setup(self) -> SessionSetup:
        """The setup that the session steps with now; waits for a step that is being taken."""
        with self._between_steps() as session:
            return session.setup

    @property
    def requested(self) -> SessionSetup:
        """The setup in use, but with the margins that apply from the next re-arm on."""
        with self._between_steps() as session:
            return session.requested

    @contextmanager
    def _change_at_once(self, what: str, wait_s: float = _SHORT_WAIT_S) -> Iterator[None]:
        """Holds the lock of the changes; raises `InputError` if it is not free soon."""
        if not self._changing.acquire(timeout=wait_s):
            raise InputError(
                f"{what}: another change is being prepared; expected the same request again"
            )
        try:
            yield
        finally:
            self._changing.release()

    @contextmanager
    def _listed(self, kind: str, origin: str) -> Iterator[list[str]]:
        """List the request as accepted, with the texts added to the list, or as refused."""
        done: list[str] = []
        before = self._content
        try:
            yield done
        except Exception as error:
            self.requests.refused(kind, origin, str(error))
            raise
        if self._recorder is not None and self._content is not before:
            self._recorder.note_replaced(self._content.unpublished_changes(before))
            if self._content.image_depth != before.image_depth:
                self._recorder.note_depth()
        self.requests.accepted(kind, origin, "; ".join(done))

    def _change(self, change: ContentChange, used: SetupChange = lambda setup: setup) -> None:
        """Use the content after ``change`` and the setup after ``used`` from the next step on."""
        switches = self._prepare(change(self._content))
        with self._between_steps() as session:
            content = change(self._content)
            self._apply(session, used(content.setup(session.requested)), content, switches)

    def _prepare(self, content: SessionContent) -> list[SwitchContent]:
        return [output.prepare(content) for output in self._outputs]

    def _apply(
        self,
        session: Session,
        setup: SessionSetup,
        content: SessionContent,
        switches: list[SwitchContent],
        tumor_change: str = "",
    ) -> bool:
        """Change session and outputs; True if that latched a hold."""
        loosened = session.use(setup, tumor_change=tumor_change)
        self._switch(content.with_margins(session.setup), switches)
        if loosened:
            for output in self._outputs:
                output.latch(session.hold_causes)
        return loosened

    def _switch(self, content: SessionContent, switches: list[SwitchContent]) -> None:
        # The permissions of the last step were computed with the previous content.
        for output in self._outputs:
            output.revoke()
        for switch in switches:
            switch(content)
        self._content = content
