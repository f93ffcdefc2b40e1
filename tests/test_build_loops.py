"""Loops in generated C: the numbers are those of the same equations written one by one."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from workbench.build import loops
from workbench.build.expressions import TANGENT, VARIABLE, ExpressionGraph
from workbench.build.fmu import build_fmu
from workbench.build.loops import LEAST, Shapes, alike_together
from workbench.build.toolchain import host_only

SOURCE = Path(__file__).parent / "modelica" / "Loops.mo"


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The model with loops, and without."""
    folder, platforms = tmp_path_factory.mktemp("loops"), [p.name for p in host_only()]
    with pytest.MonkeyPatch.context() as patch:
        looped = build_fmu([SOURCE], out=folder / "looped.fmu", platforms=platforms)
        patch.setattr(loops, "LEAST", 1_000_000)
        single = build_fmu([SOURCE], out=folder / "single.fmu", platforms=platforms)
    return looped.files[0], single.files[0]


def equations(file: Path) -> bytes:
    """The generated C of an FMU."""
    with zipfile.ZipFile(file) as archive:
        return archive.read("sources/model.c")


def test_what_is_alike_becomes_a_loop(pair: tuple[Path, Path]) -> None:
    code, single = map(equations, pair)
    # Components, whose variables lie apart; a chain that runs from behind; frozen relations; tables of numbers.
    for part in (
        b"/* cell[1].through ... cell[120].through */",
        b"/* s[119] ... s[1] */",
        b"f->frozen[0 + i]",
        b"k0[i]",
    ):
        assert part in code
    assert b"for (int i" not in single


def test_loops_give_the_same_numbers(pair: tuple[Path, Path]) -> None:
    names = ["y", "x[7]", "v[120]", "s[1]", "cell[1].x", "cell[77].through", "der(v[60])"]
    runs, matrices = [], []
    for file in pair:
        with wb.load(file, solver="vkm") as model:
            forced = {"u": wb.Sine(amplitude=1.5, frequency=1.0)}
            run = wb.simulate(model, stop=0.3, inputs=forced, outputs=names, in_process=True)
            runs.append([run.signals[name] for name in names])
            matrices.append(wb.lin(model, method="exact", u0={"u": 0.7}, in_process=True))
    assert np.ptp(runs[0][0]) > 0.01
    assert np.array_equal(runs[0], runs[1])
    assert np.count_nonzero(matrices[0].A) > 480
    for matrix in "ABCD":
        assert np.array_equal(getattr(matrices[0], matrix), getattr(matrices[1], matrix)), matrix


def test_exact_slopes_of_loops_are_those_of_the_equations(pair: tuple[Path, Path]) -> None:
    with wb.load(pair[0]) as model:
        A = wb.lin(model, method="exact", in_process=True).A
        at = {variable.name: i for i, variable in enumerate(model.states)}
    i = 60  # der(v[i]) = -k x - 0.1 i v/(1 + x²) + exp(-|u|) s[n+1-i] + …, s[j] = Σ 0.9^(m-j) sin(x[m]); x = 0.2, v = 0
    row = A[at[f"v[{i}]"]]
    assert row[at[f"v[{i}]"]] == pytest.approx(-0.1 * i / 1.04, rel=1e-12)
    assert row[at["x[100]"]] == pytest.approx(0.9 ** (100 - 61) * np.cos(0.2), rel=1e-12)
    assert row[at["x[60]"]] == pytest.approx(-(1.0 + 0.01 * i * i), rel=1e-12)
    assert row[at["x[10]"]] == 0.0


def test_operations_that_neighbours_share_are_not_repeated() -> None:
    graph = ExpressionGraph()

    def heavy(i: int) -> int:
        return graph.apply("exp", graph.apply("sin", graph.leaf(VARIABLE, i)))

    alone = [graph.multiply(heavy(i), graph.leaf(TANGENT, i)) for i in range(LEAST)]
    shared = [graph.lookup(graph.leaf(VARIABLE, 5000), [heavy(i + k) for k in range(8)]) for i in range(LEAST)]
    shapes = Shapes(graph)
    assert [loop for _, loop in shapes.runs(alone)] == [True]
    assert [loop for _, loop in shapes.runs(shared)] == [False]
    assert [list(places) for places, _ in shapes.runs([None, alone[0], None])] == [[0], [1], [2]]


def test_steps_that_are_alike_become_neighbours_after_what_they_need() -> None:
    graph, n = ExpressionGraph(), LEAST
    # a[i] = sin(v[i]), b[i] = exp(a[i]), in turn; one step apart in the middle that the last b needs.
    expressions = [graph.apply("sin", graph.leaf(VARIABLE, i)) for i in range(n)]
    expressions += [graph.apply("exp", graph.leaf(VARIABLE, 1000 + i)) for i in range(n)]
    expressions.append(graph.negate(graph.leaf(VARIABLE, 1000)))
    needs: list[list[int]] = [[] for _ in range(n)] + [[i] for i in range(n)] + [[0]]
    needs[2 * n - 1].append(2 * n)
    order = [step for i in range(n - 1) for step in (i, n + i)] + [n - 1, 2 * n, 2 * n - 1]
    found = alike_together(graph, expressions, order, needs)
    assert sorted(found) == list(range(2 * n + 1))
    place = {step: at for at, step in enumerate(found)}
    assert all(place[other] < place[step] for step, needed in enumerate(needs) for other in needed)
    assert [loop for _, loop in Shapes(graph).runs([expressions[s] for s in found])].count(True) == 2
