"""The public names: all there, all documented, no parameter undocumented, no **kwargs."""

from __future__ import annotations

import inspect
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


@pytest.mark.parametrize(("name", "value"), list(public_callables()))
def test_is_documented(name: str, value: object) -> None:
    owner, _, member = name.partition(".")
    text = inspect.getdoc(getattr(getattr(wb, owner), member)) if member else inspect.getdoc(value)
    assert text, f"{name} has no docstring"
    # dataclasses without one get their signature as docstring
    assert not text.startswith(f"{owner}(")


def documented(owner: object) -> str:
    """Return the docstring; that of a class with those of the workbench's classes whose fields it inherits."""
    kinds = inspect.getmro(owner) if inspect.isclass(owner) else (owner,)
    return "\n".join(inspect.getdoc(k) or "" for k in kinds if k is owner or k.__module__.startswith("workbench"))


@pytest.mark.parametrize(("name", "value"), list(public_callables()))
def test_every_parameter_is_documented_and_none_is_swallowed(name: str, value: object) -> None:
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
    for parameter in inspect.signature(value).parameters.values():
        assert parameter.kind is not parameter.VAR_KEYWORD, f"{name} takes **{parameter.name}"
        if parameter.name not in {"self", "args"}:
            assert parameter.name in text, f"{name}: parameter {parameter.name} is not documented"


@pytest.mark.parametrize("name", [n for n in wb.__all__ if is_dataclass(getattr(wb, n))])
def test_every_field_is_documented(name: str) -> None:
    kind = getattr(wb, name)
    text = documented(kind)
    for field in fields(kind):
        if not field.name.startswith("_"):
            assert field.name in text, f"{name}: field {field.name} is not documented"


def test_names_are_sorted_and_found() -> None:
    assert sorted(wb.__all__) == wb.__all__
    assert set(wb.__all__) <= set(dir(wb))
    with pytest.raises(AttributeError, match="no attribute 'nosuch'"):
        _ = wb.nosuch  # type: ignore[attr-defined]


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = "import sys, workbench; sys.exit(any(m in sys.modules for m in ('numpy', 'matplotlib', 'control')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
