"""delay() in built FMUs against closed forms: jumps, smooth signals, equations with a past, in both versions."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.test_build_fmu import HOST
from workbench.build.fmu import build_all, generate
from workbench.core.values.arrays import Floats
from workbench.errors import BuildError, WorkbenchError
from workbench.model.load import load
from workbench.point.lin.request import lin
from workbench.response.branches.request import branches
from workbench.response.nfr.request import nfr
from workbench.response.simulate.request import simulate
from workbench.response.simulate.result import SimulationResult
from workbench.signals.kinds import Constant, Signal, Sine, Step

SOURCE = Path(__file__).parent / "modelica" / "Delays.mo"
POINTS = np.arange(0.0137, 3.0, 0.0137)


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("delays")
    build_all([SOURCE], out=folder, platforms=[HOST])
    return folder


def run(fmus: Path, fmi: int, model: str, interface: str, signal: Signal, outputs: list[str]) -> SimulationResult:
    file = fmus / f"fmi{fmi}" / f"Delays_{model}.fmu"
    with load(str(file), interface=interface, solver="auto", tolerance=1e-10) as loaded:
        return simulate(
            loaded, stop=float(POINTS[-1]), inputs={"u": signal}, outputs=outputs, points=POINTS, verify_step=False
        )


def by_steps(t: Floats) -> Floats:
    """Return x of x' = -x(t - 1), x = 1 before 0, by the method of steps."""
    terms = [(-1.0) ** k * np.clip(t - (k - 1), 0.0, None) ** k / math.factorial(k) for k in range(1, 8)]
    return np.asarray(1.0 + np.sum(terms, axis=0))


def lag(t: Floats) -> Floats:
    """Return the step response of 1/(s + 1)."""
    return np.asarray(1.0 - np.exp(-np.clip(t, 0.0, None)))


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_jump_comes_out_at_its_instant(fmus: Path, fmi: int) -> None:
    found = run(fmus, fmi, "Chain", "me", Step(time=0.45, value=1.0), ["y", "yy", "branch", "n"])
    for name, at, size in (("y", 0.75, 1.0), ("yy", 1.05, 1.0), ("n", 0.75, 1.0)):
        before = found.time[np.flatnonzero(found.signals[name] == 0.0)[-1]]
        after = found.time[np.flatnonzero(found.signals[name] == size)[0]]
        assert before == pytest.approx(at, abs=1e-14)
        assert after == pytest.approx(at, abs=1e-14)
        assert set(found.signals[name]) == {0.0, size}
    # A branch that was not taken until 1.5 s knows the past all the same.
    assert np.all(found.signals["branch"][found.time > 1.5001] == 2.0)


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("fmi", [2, 3])
def test_smooth_signals_are_interpolated(fmus: Path, fmi: int, interface: str) -> None:
    found = run(fmus, fmi, "Lag", interface, Constant(1.0), ["y", "v[1]", "v[2]"])
    t = found.time
    assert found.signals["y"] == pytest.approx(lag(t - 0.4), abs=3e-6)
    assert found.signals["v[1]"] == pytest.approx(lag(t - 0.5), abs=3e-6)
    assert np.all(found.signals["v[2]"] == 2.0)
    with load(str(fmus / f"fmi{fmi}" / "Delays_Past.fmu"), interface=interface, tolerance=1e-10) as loaded:
        past = simulate(loaded, stop=float(POINTS[-1]), outputs=["x"], points=POINTS, verify_step=False)
    assert past.signals["x"] == pytest.approx(by_steps(past.time), abs=3e-6)


def test_an_input_alone_is_followed_although_no_state_shortens_the_steps(fmus: Path) -> None:
    found = run(fmus, 2, "Chain", "me", Sine(amplitude=1.0, frequency=1.0), ["y", "yy"])
    for name, late in (("y", 0.3), ("yy", 0.6)):
        expected = np.sin(2.0 * np.pi * np.clip(found.time - late, 0.0, None))
        assert found.signals[name] == pytest.approx(expected, abs=2e-5)


def test_the_frequency_response_has_the_phase_of_the_delay(fmus: Path) -> None:
    with load(str(fmus / "fmi2" / "Delays_Lag.fmu"), interface="me", solver="auto") as loaded:
        found = nfr(loaded, input="u", output="y", frequencies=[0.7], amplitudes=[1.0])
    s = 2j * np.pi * 0.7
    assert not any("unstable" in warning for warning in found.warnings)
    expected = np.exp(-0.4 * s) / (1.0 + s)
    assert abs(found.curve().value[0] / expected - 1.0) <= found.error[0, 0] < 1e-3


