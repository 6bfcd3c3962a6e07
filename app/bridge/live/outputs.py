"""Outputs that receive the steps of a live node, and their order."""

import os
import re
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from geometry_msgs.msg import WrenchStamped

from app.bridge import messages, topics
from app.bridge.control.allowed_twist import TwistLimiter
from app.bridge.displays.display_output import DisplayOutput
from app.bridge.heartbeat import steady_ns
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.bridge.publishing.session_publisher import SessionPublisher
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfListener
from app.bridge.topics import INCOMING
from app.case import LiveCase
from app.files.paths import state_folder
from app.fixture import Guidance, GuidanceParameters, LimiterParameters, MarginParameters
from app.geometry import NS_PER_S, FloatArray, ImageSample, InputError, Stamp, Transform
from app.runtime import (
    AuditLog,
    AuditOutput,
    CaseRecorder,
    ImageDescription,
    Output,
    PassiveOutput,
    PreparedLive,
    RequestKind,
    RequestLog,
    SessionContent,
    StepTiming,
    described_images,
)
from app.session import SessionSetup, SetupDoubts, StepResult

IMAGE_TOPIC = "~/image"
"""Images that come over OpenIGTLink, for displays."""


@dataclass(frozen=True, slots=True, eq=False)
class LiveOutputs:
    """``in_order``: the outputs in the order in which they receive each step.

    ``depth`` and ``displays`` are two of them, ``twists`` replies to the twists of a controller.
    ``images`` are those of the session, None without. ``requests`` lists the requests of operators,
    ``recorder`` records the session.
    """

    in_order: tuple[Output, ...]
    twists: TwistLimiter
    depth: "ChosenDepth"
    displays: DisplayOutput
    images: ImageDescription | None
    requests: RequestLog
    recorder: CaseRecorder

    def refused_twists(self) -> Mapping[str, int]:
        """Number of refused twists, by reason."""
        return {f"twists refused: {why}": n for why, n in dict(self.twists.refused).items()}


@contextmanager
def live_outputs(
    prepared: PreparedLive,
    publisher: SessionPublisher,
    *,
    limiter: LimiterParameters,
    guidance: GuidanceParameters | None,
    image_problem: Callable[[], str],
    namespace: str,
    audit: Path | None,
    cases: Path | None,
    displays: Sequence[str],
) -> Iterator[LiveOutputs]:
    """The outputs of the session that ``publisher`` publishes.

    Within the context the audit log is written. At its end a running recording is finished.
    """
    config, content, ros = prepared.config, prepared.content, publisher.ros
    requests = RequestLog(time.time_ns, time.monotonic_ns)
    with (
        _audit_log(ros, publisher.constraints, audit or _audit_file(ros)) as log,
        _case_recorder(config, namespace, cases) as recorder,
    ):
        requests.listen(log.request)
        buffer = TransformBuffer()
        TfListener(ros, buffer, clock=False, qos=INCOMING)
        twists = TwistLimiter(
            ros,
            buffer,
            parameters=limiter,
            simulated=content.simulated and not config.moves_by_simulated,
        )
        wrench = () if guidance is None else (GuidanceOutput(ros, guidance),)
        images = described_images(prepared.case, ros.node.resolve_topic_name(IMAGE_TOPIC))
        depth = ChosenDepth(content, images)
        recorder.depth = lambda: depth.choice
        recorder.ended = partial(requests.refused, RequestKind.RECORD, "the recorder")
        shown = DisplayOutput(
            ros,
            content,
            images,
            displays,
            instance_id=publisher.constraints.instance_id,
            holds=publisher.constraints,
            requests=requests,
            recording=lambda: recorder.status,
            image_problem=image_problem,
        )
        in_order = (
            PlaybackLog(ros),
            FramesProblemLog(ros),
            SetupDoubtLog(ros, prepared.setup),
            publisher,
            TwistOutput(twists, prepared.setup.margins),
            *wrench,
            AuditOutput(log, content, time.monotonic_ns),
            depth,
            shown,
        )
        yield LiveOutputs(in_order, twists, depth, shown, images, requests, recorder)


