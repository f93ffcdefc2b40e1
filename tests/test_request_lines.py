"""Every request can be written as a command line, which reads it back as an equal request."""

from __future__ import annotations

import math
import random
import shlex
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

from workbench.cli.derive import command, meant
from workbench.cli.program import program
from workbench.commands import REQUESTS, request_of, requests_of
from workbench.core.records.forms import of_type
from workbench.core.records.option import DeclaredOption, asked_of, put_together, recast
from workbench.data.excite.signals import MultisineDesign, PrbsDesign
from workbench.errors import InputError
from workbench.jobs.options import Workers
from workbench.model.loading import Loading
from workbench.point.lin.request import Lin
from workbench.requests.request import Request, Subject, asked_options, command_line_of, request_from
from workbench.response.nfr.request import Nfr
from workbench.response.simulate.request import Simulate
from workbench.signals.gusts import gust
from workbench.signals.kinds import Constant, Prbs, Signal, Sine, Step, Table, pulse
from workbench.signals.text import parse_signal, signal_text

NAMES = ("u", "plant.y[2]", "side stick", "x_1")


def number(chance: random.Random) -> float:
    return chance.choice([chance.uniform(0.1, 9.9), 10.0 ** chance.randint(-12, 12), chance.random() / 3.0, 2.0])


def rising(chance: random.Random) -> tuple[float, float]:
    low, high = sorted((number(chance), number(chance) + 1e-9))
    return low, high + 1.0


def signal(chance: random.Random) -> Signal:
    a, b = number(chance), number(chance)
    return chance.choice([
        Constant(-a), Sine(frequency=a, amplitude=b, phase=-30.0), Step(time=a, value=-b, initial=1e-7),
        Prbs(hold=a, amplitude=b, order=9, seed=3), pulse(time=a, value=b, duration=0.1), gust(value=-a, duration=b),
        Table([0.0, 1.0, 1.0, 2.5], [0.0, a, -b, 3.0], "hold"),
    ])  # fmt: skip


def named(value: Callable[[random.Random], Any]) -> Callable[[random.Random], Any]:
    return lambda chance: {name: value(chance) for name in chance.sample(NAMES[:2], 2)}


# What --help shows in place of the value → a value.
VALUES: dict[str, Callable[[random.Random], Any]] = {
    "A,..": lambda c: [number(c) for _ in range(3)],
    "A": lambda c: c.choice([number(c), f"{number(c)!r} rad"]),
    "LO:HI": rising,
    "NAME,..": lambda c: c.sample(NAMES, 2),
    "[NAME=]WIDTH": lambda c: c.choice([number(c), [number(c), number(c)], {"x": number(c)}]),
    "NAME=LO:HI": named(rising),
    "NAME[=LO:HI]": lambda c: {"u": rising(c), "plant.y[2]": (-math.inf, math.inf)},
    "NAME[=COLUMN]": lambda c: {name: name if c.random() < 0.5 else "col" for name in NAMES[:2]},
    "NAME=A,B,..": named(lambda c: [number(c), number(c)]),
    "NAME=A,B,..|LO:HI": named(lambda c: [number(c), number(c)]),
    "NAME=VALUE": named(number),
    "NAME=VALUE,..": lambda c: [named(number)(c), {"on": True, "mode": "fast", "n": 3}],
    "NAME=SIGNAL": named(signal),
    "BEGIN:END": lambda c: [(0.0, number(c)), rising(c)],
    "TEXT": lambda c: c.sample(["one, two", *NAMES], 2),
    "PATH": lambda _: "some folder/file.json",
    "MODEL": lambda c: c.choice(["fmu:LimitedActuator", "some folder/actuator.fmu"]),
    "auto|N|ask": lambda c: c.choice(["auto", 4]),
    "auto|N": lambda c: c.choice(["auto", 3]),
    "auto|shared|N": lambda c: c.choice(["auto", "shared", 2]),
    "DATA,..": lambda _: ("some folder/one.csv", "two.csv"),
    "auto|N,..": lambda c: c.choice(["auto", 2, [1, 2]]),
    "PLANT.Y": lambda c: c.choice(["plant.y", "plant.y -> controller.u"]),
    "X": lambda c: c.choice(["25deg", "3.5"]),
    "NAME:GAIN": lambda c: ("plant.y", -number(c)),
    "G,H": lambda c: (c.randint(1, 40), c.randint(1, 40)),
}
# Options of which few values make sense.
SPECIAL: dict[str, Callable[[random.Random], Any]] = {
    "prbs": lambda c: PrbsDesign(amplitude=number(c), rate=number(c), seed=4),
    "multisine": lambda c: MultisineDesign(amplitude=number(c), band=(0.5, 20.0), lines="odd"),
    "methods": lambda _: ("shooting", "harmonic balance"),
    "redo": lambda _: ("failed",),
    "vary": lambda _: "airspeed=150:350",
    "jobs": lambda c: c.randint(1, 8),
    "scheduler": lambda _: None,
    "tls": lambda _: None,
    "in_process": lambda _: False,
}


