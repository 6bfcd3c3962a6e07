from .cases import (
    PreparedCase,
    StepResult,
    example_case,
    make_case,
    open_case,
    replay,
    write_case,
)
from .constraints import (
    Constraint,
    FixtureRule,
    LimiterParameters,
    PlainConstraint,
    ReceivedConstraint,
    RulePermission,
    constraint_stream,
    limit_twist,
    plain_constraint,
    read_constraint,
)
from .margins import (
    Breach,
    MarginParameters,
    MarginState,
    Reason,
    find_breaches,
    margin_table,
    plot_margin,
)
from .meshes import Proximity, ProximityEngine, SurfaceMesh, load_mesh, signed_distance
from .registration import (
    PivotResult,
    RegistrationResult,
    calibrate_pivot,
    predict_tre,
    register_points,
)
from .scenes import save_scene
from .values import InputError, MarginGuardError, Transform

__version__: str

__all__ = [
    "Breach",
    "Constraint",
    "FixtureRule",
    "InputError",
    "LimiterParameters",
    "MarginGuardError",
    "MarginParameters",
    "MarginState",
    "PivotResult",
    "PlainConstraint",
    "PreparedCase",
    "Proximity",
    "ProximityEngine",
    "Reason",
    "ReceivedConstraint",
    "RegistrationResult",
    "RulePermission",
    "StepResult",
    "SurfaceMesh",
    "Transform",
    "__version__",
    "calibrate_pivot",
    "constraint_stream",
    "example_case",
    "find_breaches",
    "limit_twist",
    "load_mesh",
    "make_case",
    "margin_table",
    "open_case",
    "plain_constraint",
    "plot_margin",
    "predict_tre",
    "read_constraint",
    "register_points",
    "replay",
    "save_scene",
    "signed_distance",
    "write_case",
]
