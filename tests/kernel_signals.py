"""Random signals, as strategies of hypothesis."""

from __future__ import annotations

from hypothesis import strategies as st

from workbench.signals.kinds import Constant, Prbs, Signal, Sine, Step, Table

__all__ = ["signals"]


def _floats(low: float, high: float) -> st.SearchStrategy[float]:
    # Few digits: examples that shrink are readable, and nothing lies nearer to another thing than solvers can see.
    return st.integers(0, 1000).map(lambda k: round(low + (high - low) * k / 1000, 6))


@st.composite
def _tables(draw: st.DrawFn, span: float) -> Signal:
    steps = draw(st.lists(st.sampled_from([0.0, 0.03, 0.1, 0.25]), min_size=0, max_size=8))
    times = [draw(_floats(0.0, span / 2))]
    for step in steps:
        times.append(times[-1] + step)
    values = draw(st.lists(_floats(-2.0, 2.0), min_size=len(times), max_size=len(times)))
    return Table(times, values, draw(st.sampled_from(["linear", "hold"])))


def signals(span: float = 5.0) -> st.SearchStrategy[Signal]:
    """Return a strategy for signals with something going on in 0 … span [s]."""
    size = _floats(-2.0, 2.0)
    sines = st.builds(
        Sine, amplitude=size, frequency=_floats(0.5 / span, 20.0 / span), phase=_floats(-400.0, 400.0), offset=size
    )
    bits = st.builds(
        Prbs,
        hold=st.sampled_from([span / 8, span / 20, 0.1]),
        amplitude=size,
        offset=size,
        order=st.integers(2, 9),
        seed=st.integers(1, 3),
        start=st.sampled_from([0.0, 0.05, -0.3]),
    )
    steps = st.builds(Step, time=_floats(0.0, span), value=size, initial=size)
    return st.one_of(st.builds(Constant, size), sines, steps, bits, _tables(span))