def value_of(request: str, declared: DeclaredOption, chance: random.Random) -> object:
    """Return a random value of an option."""
    if declared.name in SPECIAL and (request, declared.name) != ("limit-cycle", "vary"):
        return SPECIAL[declared.name](chance)
    if declared.choices:
        return chance.choice(declared.choices)
    if declared.form is not of_type(declared.type):
        assert declared.form is not None
        return VALUES[declared.form.metavar](chance)
    if declared.type is bool:
        return chance.random() < 0.5
    return {int: chance.randint(2, 50), str: chance.choice(NAMES)}.get(declared.type, number(chance))


def asked_at_random(name: str, chance: random.Random) -> tuple[Request[Any, Any], Loading]:
    """Return a request, and how its model is opened."""
    request, share = request_of(name), 0.6
    for _ in range(2000):
        options = {n: d for n, (d, _) in asked_options(request).items() if d.required or chance.random() < share}
        try:
            values = {n: declared.checked(value_of(name, declared, chance)) for n, declared in options.items()}
            return put_together(request, values), request.loading(values)
        except InputError:  # out of its range, or options that exclude each other
            share *= 0.98
    raise AssertionError(f"no values of {name} are accepted")


SUBJECTS = {"build": "a model.mo", "export": "a model.json", "fit": "a response.json"}


@pytest.mark.parametrize("name", REQUESTS)
@pytest.mark.parametrize("seed", range(8))
def test_a_line_is_read_back_as_the_same_request(name: str, seed: int) -> None:
    asked, loading = asked_at_random(name, random.Random(f"{name} {seed}"))
    subject, command = SUBJECTS.get(name, "a model.fmu"), asked.command
    words = shlex.split(command_line_of(asked, subject, loading))
    assert words[:3] == ["workbench", command, subject]
    others = [subject] if name == "compare" else []
    own = request_of(name) if command == "run" else None  # `run` alone is a function
    given = program(command, own).make_context(command, [*words[2:], *others]).params
    request, _ = meant(requests_of(command), given)
    assert request is type(asked)
    again, opened = request_from(request, {k: v for k, v in given.items() if v not in ([], ())})
    assert asked_of(again) == asked_of(asked)
    assert asked_of(opened) == asked_of(loading)
    for key, value in vars(asked).items():
        assert same(getattr(again, key), value), key


def same(one: object, other: object) -> bool:
    """Whether two values are equal; parts of options by what is asked of them."""
    if hasattr(one, "__dataclass_fields__") and hasattr(other, "__dataclass_fields__"):
        return one == other or vars(one) == vars(other)
    return one == other or (not one and not other) or str(one) == str(other)


@pytest.mark.parametrize("seed", range(30))
def test_the_text_of_a_signal_is_read_back(seed: int) -> None:
    wanted = signal(random.Random(seed))
    assert parse_signal(signal_text(wanted)) == wanted


class OnSeveral(Request[list[str], "object"]):
    """Work on several files."""

    command = "on-several"
    algorithm = "tests.test_request_lines:tell_subject"
    example = "workbench on-several a.mo b.mo"
    subject = Subject(name="sources", type="list[str]", help="Files.", metavar="FILE..", words="Files.", several=True)


def tell_subject(subject: list[str], asked: OnSeveral, job: object) -> object:
    raise InputError(f"{asked.command}: {subject}")


@pytest.mark.parametrize("files", [["a.mo"], ["a.mo", "b c.mo"]])
def test_a_request_on_several_files_gets_them_in_order(files: list[str]) -> None:
    with pytest.raises(InputError) as told:
        command([OnSeveral]).main(files, "on-several", standalone_mode=False)
    assert str(told.value) == f"on-several: {files}"


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"max_periods": 2.5}, "max_periods: 2.5 is not a whole number"),
        ({"carry": "false"}, "carry: 'false' is not True or False"),
        ({"errcrit": True}, "errcrit: True is not a number"),
    ],
)
def test_python_refuses_what_a_command_line_cannot_say(option: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Nfr("u", "y", frequencies=1.0, amplitudes=1.0, **option)


def test_python_refuses_a_list_of_names_for_one_name() -> None:
    with pytest.raises(InputError, match=r"output: \['y'\] is not a text; give one, in quotes"):
        Nfr("u", cast("str", ["y"]), frequencies=1.0, amplitudes=1.0)


@pytest.mark.parametrize("one", [np.float64(1), np.float32(1), np.int64(1), np.array(1.0)])
def test_an_option_takes_numpy_scalars_as_the_numbers_that_they_are(one: float) -> None:
    for make in (
        lambda x: Simulate(stop=x, inputs={"u": x}),
        lambda x: Lin(dx=x, du={"u": x}, u0={"u": x}),
        lambda x: Nfr("u", "y", frequencies=x, amplitudes=x, errcrit=0.5 * x, carry=cast("bool", np.bool_(x))),
    ):
        assert asked_of(make(one)) == asked_of(make(1.0))


def test_another_request_takes_no_option_that_it_has_not() -> None:
    with pytest.raises(TypeError, match="Workers has no option 'time_out'; did you mean timeout"):
        recast(Workers, Workers(), time_out=3.0)
    assert recast(Workers, Workers(), timeout=3.0).timeout == 3.0
