"""Conversion of parameter values, compared with rclpy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.parameter import Parameter

from app.bridge.calls.parameter_server import parameter_value, plain_value

pytestmark = pytest.mark.slow

INTEGERS = st.integers(-(2**63), 2**63 - 1)
SCALARS = (st.booleans(), INTEGERS, st.floats(allow_nan=False), st.text())
VALUES = st.one_of(
    st.none(),
    st.binary(),
    *SCALARS,
    *(st.lists(scalar, min_size=1).map(tuple) for scalar in SCALARS),
)


@given(VALUES)
def test_value_converted_there_and_back_is_equal(value):
    back = plain_value(parameter_value(value))
    assert back == value
    assert type(back) is type(value)


@given(VALUES)
def test_rclpy_reads_the_same_value(value):
    from rcl_interfaces.msg import Parameter as Message

    read = Parameter.from_parameter_msg(Message(name="x", value=parameter_value(value))).value
    if isinstance(value, bytes):
        read = b"".join(read)
    elif isinstance(value, tuple):
        read = tuple(read)
    assert read == value


def test_integers_among_floats_become_floats():
    assert plain_value(parameter_value([1, 2.5])) == (1.0, 2.5)


@pytest.mark.parametrize("kind", [10, 255])
def test_unknown_parameter_type_is_refused(kind):
    from rcl_interfaces.msg import ParameterValue

    from app.bridge.convert import ConversionError

    with pytest.raises(ConversionError, match=str(kind)):
        plain_value(ParameterValue(type=kind))
