"""Units of rates, as FMUs write them."""

import pytest

from workbench.core.values.conversion import named_conversion, rate_unit


@pytest.mark.parametrize(
    ("unit", "rate"),
    [
        ("1", "1/s"), ("m", "m/s"), ("m/s", "m/s2"), ("1/s", "1/s2"), ("rad/s2", "rad/s3"), ("m / s", "m/s2"),
        ("kg.m2", "kg.m2/s"), ("A/m", "(A/m)/s"), ("kg/ms", "(kg/ms)/s"), (None, None), ("", None),
    ],
)  # fmt: skip
def test_the_unit_of_a_rate(unit: str | None, rate: str | None) -> None:
    assert rate_unit(unit) == rate


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("Nm", "N.m", 1.0), ("Nms/rad", "N.m.s/rad", 1.0), ("kNm", "N.m", 1e3), ("Ws", "J", 1.0),
        ("ms", "s", 1e-3),  # what can be read plainly is
        ("mNm", "N.m", None), ("Nmm", "N.m", None), ("degC/W", "K/W", None),  # read in two ways, or in none
    ],
)  # fmt: skip
def test_a_product_without_points_is_read_where_it_can_be_one_thing_only(
    source: str, target: str, factor: float | None
) -> None:
    found = named_conversion(source, target)
    assert (None if found is None else found[0]) == (None if factor is None else pytest.approx(factor))
