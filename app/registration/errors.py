"""Why a registration or a calibration was not computed, one type a cause.

Each message names the value, where it stood, and what was allowed. None of these is ever turned
into a neutral result: there is no transform when there is an error.
"""

from app.geometry import MarginGuardError


class RegistrationError(MarginGuardError):
    """Root of every refusal of this room."""


class TooFewError(RegistrationError):
    """Fewer points, poses or samples than the unknowns need."""


class NoValidSamplesError(TooFewError):
    """Not one sample that the tracker called good."""


class UnequalCountsError(RegistrationError):
    """Lists that belong together pair by pair have different lengths."""


class NotFiniteError(RegistrationError):
    """A coordinate, a covariance or a time is NaN or infinite."""


class ShapeError(RegistrationError):
    """An array of the wrong shape, or a number out of its range."""


class CoincidentPointsError(RegistrationError):
    """All points are one point: no rotation can be found."""


class CollinearPointsError(RegistrationError):
    """The points lie on a line, or nearly, relative to their spread: the turn about it is free."""


class MirroredPointsError(RegistrationError):
    """One list is the mirror image of the other: no rigid motion maps them."""


class ScaleMismatchError(RegistrationError):
    """The two lists differ in size so much that their units must differ."""


class CovarianceError(RegistrationError):
    """A covariance that is not symmetric and positive definite, or one that is not known."""


class DegenerateMotionError(RegistrationError):
    """Poses that do not turn enough, or about one axis only: part of the answer is free."""


class FreeMotionError(RegistrationError):
    """Touched points that may slide on their surface without leaving it."""


class NoConsensusError(RegistrationError):
    """Too few observations agree, or two groups agree on different answers."""


class ConvergenceError(RegistrationError):
    """The iteration did not settle."""


class FlatSignalError(RegistrationError):
    """A signal that does not move enough to be aligned in time."""
