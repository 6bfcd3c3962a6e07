"""Registration of points and calibration of a tip, with their uncertainty."""

from app.registration import (
    PivotResult,
    RegistrationResult,
    calibrate_pivot,
    predict_tre,
    register_points,
)

__all__ = [
    "PivotResult",
    "RegistrationResult",
    "calibrate_pivot",
    "predict_tre",
    "register_points",
]
