"""Result of one step of a session."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.case import JointSample, TrackingFrame
from app.fixture import FixtureDecision
from app.geometry import Transform
from app.registration import RegistrationDrift
from app.session.known_edges import NO_EDGES, KnownEdges
from app.session.path_depth import PathDepth


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """Result of one step.

    ``tumor_from_tip`` is None when the tool or the tumour is not known. ``links`` holds
    ``root_from_link`` for every link of the robot; ``robot_problem`` is the reason if it is empty
    although there is a robot. ``virtual_fixture`` is ``tumor_from_virtual_fixture``, None without a
    constraint. ``drift`` is the difference between the tracked tool and the tool predicted from
    joints and registration, None if one of them is not known. ``frames_problems`` describe errors
    in the frames that the tracker measures, each as ``<kind>: <details>`` or as a sentence;
    ``frames_problem`` joins them, empty if there is none. ``playback`` describes a recording that
    is played on the graph of a live session, empty if there is none.
    ``hold_causes`` are texts on what began and prolonged the present hold, oldest first; empty
    without a hold. ``single_source`` is True if nothing independent can contradict the tracker.
    ``edges`` are those that the step used, for twists in other frames. ``between_frames`` is the
    deepest point on the path from the last known pose if the tool passed through the tumour there
    and is outside at both ends; the decision's proximity is then that of this point.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> step = next(mg.replay(case))
    >>> step.index, step.decision.state.name, str(step.decision.reasons[0])
    (0, 'NEGATIVE', 'clear')
    """

    index: int
    frame: TrackingFrame
    decision: FixtureDecision
    tumor_from_tip: Transform | None
    virtual_fixture: Transform | None
    links: Mapping[str, Transform]
    joints: JointSample | None
    robot_problem: str = ""
    drift: RegistrationDrift | None = None
    frames_problems: tuple[str, ...] = ()
    playback: str = ""
    hold_causes: tuple[str, ...] = ()
    single_source: bool = False
    edges: KnownEdges = NO_EDGES
    between_frames: PathDepth | None = None

    @property
    def frames_problem(self) -> str:
        """All of ``frames_problems``, joined by semicolons."""
        return "; ".join(self.frames_problems)
