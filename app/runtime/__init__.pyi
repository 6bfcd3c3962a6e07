from .commands import BetweenSteps, OperatorCommands
from .content import SessionContent, content_of
from .latest_value import SWITCH_INTERVAL_S, LatestValue
from .live_run import LiveRun
from .opening import (
    PreparedCase,
    PreparedLive,
    RecordingExtent,
    RegisteredCase,
    open_recording,
    playback_of,
    prepare_case,
    prepare_live,
    register_case,
)
from .outputs import Output, PassiveOutput, StepTiming, SwitchContent
from .received_constraint import ReceivedConstraint
from .replay_run import ReplayRun
from .sources import Deliver, Source
from .step_thread import DeliveredStep, StepRun, StepThread

__all__ = [
    "SWITCH_INTERVAL_S",
    "BetweenSteps",
    "Deliver",
    "DeliveredStep",
    "LatestValue",
    "LiveRun",
    "OperatorCommands",
    "Output",
    "PassiveOutput",
    "PreparedCase",
    "PreparedLive",
    "ReceivedConstraint",
    "RecordingExtent",
    "RegisteredCase",
    "ReplayRun",
    "SessionContent",
    "Source",
    "StepRun",
    "StepThread",
    "StepTiming",
    "SwitchContent",
    "content_of",
    "open_recording",
    "playback_of",
    "prepare_case",
    "prepare_live",
    "register_case",
]
