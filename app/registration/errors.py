"""Errors of registrations and calibrations, one type per cause.

A message names the place, the value and what is allowed. An error is never replaced by a default
result: there is no transform then.
"""

from app.geometry import MarginGuardError


class RegistrationError(MarginGuardError):
    """Base class of the errors of this package."""


class TooFewError(RegistrationError):
    """Fewer points, poses or samples than the unknowns require."""


class NoValidSamplesError(TooFewError):
    """No sample has status OK."""


class UnequalCountsError(RegistrationError):
    """Lists of pairs have different lengths."""


class NotFiniteError(RegistrationError):
    """A coordinate, a covariance or a time is NaN or infinite."""


class ShapeError(RegistrationError):
    """An array has the wrong shape, or a number is out of range."""


class CoincidentPointsError(RegistrationError):
    """All points coincide: no rotation can be found."""


class CollinearPointsError(RegistrationError):
    """The points lie on or close to a line: the rotation about it is undetermined."""


class MirroredPointsError(RegistrationError):
    """One point set is the mirror image of the other: no rigid motion maps them."""


class ScaleMismatchError(RegistrationError):
    """The extents of two point sets differ so much that their units must differ."""


class CovarianceError(RegistrationError):
    """A covariance is not symmetric and positive definite, or is not known."""


class DegenerateMotionError(RegistrationError):
    """Poses rotate too little or about one axis only: part of the result is undetermined."""


class FreeMotionError(RegistrationError):
    """Points can slide along their surface: the pose is undetermined."""


class NoConsensusError(RegistrationError):
    """Too few observations agree, or two groups agree on different results."""


class ConvergenceError(RegistrationError):
    """An iteration did not converge."""


class FlatSignalError(RegistrationError):
    """A signal changes too little to be aligned in time."""
