"""FMUs for the tests of linearisation: bundled where they are, built for this machine where not."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from tests.platforms import needs_module
from workbench.build.fmu import build_fmu
from workbench.core.values.arrays import Floats
from workbench.fmi.platforms import host

__all__ = ["built", "fmu", "sparse_system"]

ROOT = Path(__file__).parent.parent


@cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="tests-of-workbench-"))


@cache
def fmu(name: str) -> str:
    """Return the FMU of one of the project's models."""
    if (ROOT / "fmus" / "fmi2" / f"{name}.fmu").exists():
        return f"fmu:{name}"
    return built((ROOT / "modelica_src" / name / f"{name}.mo").read_text(encoding="utf-8"), name)


@cache
def built(source: str, name: str, fmi: int = 2) -> str:
    """Return the FMU of a Modelica text."""
    needs_module("rumoca", "build")
    file = _folder() / f"{name}.mo"
    file.write_text(source, encoding="utf-8")
    out = _folder() / f"{name}{fmi}.fmu"
    build_fmu([file], out=out, platforms=[host()], fmi=fmi)
    return str(out)


def sparse_system(n: int) -> tuple[str, Floats, Floats, Floats]:
    """Return a stable sparse system of n states, 2 inputs, 2 outputs as Modelica, and its A, B, C."""
    random = np.random.default_rng(71)
    A = -np.diag(random.uniform(1.0, 50.0, n))
    for i in range(n):
        for j in random.choice([k for k in range(n) if k != i], 3, replace=False):
            A[i, j] = random.uniform(-0.3, 0.3)
    B, C = np.zeros((n, 2)), np.zeros((2, n))
    B[0, 0], B[5, 1], C[0, 3], C[1, n - 1] = 2.0, -1.0, 1.5, 0.5
    lines = ["model Sparse", "  input Real u1(start = 0);", "  input Real u2(start = 0);"]
    lines += ["  output Real y1;", "  output Real y2;"]
    lines += [f"  Real x{i}(start = {0.1 * (i % 7)!r}, fixed = true, nominal = 1);" for i in range(n)]
    lines.append("equation")
    for i in range(n):
        terms = [f"({A[i, j]!r}) * x{j}".replace("np.float64", "") for j in np.flatnonzero(A[i])]
        terms += [f"({B[i, j]!r}) * u{j + 1}".replace("np.float64", "") for j in np.flatnonzero(B[i])]
        lines.append(f"  der(x{i}) = {' + '.join(terms)};")
    lines += ["  y1 = 1.5 * x3;", f"  y2 = 0.5 * x{n - 1};", "end Sparse;"]
    return "\n".join(lines), A, B, C
