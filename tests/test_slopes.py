"""Slopes along a run: directional derivatives, states moved at once, and each by itself give the same; lies do not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.lin_fmus import built
from tests.lying_fmus import build_lying
from workbench.core.values.arrays import Floats
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Variable
from workbench.kernel.native_slopes import BY_DIRECTIONAL, BY_GROUPS, BY_STATES, NativeSlopes, Pattern, pattern_of
from workbench.session.compiled import CompiledMeSession
from workbench.session.directional import slopes_pattern
from workbench.signals.kinds import Sine

ENTRY = 1e-5  # of the largest of a matrix: a forward difference over 1e-6 of a state's size, or of its nominal value


def session_of(model: wb.Model) -> CompiledMeSession:
    session = model.open_session()
    assert isinstance(session, CompiledMeSession)
    return session


def along(session: CompiledMeSession, output: str, pattern: Pattern | None = None, span: float = 3.0) -> NativeSlopes:
    """Return the slopes along a run forced at u; the pattern instead of the declared one."""
    if pattern is not None:
        session._patterns[(output,)] = pattern
    times = session.time + np.linspace(0.05, 0.97, 9) * span
    with session.slopes(times, (output,)) as found:
        force = Sine(amplitude=1.0, frequency=0.5, start=session.time)
        session.advance(session.time + span, signals={"u": force}, record=[output])
    assert found.complete
    return found


def chain(n: int) -> str:
    """Return masses in a row as Modelica, springs k = 1 + 0.3·(i mod 3) and cubic ones between them."""
    lines = ["model Chain", "  input Real u(start = 0);", "  output Real y;", f"  parameter Integer n = {n};"]
    lines += ["  Real x[n](each start = 0, each fixed = true, each nominal = 1);"]
    lines += ["  Real v[n](each start = 0, each fixed = true, each nominal = 1);", "equation"]
    for i in range(1, n + 1):
        left = f"x[{i}] - x[{i - 1}]" if i > 1 else f"x[{i}]"
        pull = f"-({stiffness(i)}) * ({left}) - 2 * ({left})^3 - 0.1 * v[{i}]"
        if i < n:
            right = f"x[{i + 1}] - x[{i}]"
            pull += f" + ({stiffness(i + 1)}) * ({right}) + 2 * ({right})^3"
        lines += [f"  der(x[{i}]) = v[{i}];", f"  der(v[{i}]) = {pull}{' + u' if i == n else ''};"]
    return "\n".join([*lines, f"  y = x[{n}];", "end Chain;"])


def stiffness(i: int) -> float:
    """Return the linear part of the spring before mass i."""
    return 1.0 + 0.3 * (i % 3)


def chain_slopes(names: list[str], states: Floats) -> Floats:
    """Return ∂f/∂x of the chain in closed form, in the order of `names`."""
    n = len(names) // 2
    at = {name: i for i, name in enumerate(names)}
    A = np.zeros((2 * n, 2 * n))
    x = [0.0, *(states[at[f"x[{i}]"]] for i in range(1, n + 1))]
    for i in range(1, n + 1):
        v, own = at[f"v[{i}]"], at[f"x[{i}]"]
        A[own, v], A[v, v] = 1.0, -0.1
        rate = stiffness(i) + 6.0 * (x[i] - x[i - 1]) ** 2
        A[v, own] -= rate
        if i > 1:
            before = at[f"x[{i - 1}]"]
            A[v, before] += rate
            A[at[f"v[{i - 1}]"], before] -= rate
            A[at[f"v[{i - 1}]"], own] += rate
    return A


@pytest.mark.parametrize("fmi", [2, 3])
def test_all_ways_give_the_slopes_of_a_chain_with_cubic_springs(fmi: int) -> None:
    with wb.load(built(chain(12), "Chain", fmi), tolerance=1e-8) as model, session_of(model) as session:
        names = [v.name for v in session.instance.description.states]
        declared = slopes_pattern(session.instance, [session.setup.variables["y"]])
        assert declared.way == BY_DIRECTIONAL
        assert len(declared.ends) <= 5  # of 24 states
        patterns = {
            BY_DIRECTIONAL: declared,
            BY_GROUPS: replace(declared, references=None),
            BY_STATES: pattern_of([None], len(names)),
        }
        cost = {}
        for way, pattern in patterns.items():
            before = session.evaluations
            found = along(session, "y", pattern)
            cost[way] = session.evaluations - before
            assert not any(found.structure.refuted)
            for k, x in enumerate(found.x):
                true = chain_slopes(names, x)
                error = 1e-12 if way == BY_DIRECTIONAL else ENTRY
                assert np.abs(found.A[k] - true).max() <= error * np.abs(true).max()
            assert np.abs(found.C[:, 0] - (np.array(names) == "x[12]")).max() < ENTRY
    assert cost[BY_GROUPS] < cost[BY_STATES] - 9 * 17  # nine times: 24 evaluations, or 5 and one to confirm them


def test_dependencies_that_are_not_declared_are_noticed() -> None:
    with wb.load(built(chain(12), "Chain"), tolerance=1e-8) as model, session_of(model) as session:
        names = [v.name for v in session.instance.description.states]
        # As if each velocity depended on its own mass alone.
        blind = [[names.index(n.replace("x", "v"))] if n[0] == "x" else [names.index(n)] for n in names]
        pattern = pattern_of([*blind, [names.index("x[12]")]], len(names))
        assert pattern.way == BY_GROUPS
        found = along(session, "y", pattern)
        assert found.refuted(BY_GROUPS)
        assert np.abs(found.A[5] - chain_slopes(names, found.x[5])).max() < ENTRY * 10.0
        assert session._patterns[("y",)].way == BY_STATES


@pytest.mark.parametrize(("lie", "refuted"), [("honest", False), ("wrong-derivative", True), ("no-derivative", True)])
def test_directional_derivatives_that_are_none_are_not_believed(tmp_path: Path, lie: str, refuted: bool) -> None:
    with wb.load(build_lying(tmp_path, lie), tolerance=1e-8) as model, session_of(model) as session:
        found = along(session, "y")
        assert found.refuted(BY_DIRECTIONAL) == refuted
        assert pytest.approx(np.broadcast_to([[0.0, 1.0], [-40.0, -0.8]], (9, 2, 2)), rel=1e-6, abs=1e-6) == found.A
        again = along(session, "y")
        assert again.structure.way == (BY_STATES if refuted else BY_DIRECTIONAL)


def test_multipliers_are_those_of_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    ways: list[int] = []

    def one(pattern: Callable[[Instance, Sequence[Variable]], Pattern]) -> list[complex]:
        def noted(instance: Instance, recorded: Sequence[Variable]) -> Pattern:
            found = pattern(instance, recorded)
            ways.append(found.way)
            return found

        monkeypatch.setattr("workbench.session.compiled.slopes_pattern", noted)
        with wb.load("fmu:Duffing", tolerance=1e-9) as model:
            found = wb.nfr(model, "u", "y", frequencies=[0.15], amplitudes=[0.1], workers=wb.Workers(in_process=True))
        ((certificate,),) = found.certificates
        assert certificate is not None
        return list(certificate.multipliers)

    exact, differences = one(slopes_pattern), one(lambda instance, _: pattern_of([None], instance.nx))
    assert (ways[0], ways[-1]) == (BY_DIRECTIONAL, BY_STATES)
    assert len(exact) == 2
    assert exact == pytest.approx(differences, abs=1e-6)


def test_groups_move_no_row_twice() -> None:
    random = np.random.default_rng(4)
    for _ in range(200):
        n, m = random.integers(1, 30, 2)
        depends = [sorted(set(random.integers(0, n, random.integers(0, 4)).tolist())) for _ in range(m)]
        pattern = pattern_of(depends, int(n))
        assert pattern.first is not None
        assert pattern.rows is not None
        assert sorted(pattern.members.tolist()) == list(range(n))
        begin = 0
        for end in pattern.ends.tolist():
            rows = [
                row
                for i in pattern.members[begin:end].tolist()
                for row in pattern.rows[pattern.first[i] : pattern.first[i + 1]].tolist()
            ]
            assert len(rows) == len(set(rows))
            begin = end
        assert all(
            [j for j in range(n) if i in pattern.rows[pattern.first[j] : pattern.first[j + 1]]] == states
            for i, states in enumerate(depends)
        )