def _audit_file(ros: RosNode) -> Path:
    """Default audit log of a live node, below the state folder, by host, domain and namespace.

    Raises `InputError` for a user without a home folder.
    """
    domain, namespace = ros.node.context.get_domain_id(), ros.node.get_namespace()
    parts = (socket.gethostname(), f"domain{domain}", namespace.strip("/"))
    name = "-".join(re.sub(r"[^A-Za-z0-9.]+", "_", part)[:60] for part in parts if part)
    return state_folder() / "audit" / f"{name}.jsonl"


@contextmanager
def _case_recorder(config: LiveCase, namespace: str, cases: Path | None) -> Iterator[CaseRecorder]:
    """Records the session of ``config`` below ``cases``, by default below the state folder.

    A running recording is finished at the end of the context.
    """
    case = config.case
    recorder = CaseRecorder(
        case.folder / case.manifest.file,
        cases or state_folder() / "cases",
        title=case.manifest.name,
        package_dirs=case.package_dirs,
        namespace=namespace,
    )
    try:
        yield recorder
    finally:
        with suppress(InputError):  # it has been listed with the requests
            recorder.close()


@contextmanager
def _audit_log(ros: RosNode, constraints: ConstraintStream, path: Path) -> Iterator[AuditLog]:
    """The audit log of a live node; within the context its thread writes."""
    about = {
        "node": ros.node.get_fully_qualified_name(),
        "pid": os.getpid(),
        "instance_id": constraints.instance_id,
    }
    log = AuditLog(path, about, time.time_ns, ros.node.get_logger().error)
    try:
        ros.node.get_logger().info(f"audit log: {log.path}")
        yield log
    finally:
        log.close()


class TwistOutput(PassiveOutput):
    """`Output` that lets ``limiter`` allow the motion of the last step while its data are valid."""

    def __init__(self, limiter: TwistLimiter, margins: MarginParameters) -> None:
        self._limiter = limiter
        self._margins = margins

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Allow the motion of ``step``; none if an earlier output found the step too late."""
        if timing.in_time:
            # Read before the time that has been spent: a stop in between shortens the validity.
            since_ns = steady_ns()
            self._limiter.allow(step, self._margins, timing.spent_now_ns(), since_ns)
        else:
            self._limiter.forbid()
        return True

    def revoke(self) -> None:
        """Allow no motion until the next step."""
        self._limiter.forbid()

    def end(self) -> None:
        """Allow no motion."""
        self._limiter.forbid()

    def _use(self, content: SessionContent) -> None:
        self._margins = content.margins


class GuidanceOutput(PassiveOutput):
    """`Output` that publishes ``~/guidance_wrench``: the guidance force at the tool's tip.

    One wrench per step: N and N m in the tip's frame, stamp of the oldest sample. Zero at the end.

    If the tool's pose is unknown, or the planes belong to another pose, the force fades out at
    its limited rate. A step that is later than the period for which the stiffness is passive
    changes the force by no more than one period allows.
    """

    def __init__(self, ros: RosNode, parameters: GuidanceParameters) -> None:
        self._parameters = parameters
        self._guidance = Guidance(parameters)
        self._max_step_ns = max(1, round(parameters.period_s * NS_PER_S))
        self._pose: Transform | None = None
        self._last: Stamp | None = None
        self._publisher = ros.publisher(topics.GUIDANCE_WRENCH)

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Publish the wrench of ``step``; publishes nothing before the tool's first pose."""
        now, last = step.frame.stamp, self._last
        self._last = now
        decision, constraint = step.decision, None
        if step.tumor_from_tip is not None:
            self._pose = step.tumor_from_tip
            constraint = decision.constraint if decision.constraint_is_current else None
        if self._pose is None:
            return True
        step_ns = self._max_step_ns if last is None else last.age_ns(now)
        wrench = self._guidance.update(
            constraint, self._pose.translation_mm, min(max(1, step_ns), self._max_step_ns)
        )
        self._send(self._pose, wrench, decision.stamp or now)
        return True

    def end(self) -> None:
        """Publish a zero wrench, because no step follows that would let the force fade out."""
        self._guidance = Guidance(self._parameters)
        if self._pose is not None and self._last is not None:
            self._send(self._pose, np.zeros(6), self._last)

    def _send(self, pose: Transform, wrench: FloatArray, stamp: Stamp) -> None:
        """Publish ``wrench`` (6,), given along the tumour's axes, along those of the tip."""
        tip_from_tumor = pose.rotation.T
        message = WrenchStamped(header=messages.header_message(pose.source, stamp))
        message.wrench.force = messages.vector_message(np.dot(tip_from_tumor, wrench[:3]))
        message.wrench.torque = messages.vector_message(np.dot(tip_from_tumor, wrench[3:]))
        self._publisher.publish(message)