def test_a_loop_through_a_delay_has_its_jumps_and_its_rest(fmus: Path, tmp_path: Path) -> None:
    """y(t) = r(t - T) - y(t - T)/2: 1, 1/2, 3/4, … T apart; from r = 1 on it stands at 2/3."""
    file = tmp_path / "loop.toml"
    file.write_text(
        f"[components]\nlate = '{fmus / 'fmi3' / 'Delays_Chain.fmu'}'\nerror = {{sum = \"+-\"}}\nhalf = 0.5\n"
        '[connections]\n"half.u" = "late.y"\n"error.u2" = "half.y"\n"late.u" = "error.y"\n'
        '[inputs]\nr = "error.u1"\n[outputs]\ny = "late.y"\n',
        encoding="utf-8",
    )
    with wb.load(file) as loop:
        found = simulate(loop, stop=1.8, inputs={"r": Step(time=0.45, value=1.0)}, verify_step=False)
        rest = simulate(loop, stop=1.8, inputs={"r": Constant(1.0)}, verify_step=False)
    y, changes = found.signals["y"], np.flatnonzero(np.diff(found.signals["y"])) + 1
    assert y[changes] == pytest.approx([1.0, 0.5, 0.75, 0.625], abs=1e-15)
    assert found.time[changes] == pytest.approx([0.75, 1.05, 1.35, 1.65], abs=1e-12)
    assert rest.signals["y"] == pytest.approx(2.0 / 3.0, abs=1e-14)


def test_a_linear_model_says_that_it_has_no_delay(fmus: Path) -> None:
    with load(str(fmus / "fmi3" / "Delays_Lag.fmu"), interface="me") as loaded:
        assert any("delay() in an FMU" in note for note in lin(loaded).result.notes)
    with load(str(fmus / "fmi2" / "Delays_Chain.fmu"), interface="me") as loaded:  # no states, and something discrete
        found = lin(loaded).result
    assert any("delay() in an FMU" in note for note in found.notes)
    assert found.D[:2, 0].tolist() == pytest.approx([1.0, 1.0])
    with (
        load(str(fmus / "fmi3" / "Delays_Lag.fmu"), interface="me") as loaded,
        pytest.raises(WorkbenchError, match="transport delay"),
    ):
        branches(loaded, input="u", output="y", band=(0.5, 1.0), amplitudes=(1.0,))


def test_a_wrong_delay_is_one_line(fmus: Path) -> None:
    with (
        load(str(fmus / "fmi2" / "Delays_Chain.fmu"), interface="me", start_values={"half": -1.0}) as loaded,
        pytest.raises(WorkbenchError, match=r"delay\(\) of -2 s: it must be above 0"),
    ):
        simulate(loaded, stop=1.0)


@pytest.mark.parametrize(
    ("equation", "said"),
    [
        ("y = delay(x, 0.0);", r"Wrong.mo:7: a delay\(\) of 0 s is none"),
        ("y = delay(x, 1.0 + x);", r"Wrong.mo:7: the time of a delay\(\) must be a constant or parameter"),
        ("for i in 1:2 loop z[i] = delay(x, 0.1 * i); end for; y = z[2];", r"Wrong.mo:7: .*in a loop write the equ"),
        ("y = delay(x, 1.0) + delay(x, 1.0 + x);", r"Wrong.mo: the time of a delay"),
    ],
)
def test_a_delay_that_cannot_be_built_is_told_with_its_line(equation: str, said: str, tmp_path: Path) -> None:
    lines = [
        *("model Wrong", "  output Real y;", "  Real x(start = 1.0, fixed = true);", "  Real z[2];"),
        *(
            "equation",
            "  der(x) = -x;",
            f"  {equation}",
            *(() if "z[i]" in equation else ("  z = {y, y};",)),
            "end Wrong;",
        ),
    ]
    (tmp_path / "Wrong.mo").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(BuildError, match=said):
        generate(tmp_path / "Wrong.mo", "Wrong")


def test_what_is_delayed_does_not_feed_through(fmus: Path) -> None:
    sources = generate(SOURCE, "Delays.Chain")
    for version, needed in (
        (2, ("completedIntegratorStepNotNeeded", "false")),
        (3, ("needsCompletedIntegratorStep", "true")),
    ):
        root = ET.fromstring(sources.descriptions[version])  # noqa: S314 - written just now
        exchange = root.find("ModelExchange")
        assert exchange is not None
        assert exchange.get(needed[0]) == needed[1]
        outputs = root.findall("ModelStructure/Outputs/Unknown" if version == 2 else "ModelStructure/Output")
        assert outputs
        assert {o.get("dependencies") for o in outputs} == {""}
        variables = {v.get("name"): v for v in root.find("ModelVariables") or ()}
        assert {variables[name].get("variability") for name in ("half", "T")} == {"fixed"}
