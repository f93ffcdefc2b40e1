"""Large systems: what their parts declare, put together along the connections, is used as that of one FMU is."""

from __future__ import annotations

import re
from pathlib import Path
from zipfile import ZipFile

import control
import numpy as np
import pytest
from scipy.linalg import expm

import workbench as wb
from tests.large_fmus import GAIN, INTEGRAL, build_large, build_loop
from tests.reference_fmus import build_reference
from workbench.core.machine.files import pack
from workbench.core.values.arrays import Floats
from workbench.errors import SimulationError, WorkbenchError
from workbench.kernel.native_slopes import BY_GROUPS
from workbench.model.described_model import DescribedModel
from workbench.session import directional
from workbench.session.compiled import CompiledMeSession

N = 80  # states of the rod


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("large")


def matrices(path: float = 0.0) -> tuple[Floats, Floats, Floats, Floats]:
    """Return A, B, C, D of the loop; `path`: from the rod's last cell to its first."""
    A, B = np.zeros((N + 2, N + 2)), np.zeros(N + 2)
    A[0, -1], B[0] = -1.0, 1.0  # the integral of r - y
    A[1, [0, 1, -1]], B[1] = (INTEGRAL, -1.0, -GAIN), GAIN  # the actuator
    A[2:, 2:] = (np.diag(np.full(N, -2.0)) + np.diag(np.ones(N - 1), 1) + np.diag(np.ones(N - 1), -1)) * N**2
    A[-1, -1] = -float(N**2)
    A[2, 1], A[2, -1] = N**2, path * N**2
    C, D = np.zeros((2, N + 2)), np.array([[0.0], [GAIN]])
    C[0, -1], C[1, [0, -1]] = 1.0, (INTEGRAL, -GAIN)
    return A, B[:, None], C, D


def stepped(model: DescribedModel, until: float = 0.7) -> tuple[Floats, int, CompiledMeSession]:
    """Return the states after a step of the input, and how many right-hand sides that took."""
    with model, model.open_session() as session:
        assert isinstance(session, CompiledMeSession)
        session.advance(until, signals={"r": wb.Constant(1.0)}, record=["y"])
        return session.stand(), session.evaluations, session


def after_step(path: float = 0.0, until: float = 0.7) -> Floats:
    A, B, _, _ = matrices(path)
    whole = np.zeros((N + 3, N + 3))
    whole[:-1, :-1], whole[:-1, -1] = A, B[:, 0]
    return np.asarray(expm(whole * until)[:-1, -1])