class _OnceLog(PassiveOutput):
    """Base of an `Output` that logs each kind of text once; what is behind its colon may change."""

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._logged: set[str] = set()

    def _log(self, texts: Iterable[str], prefix: str = "") -> bool:
        for text in texts:
            kind = text.partition(":")[0]
            if kind not in self._logged:
                self._logged.add(kind)
                self._ros.node.get_logger().warning(f"{prefix}{text}")
        return True


class FramesProblemLog(_OnceLog):
    """`Output` that logs each kind of problem with the tracker's frames once."""

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Log a new kind of problem."""
        return self._log(step.frames_problems)


class SetupDoubtLog(_OnceLog):
    """`Output` that logs each doubt about ``setup`` once."""

    def __init__(self, ros: RosNode, setup: SessionSetup) -> None:
        super().__init__(ros)
        self._doubts = SetupDoubts(setup)

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Log a new doubt; its numbers may change."""
        return self._log(self._doubts.observe(step), "check the set-up: ")

    def _use(self, content: SessionContent) -> None:
        self._doubts.stale_after_ns = content.margins.stale_after_ns
        self._doubts.use_tip(content.tool_from_tip)


class PlaybackLog(PassiveOutput):
    """`Output` that logs the beginning and the end of a playback of a recording.

    The name of the case may be known some steps after the beginning; then it is logged as well.
    """

    def __init__(self, ros: RosNode) -> None:
        self._ros = ros
        self._logged = ""

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Log a playback that has begun or ended."""
        if step.playback != self._logged:
            self._logged = step.playback
            text = f"PLAYBACK: {step.playback}" if step.playback else "the PLAYBACK has ended"
            self._ros.node.get_logger().warning(text)
        return True


class ChosenDepth(PassiveOutput):
    """`Output` that follows the imaging depth, for recordings and for images over OpenIGTLink.

    ``choice``: the depth in mm that was chosen last, and the stamp in ns after which it holds; None
    before the first. ``images`` are those of the session.
    """

    def __init__(self, content: SessionContent, images: ImageDescription | None) -> None:
        self.choice: tuple[float, int] | None = None
        self._depth = content.image_depth
        self._depths = None if images is None else images.depths()
        self._lock = threading.Lock()
        self._newest_ns = 0

    def check(self, image: ImageSample) -> None:
        """Raise `InputError` for an image whose stated size of a pixel is that of another depth."""
        if self._depths is not None and image.stamp is not None:
            with self._lock:
                self._depths.check(image.stamp.ns, image.pixel_mm)

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """Note the time of ``step``."""
        self._newest_ns = step.frame.stamp.ns
        return True

    def _use(self, content: SessionContent) -> None:
        if content.image_depth is not None and content.image_depth != self._depth:
            depth_mm = content.image_depth.depth_mm
            self.choice = depth_mm, self._newest_ns
            if self._depths is not None:
                with self._lock:
                    self._depths.choose(depth_mm, self._newest_ns)
        self._depth = content.image_depth
