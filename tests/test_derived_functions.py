"""Functions that are derived from requests: what editors, notebooks and mypy know of their options and results.

`checked_by_mypy` is never called: `mypy --strict` refuses a `type: ignore` that hides no error, so that each of these
lines is an error with that code, and each `assert_type` holds.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from typing import Any, assert_type

import numpy as np
import pytest

import workbench as wb
from workbench.commands import COMMANDS, requests_of
from workbench.core.records.option import DeclaredOption, Options, options_of
from workbench.errors import InputError
from workbench.requests.request import Request

FUNCTIONS = {name: value for name in wb.__all__ if inspect.isfunction(value := getattr(wb, name))}


def requests(kind: type[Any] = Request) -> list[type[Any]]:
    """Every request that a public function runs; the functions are imported above."""
    below = [c for sub in kind.__subclasses__() for c in (sub, *requests(sub))]
    return [c for c in below if called(c) in FUNCTIONS and c.algorithm]


def called(kind: type[Any]) -> str:
    """Name of a request's function."""
    return str(kind.called or vars(kind).get("command", "").replace("-", "_"))


def checked_by_mypy(model: wb.Model) -> None:
    assert_type(wb.nfr(model, "u", "y", band=(0.5, 20), amplitudes=[1, 4]), wb.NfrResult)
    assert_type(wb.simulate(model, stop=2.0, inputs={"u": wb.Step(time=0.1, value=1.0)}), wb.SimulationResult)
    assert_type(wb.lin(model, inputs=["u"]), wb.LinearModel)
    assert_type(wb.delays(model), wb.DelayReport | wb.NoDelays)
    assert_type(wb.check("x.fmu", only=["step"]), wb.HealthCard)
    wb.nfr(model, "u", "y", bnd=(0.5, 20))  # type: ignore[call-arg]
    wb.nfr(model, "u")  # type: ignore[call-arg]
    wb.nfr(model, "u", "y", ratio="wide")  # type: ignore[arg-type]
    wb.simulate(model, stop="2 s")  # type: ignore[arg-type]
    wb.trim(model, u0=["u"])  # type: ignore[arg-type]
    wb.load("x.fmu", toleranc=1e-8)  # type: ignore[call-arg]


@pytest.mark.parametrize("kind", requests(), ids=lambda c: c.__name__)
def test_signature_has_the_options_and_the_result(kind: type[Any]) -> None:
    signature = inspect.signature(FUNCTIONS[called(kind)])
    assert list(signature.parameters)[1:] == [d.name for d in options_of(kind)]
    for part in (str(signature.return_annotation)).split(" | "):
        assert inspect.isclass(getattr(wb, part))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_has_annotations(name: str) -> None:
    signature = inspect.signature(FUNCTIONS[name])
    named = {p.name: p.annotation for p in signature.parameters.values()}
    assert FUNCTIONS[name].__annotations__ == {**named, "return": signature.return_annotation}
    assert inspect.Parameter.empty not in FUNCTIONS[name].__annotations__.values()


def test_what_a_function_does_not_know_is_told_with_its_name() -> None:
    with pytest.raises(TypeError, match=r"^load\(\) has no parameter 'tolerence'; did you mean tolerance"):
        wb.load("fmu:Rudder", tolerence=1e-8)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"^nfr\(\) missing a required argument: 'output'$"):
        wb.nfr(wb.load, "u")  # type: ignore[arg-type, call-arg]
    with pytest.raises(TypeError, match=r"^nfr\(\) has no parameter 'amplitud'; did you mean amplitudes"):
        wb.nfr(wb.load, amplitud=1)  # type: ignore[arg-type, call-arg]
    placed = r"model, input, output, frequencies, amplitudes"
    with pytest.raises(TypeError, match=rf"^nfr\(\) takes 5 arguments by position \({placed}\), not 6"):
        wb.nfr(wb.load, "u", "y", 1.0, 1.0, 2.0)  # type: ignore[arg-type, call-arg]


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("small", "errcrit: 'small' is not a number"),
        (-1.0, "errcrit: -1 is not a positive number"),
        (math.inf, "errcrit: inf is not a positive finite number"),
    ],
)
def test_what_is_no_number_in_the_range_is_told(value: float, says: str) -> None:
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(InputError) as told:
        wb.nfr(model, "u", "y", [1.0], [1.0], errcrit=value)
    assert str(told.value) == says


def test_a_number_is_needed_for_an_option_without_a_range_too() -> None:
    with wb.load("fmu:FirstOrderLag") as model, pytest.raises(InputError, match=r"interval: 'x' is not a number \[s\]"):
        wb.simulate(model, stop=1.0, interval="x")  # type: ignore[arg-type]


def declared(kind: type[Options]) -> Iterator[DeclaredOption]:
    """Every option of a request, and of the parts that it is made of."""
    for option in options_of(kind):
        part = option.option.part or option.type
        if inspect.isclass(part) and issubclass(part, Options):
            yield from declared(part)
        else:
            yield option


def numeric(option: DeclaredOption) -> bool:
    signal = option.form is not None and option.form.metavar == "NAME=SIGNAL"  # told with the input, as files are
    return option.form is not None and not signal and not {"number", "integer"}.isdisjoint(option.form.items)


COMMANDED = [request for name in COMMANDS for request in requests_of(name)]


def refused(option: DeclaredOption, value: object) -> bool:
    try:
        option.checked(value)
    except InputError as error:
        return str(error).startswith(option.name)
    return False


@pytest.mark.parametrize("kind", COMMANDED, ids=lambda c: c.__name__)
def test_no_option_takes_what_is_no_number(kind: type[Options]) -> None:
    """NaN is none, True is none where no switch can be meant, and ∞ where nothing is said of it."""
    for option in filter(numeric, declared(kind)):
        assert option.form is not None
        wrong = [math.nan, *([] if "boolean" in option.form.items else [True])]
        wrong += [] if option.option.infinite or option.form.infinite else [math.inf, -math.inf]
        for value in wrong:
            for given in (value, np.array(value), [value], [1.0, value], (value,), {"u": value}, {"u": [1.0, value]}):
                assert refused(option, given), f"{kind.__name__}.{option.name}: {given!r}"


def test_infinity_is_taken_where_it_means_something() -> None:
    taken = {o.name for kind in COMMANDED for o in filter(numeric, declared(kind)) if not refused(o, math.inf)}
    assert taken == {"timeout", "memory_limit"}
