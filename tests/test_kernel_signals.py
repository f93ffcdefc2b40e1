"""Signals in compiled code are those of Python, to the last bit."""

from __future__ import annotations

import ctypes
import math

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tests.kernel_signals import signals
from workbench.kernel.library import kernel
from workbench.kernel.native_signals import Trouble, native_signal
from workbench.signals.kinds import Prbs, Signal, Sine, Table

TIMES = st.one_of(
    st.floats(-5.0, 50.0),
    st.integers(-50, 500).map(lambda k: k * 0.1),  # borders of bits and tables
    st.integers(-50, 500).map(lambda k: math.nextafter(k * 0.1, math.inf)),
    st.integers(-50, 500).map(lambda k: math.nextafter(k * 0.1, -math.inf)),
)


def in_c(signal: Signal, t: float) -> tuple[float, float]:
    native, _kept = native_signal(signal, Trouble())
    address = ctypes.addressof(native)
    return kernel().kernel_signal_value(address, t), kernel().kernel_signal_next_break(address, t)


@settings(max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(signals(), TIMES)
@example(Prbs(hold=0.1, order=3), 0.30000000000000004)
@example(Table([0.0, 1.0, 1.0, 2.0], [0.0, 1.0, 5.0, 2.0]), 1.0)
@example(Table([0.0], [3.0], interpolate="hold"), -1.0)
@example(Sine(frequency=1e3, phase=-720.0), 49.99)
def test_equal_to_the_last_bit(signal: Signal, t: float) -> None:
    assert in_c(signal, t) == (signal(t), signal.next_break(t))


class Ramp(Signal):
    """What the kernel does not know."""

    def __call__(self, t: float) -> float:
        if t > 1.0:
            message = "too late"
            raise ValueError(message)
        return 2.0 * t

    def next_break(self, t: float) -> float:
        return 0.5 if t < 0.5 else math.inf


def test_a_signal_of_the_users_own_is_called_back() -> None:
    assert in_c(Ramp(), 0.25) == (0.5, 0.5)
    trouble = Trouble()
    native, _kept = native_signal(Ramp(), trouble)
    assert math.isnan(kernel().kernel_signal_value(ctypes.addressof(native), 2.0))
    with pytest.raises(ValueError, match="too late"):
        trouble.check()
    trouble.check()
