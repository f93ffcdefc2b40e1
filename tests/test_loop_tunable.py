"""A loop with its blocks taken out, put together again with other parameters: the loop that is linearised with them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import workbench as wb
from workbench.errors import InputError
from workbench.loops.loop.tunable import tunable_loop

FREQUENCY = np.geomspace(0.01, 100.0, 40)  # [Hz]

# Kind → parameters, others, and the transfer function with the others at s, by the equations of the kind.
KINDS: Mapping[str, tuple[dict[str, Any], dict[str, float], Any]] = {
    "pi": ({"proportional": 2.0, "integral": 3.0}, {"integral": 5.0}, lambda s: 2.0 + 5.0 / s),
    "pid": (
        {"derivative": 0.2, "filter": 0.05}, {"proportional": 4.0, "derivative": 0.3},
        lambda s: 4.0 + 1.0 / s + 0.3 * s / (0.05 * s + 1.0),
    ),
    "integrator": ({"gain": 2.0}, {"gain": 0.5}, lambda s: 0.5 / s),
    "lead_lag": ({"lead": 0.2, "lag": 0.01}, {"lead": 0.5, "gain": 3.0}, lambda s: 3 * (0.5 * s + 1) / (0.01 * s + 1)),
    "notch": (
        {"frequency": 2.0}, {"depth": 0.1, "width": 0.2},
        lambda s: (s**2 + 0.04 * 4.0 * np.pi * s + (4.0 * np.pi) ** 2)
        / (s**2 + 0.4 * 4.0 * np.pi * s + (4.0 * np.pi) ** 2),
    ),
    "biquad": (
        {"pole_frequency": 4.0}, {"gain": 3.0, "zero_damping": -0.1, "zero_frequency": 2.0, "pole_damping": 0.6},
        lambda s: 3.0 * (s**2 / (4.0 * np.pi) ** 2 - 0.2 * s / (4.0 * np.pi) + 1.0)
        / (s**2 / (8.0 * np.pi) ** 2 + 1.2 * s / (8.0 * np.pi) + 1.0),
    ),
}  # fmt: skip


def around(block: wb.BlockComponent, gain: float = 2.0) -> Any:  # noqa: ANN401 - a system
    return wb.connect(
        {
            "lag": "fmu:FirstOrderLag",
            "gain": gain,
            "block": block,
            "error": wb.SumComponent(name="error", signs=(1, -1)),
        },
        [("lag.y", "error.u2"), ("error.y", "block.u"), ("block.y", "gain.u"), ("gain.y", "lag.u")],
        inputs={"reference": "error.u1"},
    )


@pytest.mark.parametrize("kind", KINDS)
def test_other_parameters_give_the_loop_that_their_equations_say(kind: str) -> None:
    given, other, transfer = KINDS[kind]
    with around(wb.BlockComponent(name="block", kind=kind, parameters=given)) as system:
        tunable = tunable_loop(system, "lag.y", in_process=True)
    assert set(tunable.blocks) == {"gain", "block"}
    s = 2j * np.pi * FREQUENCY
    found = tunable.loop({"gain.gain": 7.0, **{f"block.{name}": value for name, value in other.items()}})
    np.testing.assert_allclose(found.response(FREQUENCY), 7.0 * transfer(s) / (s + 1.0), rtol=1e-9)


def test_unchanged_it_is_the_loop_itself() -> None:
    # Opened elsewhere, and with a limiter that is linearised where it stands.
    with wb.load("system:rudder_loop") as system:
        tunable = tunable_loop(system, "gain.y", in_process=True)
        linear = wb.loop(system, "gain.y", in_process=True).linear
    assert linear is not None
    np.testing.assert_allclose(
        tunable.loop({}).response(FREQUENCY), linear.transfer.response(FREQUENCY), rtol=1e-9, atol=1e-12
    )


def test_what_cannot_be_is_refused() -> None:
    block = wb.BlockComponent(name="block", kind="saturation", parameters={"lower": -1.0, "upper": 1.0})
    with around(block) as system:
        tunable = tunable_loop(system, "lag.y", in_process=True)
    assert tunable.blocks == ("gain",)
    for name, words in (
        ("block.upper", "not a parameter of a linear block"),
        ("gain.k", "'k' is not a parameter"),
        ("nothing", "not a parameter of a linear block"),
    ):
        with pytest.raises(InputError, match=words):
            tunable.loop({name: 2.0})
