"""Output arguments of calls, as VTK's Python wrapping gives them to C++ references."""

from typing import Any

from ROS2Lib.errors import Ros2Error


def set_output(target: Any, value: Any) -> bool:
    """Copy ``value`` into ``target``; False, and nothing is copied, if ``value`` is None.

    ``target`` is a `vtk.reference` for a number or a string, or a VTK object of the class of
    ``value``. Raises `Ros2Error` for any other.
    """
    if value is None:
        return False
    if hasattr(target, "set") and hasattr(target, "get"):
        target.set(value)
    elif hasattr(target, "DeepCopy") and target.IsA(value.GetClassName()):
        target.DeepCopy(value)
    else:
        raise Ros2Error(
            f"output argument is {type(target).__name__}; expected a vtk.reference or "
            f"{type(value).__name__}"
        )
    return True
