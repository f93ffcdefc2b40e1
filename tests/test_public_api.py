"""The public names: all there, all documented, no parameter undocumented, no **kwargs."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass

import pytest

import workbench as wb

# Classes that the workbench alone makes: exceptions, and the model that `load` returns.
MADE_ELSEWHERE = [
    wb.WorkbenchError, wb.InputError, wb.FmuError, wb.SimulationError, wb.BuildError, wb.FmuModel,
]  # fmt: skip


def public_callables() -> Iterator[tuple[str, object]]:
    for name in wb.__all__:
        value = getattr(wb, name)
        yield name, value
        if inspect.isclass(value):
            for member, function in inspect.getmembers(value, inspect.isfunction):
                # What python-control's classes bring along is documented there.
                if not member.startswith("_") and function.__module__.startswith("workbench"):
                    yield f"{name}.{member}", function


def undescribed(name: str, value: object) -> bool:
    owner, _, member = name.partition(".")
    text = inspect.getdoc(getattr(getattr(wb, owner), member)) if member else inspect.getdoc(value)
    # dataclasses without one get their signature as docstring
    return not text or text.startswith(f"{owner}(")


def test_everything_is_documented() -> None:
    known = list(public_callables())
    assert len(known) > 500
    assert [name for name, value in known if undescribed(name, value)] == []


def documented(owner: object) -> str:
    """Return the docstring; that of a class with those of the workbench's classes whose fields it inherits."""
    kinds = inspect.getmro(owner) if inspect.isclass(owner) else (owner,)
    return "\n".join(inspect.getdoc(k) or "" for k in kinds if k is owner or k.__module__.startswith("workbench"))


SECTION = re.compile(r"^(?:Args|Attributes):\n((?:[ \t]+\S.*\n|\s*\n)*)", re.MULTILINE)
ENTRY = re.compile(r"^    ((?:\w+, )*\w+): +\S", re.MULTILINE)


def names_in(text: str) -> set[str]:
    """Return the names that have an entry of their own under Args or Attributes: "one, other: what they are"."""
    entries = [e for section in SECTION.findall(f"{text}\n") for e in ENTRY.findall(section)]
    return {name for entry in entries for name in entry.split(", ")}


def test_a_name_in_passing_documents_nothing() -> None:
    text = """Take `model` and stop.

    More of time.

    Args:
        frequency, amplitude: of the sine,
            phase: not this one.
        stop: end of the run.

    Raises:
        InputError: bad.
    """
    assert names_in(inspect.cleandoc(text)) == {"frequency", "amplitude", "stop"}


def gaps(name: str, value: object) -> Iterator[str]:
    """Yield the parameters that have no entry, and those that swallow any name."""
    if (
        not callable(value)
        or inspect.isabstract(value)
        or getattr(value, "__name__", "") in {made.__name__ for made in MADE_ELSEWHERE}
    ):
        return
    owner = getattr(wb, name.partition(".")[0])
    text = (inspect.getdoc(value) or "") + "\n" + documented(owner)
    if "." in name:
        # An inherited method is documented where it is first defined.
        text = inspect.getdoc(getattr(owner, name.partition(".")[2])) or ""
    known = names_in(text)
    for parameter in inspect.signature(value).parameters.values():
        if parameter.kind is parameter.VAR_KEYWORD:
            yield f"{name}: **{parameter.name}"
        elif parameter.name not in {"self", "args"} and parameter.name not in known:
            yield f"{name}: {parameter.name}"


def test_every_parameter_is_documented_and_none_is_swallowed() -> None:
    assert [gap for name, value in public_callables() for gap in gaps(name, value)] == []


def test_every_field_is_documented() -> None:
    kinds = [(name, kind) for name in wb.__all__ if is_dataclass(kind := getattr(wb, name))]
    assert len(kinds) > 50
    missing = [
        f"{name}: {field.name}"
        for name, kind in kinds
        for field in fields(kind)
        if not field.name.startswith("_") and field.name not in names_in(documented(kind))
    ]
    assert missing == []


def test_names_are_sorted_and_found() -> None:
    assert sorted(wb.__all__) == wb.__all__
    with pytest.raises(AttributeError, match="no attribute 'nosuch'"):
        _ = wb.nosuch  # type: ignore[attr-defined]


def test_dir_lists_what_a_person_writes_and_not_what_is_returned() -> None:
    listed = {name for name in dir(wb) if not name.startswith("_")}
    made = {name for name in wb.__all__ if name[0].islower() or name.endswith("Error")}
    assert made | {"Step", "Sine", "Model", "OperatingPoint"} <= listed < set(wb.__all__)
    returned = {n for n in wb.__all__ if hasattr(getattr(wb, n), "to_csv") and hasattr(getattr(wb, n), "plot")}
    assert len(returned) > 20
    assert listed & returned <= {"Experiment", "Linear", "Response"}


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = "import sys, workbench; sys.exit(any(m in sys.modules for m in ('numpy', 'matplotlib', 'control')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_every_function_says_what_it_returns() -> None:
    plain = [(n, f) for n, f in public_callables() if inspect.isfunction(f)]
    assert [n for n, f in plain if inspect.signature(f).return_annotation in {"", inspect.Signature.empty}] == []
