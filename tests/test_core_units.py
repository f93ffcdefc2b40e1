"""Units of rates, as FMUs write them."""

import pytest

from workbench.core.values.conversion import rate_unit


@pytest.mark.parametrize(
    ("unit", "rate"),
    [
        ("1", "1/s"), ("m", "m/s"), ("m/s", "m/s2"), ("1/s", "1/s2"), ("rad/s2", "rad/s3"), ("m / s", "m/s2"),
        ("kg.m2", "kg.m2/s"), ("A/m", "(A/m)/s"), ("kg/ms", "(kg/ms)/s"), (None, None), ("", None),
    ],
)  # fmt: skip
def test_the_unit_of_a_rate(unit: str | None, rate: str | None) -> None:
    assert rate_unit(unit) == rate
