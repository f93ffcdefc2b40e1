"""FMUs of any size whose answers are known: a rod, a chain of masses; built for this machine, tests/c/large."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tests.stub_fmus import write_stub

__all__ = ["GAIN", "INTEGRAL", "build_large", "build_loop", "depends_of"]

GAIN, INTEGRAL = 1.0, 0.5  # of the controller


def depends_of(kind: str, n: int) -> list[list[int]]:
    """Return the states on which each derivative depends, as the description says it."""
    if kind in ("rod", "lying"):
        return [[j for j in (i - 1, i, i + 1) if 0 <= j < n] for i in range(n)]
    half = n // 2
    springs = [[j for j in (i - 1, i, i + 1) if 0 <= j < half] + [half + i] for i in range(half)]
    return [[half + i] for i in range(half)] + springs


def _variable(name: str, reference: int, inner: str, more: str = "") -> str:
    return f'<ScalarVariable name="{name}" valueReference="{reference}" {more}>{inner}</ScalarVariable>'


def _unknown(index: int, depends: Sequence[int] | None) -> str:
    said = "" if depends is None else f' dependencies="{" ".join(map(str, depends))}"'
    return f'<Unknown index="{index}"{said}/>'


def build_large(folder: Path, kind: str, n: int, *, dependencies: bool = True, directional: bool = True) -> Path:
    """Write ``folder/KIND-N.fmu``: "rod", "chain", "cubic" or "lying" with n states, input u, output y.

    Args:
        folder: where.
        kind: of model.
        n: number of states.
        dependencies: whether the description says what the derivatives depend on.
        directional: whether it says that there are directional derivatives.
    """
    names = [f"T[{i + 1}]" for i in range(n)]
    if kind not in ("rod", "lying"):
        names = [f"{letter}[{i + 1}]" for letter in "qv" for i in range(n // 2)]
    states = "".join(
        _variable(name, 2 + i, '<Real start="0" nominal="1"/>', 'initial="exact"') for i, name in enumerate(names)
    )
    rates = "".join(
        _variable(f"der({name})", 2 + n + i, f'<Real derivative="{3 + i}"/>') for i, name in enumerate(names)
    )
    known = depends_of(kind, n)
    first = 0 if kind in ("rod", "lying") else n // 2  # the derivative that the input moves
    entries = [[*(3 + j for j in states), *([1] if i == first else [])] for i, states in enumerate(known)]
    derivatives = "".join(
        _unknown(3 + n + i, sorted(entry) if dependencies else None) for i, entry in enumerate(entries)
    )
    last = n if kind in ("rod", "lying") else n // 2
    unknown = "".join(_unknown(3 + n + i, None) for i in range(n))
    xml = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{kind}" guid="{{large-{kind}-{n}}}" numberOfEventIndicators="0">
<ModelExchange modelIdentifier="large" canGetAndSetFMUstate="true"
 providesDirectionalDerivative="{str(directional).lower()}"/>
<ModelVariables>{_variable("u", 0, '<Real start="0"/>', 'causality="input"')}{
        _variable("y", 1, "<Real/>", 'causality="output"')
    }{states}{rates}</ModelVariables>
<ModelStructure><Outputs>{_unknown(2, [2 + last] if dependencies else None)}</Outputs>
<Derivatives>{derivatives}</Derivatives><InitialUnknowns>{_unknown(2, None)}{unknown}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
    return write_stub(folder / f"{kind}-{n}.fmu", "large", xml)


def build_loop(rod: Path, actuator: str = "fmu:FirstOrderLag") -> Path:
    """Write a system file beside an FMU of input u and output y: r → (+) → PI controller → actuator → it, y fed back.

    Args:
        rod: the FMU.
        actuator: another one.
    """
    file = rod.with_name(f"loop-{rod.stem}.toml")
    matrices = f"A = [[0]], B = [[1]], C = [[{INTEGRAL}]], D = [[{GAIN}]]"
    file.write_text(
        f"""name = "loop"
[components]
error = {{sum = "+-"}}
controller = {{{matrices}, inputs = ["e"], outputs = ["u"], states = ["i"]}}
actuator = "{actuator}"
rod = "{rod.name}"
[connections]
"error.u2" = "rod.y"
"controller.e" = "error.y"
"actuator.u" = "controller.u"
"rod.u" = "actuator.y"
[inputs]
r = "error.u1"
[outputs]
y = "rod.y"
u = "controller.u"
""",
        encoding="utf-8",
    )
    return file