def test_a_loop_around_a_rod_has_a_banded_newton_matrix(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = wb.load(build_loop(build_large(folder, "rod", N)), solver="gear", tolerance=1e-8)
    x, few, session = stepped(model)
    assert session._sparsity is not None
    assert session._sparsity.below + session._sparsity.above <= 5  # a ring, folded
    assert session._sparsity.groups <= 5
    np.testing.assert_allclose(x, after_step(), atol=2e-7)
    monkeypatch.setattr(directional, "LARGE", 10**6)
    dense, many, session = stepped(wb.load(build_loop(build_large(folder, "rod", N)), solver="gear", tolerance=1e-8))
    assert session._sparsity is None
    np.testing.assert_allclose(x, dense, atol=2e-7)
    assert 3 * few < 2 * many


@pytest.mark.parametrize("exact", [True, False])
def test_columns_of_a_large_loop_move_together(folder: Path, exact: bool) -> None:
    with wb.load(build_loop(build_large(folder / str(exact), "rod", N, directional=exact))) as model:
        found = wb.lin(model, in_process=True).result
    assert found.method == ("exact" if exact else "difference")
    for got, wanted in zip((found.A, found.B, found.C, found.D), matrices(), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-9 if exact else 1e-4)
    assert not found.doubts
    assert sum(found.calls.values()) < N


# The parts' declarations are believed as little as those of one FMU: what comes out is right all the same.


def test_a_part_that_lies_about_its_dependencies_costs_no_accuracy(folder: Path) -> None:
    x, _, session = stepped(wb.load(build_loop(build_large(folder, "lying", N)), solver="gear", tolerance=1e-8))
    assert session._sparsity is not None
    np.testing.assert_allclose(x, after_step(path=0.25), atol=2e-7)


@pytest.mark.parametrize("exact", [True, False])
def test_columns_that_a_part_lies_about_move_one_by_one(folder: Path, exact: bool) -> None:
    with wb.load(build_loop(build_large(folder / str(exact), "lying", N, directional=exact))) as model:
        found = wb.lin(model, in_process=True).result
    np.testing.assert_allclose(found.A, matrices(path=0.25)[0], atol=1e-4)


@pytest.mark.parametrize("kind", ["rod", "lying"])
def test_slopes_along_a_run_of_a_large_loop_are_right(folder: Path, kind: str) -> None:
    times = np.linspace(0.1, 0.6, 6)
    with wb.load(build_loop(build_large(folder, kind, N)), tolerance=1e-8) as model, model.open_session() as session:
        assert isinstance(session, CompiledMeSession)
        with session.slopes(times, ["y"]) as found:
            session.advance(0.7, signals={"r": wb.Constant(1.0)}, record=["y"], points=times)
        assert session._patterns[("y",)].way == BY_GROUPS or kind == "lying"
    A, _, C, _ = matrices(0.25 if kind == "lying" else 0.0)
    assert found.complete
    np.testing.assert_allclose(found.A, np.broadcast_to(A, found.A.shape), atol=1e-3)
    np.testing.assert_allclose(found.C[:, 0], np.broadcast_to(C[0], found.C[:, 0].shape), atol=1e-6)


def test_a_part_that_declares_nothing_may_depend_on_all_of_itself_alone(folder: Path) -> None:
    silent = build_large(folder / "silent", "chain", 6, dependencies=False)
    with wb.load(build_loop(build_large(folder, "rod", n := 400), str(silent))) as model:
        depends = {v.name: set(v.dependencies or ()) for v in (*model.description.derivatives, *model.outputs)}
        banded = directional.newton_sparsity(model.description)
    of_chain = {f"actuator.{letter}[{i}]" for letter in "qv" for i in (1, 2, 3)}
    behind = {"controller.i", f"rod.T[{n}]", "r"}
    assert depends["actuator.der(q[2])"] == of_chain | behind
    assert depends["rod.der(T[1])"] == {"rod.T[1]", "rod.T[2]"} | of_chain | behind
    assert depends["rod.der(T[2])"] == {"rod.T[1]", "rod.T[2]", "rod.T[3]"}
    assert depends["u"] == behind
    assert banded is not None


def test_what_gear_does_with_a_system_is_said(folder: Path) -> None:
    with wb.load(build_loop(build_large(folder, "rod", N))) as model:
        assert any(f"diagonals for {N + 2} states" in note for note in model.notes), model.notes
    parts = {
        "rod": str(build_large(folder, "rod", N)),
        "lag": wb.FmuComponent(name="lag", file="fmu:FirstOrderLag", interface="cs"),
    }
    with wb.connect(parts, [("lag.y", "rod.u"), ("rod.y", "lag.u")], step=0.01) as mixed:
        assert any(f"diagonals for {N} states" in note for note in mixed.notes), mixed.notes


def test_the_declared_dependencies_of_random_systems_are_the_entries_that_are_not_zero() -> None:
    """Random parts and connections, algebraic loops among them, against the dense matrices."""
    random, checked = np.random.default_rng(7), 0
    for _ in range(30):
        count = int(random.integers(2, 6))
        parts = {f"p{k}": control.ss(*_sparse(random)) for k in range(count)}
        wires = [
            (f"p{random.integers(count)}.y{random.integers(1, 3)}", f"p{k}.u{i}")
            for k in range(count)
            for i in (1, 2)
            if (k, i) != (0, 1)  # p0.u1 is driven from outside
        ]
        try:
            with wb.connect(parts, wires, inputs={"u": "p0.u1"}, outputs={"y": f"p{count - 1}.y2"}) as model:
                found = wb.lin(model, in_process=True).result
                rows = [*model.description.derivatives, *model.outputs]
        except WorkbenchError:
            continue  # a loop with a gain of 1
        names = [*found.state_names, *found.input_names]
        whole = np.block([[found.A, found.B], [found.C, found.D]])
        depends = [[names.index(d) for d in row.dependencies or ()] for row in rows]
        says = np.zeros(whole.shape, dtype=bool)
        for row, columns in enumerate(depends):
            says[row, columns] = True
        np.testing.assert_array_equal(says, whole != 0.0)
        checked += 1
    assert checked > 20


def _sparse(random: np.random.Generator) -> list[Floats]:
    """Return A, B, C, D of a part with two inputs and outputs, most entries 0."""
    n = int(random.integers(1, 4))
    shapes = [(n, n), (n, 2), (2, n), (2, 2)]
    return [random.standard_normal(s) * (random.random(s) < 0.4) for s in shapes]


def misdeclared(folder: Path) -> Path:
    """Write an FMU whose output is its input, and whose description denies that."""
    true, file = build_reference(folder, "feedthrough", 2), folder / "misdeclared.fmu"
    with ZipFile(true) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    text = contents["modelDescription.xml"].decode()
    contents["modelDescription.xml"] = re.sub(r'dependencies="\d+"', 'dependencies=""', text).encode()
    pack(file, contents)
    return file


@pytest.mark.parametrize("way", ["simulate", "lin"])
def test_an_output_read_before_an_input_that_moves_it_ends_the_run(way: str, tmp_path: Path) -> None:
    """Two such gains before a lag: unchecked, the lag saw what its source was an evaluation ago, near enough 0."""
    file, first, last = misdeclared(tmp_path), "real_continuous_input", "real_continuous_output"
    # In the wrong order: what comes first is read last.
    parts = {"b": str(file), "a": str(file), "lag": "fmu:FirstOrderLag"}
    wires = [("b." + last, "lag.u"), ("a." + last, "b." + first)]
    system = wb.connect(parts, wires, inputs={"r": "a." + first}, outputs={"y": "lag.y"})
    said = rf"b\.{last} → lag\.u passes a value that has changed since: b\.{last} depends on an input"
    sine = {"r": wb.Sine(amplitude=1.0, frequency=1.0)}

    def ask() -> object:
        return wb.lin(system) if way == "lin" else wb.simulate(system, stop=1.0, inputs=sine)

    with system, pytest.raises(SimulationError, match=said):
        ask()


@pytest.mark.parametrize("way", ["simulate", "lin", "nfr"])
def test_an_fmu_whose_dependencies_are_not_believed_is_evaluated_in_the_right_order(way: str, tmp_path: Path) -> None:
    first, last = "real_continuous_input", "real_continuous_output"
    file = misdeclared(tmp_path).name
    (tmp_path / "loop.toml").write_text(
        "[components]\n"
        + "".join(f'{name} = {{model = "{file}", interface = "me", dependencies = "all"}}\n' for name in "ba")
        + f'lag = "fmu:FirstOrderLag"\n[connections]\n"lag.u" = "b.{last}"\n"b.{first}" = "a.{last}"\n'
        + f'[inputs]\nr = "a.{first}"\n[outputs]\ny = "lag.y"\n'
    )
    with wb.load(tmp_path / "loop.toml") as system:
        assert any("a: the dependencies that it declares are not believed" in note for note in system.notes)
        if way == "lin":
            np.testing.assert_allclose(wb.lin(system).result.B, [[1.0]], rtol=1e-6)
        elif way == "nfr":
            found = wb.nfr(system, "r", "y", [0.5], 1.0, workers=wb.Workers(in_process=True))
            assert found.response[0, 0] == pytest.approx(1.0 / (1.0 + 1j * np.pi), rel=1e-3)
        else:
            run = wb.simulate(system, stop=2.0, inputs={"r": wb.Constant(1.0)}, in_process=True)
            np.testing.assert_allclose(run["y"], 1.0 - np.exp(-run.time), atol=1e-5)
