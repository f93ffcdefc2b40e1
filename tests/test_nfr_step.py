"""Co-simulation: the communication step is verified."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.fakes import EulerOscillator, FakeModel, Rows, StaticSession
from tests.mimic_fmus import build_mimic
from tests.reference_fmus import build_reference
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.model import Model
from workbench.model.described_model import LoadRecipe
from workbench.response.nfr.certificate import Certificate
from workbench.response.nfr.communication_step import refine
from workbench.response.nfr.job import PointsJob
from workbench.response.nfr.own_solver import own_step
from workbench.response.nfr.point import NfrPoint, PointTask, failed_point
from workbench.response.nfr.request import nfr
from workbench.signals.kinds import Sine


def euler() -> FakeModel:
    return FakeModel(EulerOscillator, interface="cs")


def test_the_step_is_halved_until_it_no_longer_matters() -> None:
    result = nfr(euler(), "u", "y", [1.0, 10.0, 20.0, 60.0], 1.0)
    s = 2j * math.pi * result.frequency_hz
    quotient = result.response[0] * (s * s + 10.0 * s + 1e4)
    assert np.max(np.abs(np.abs(quotient) - 1.0)) < 0.005
    assert np.max(np.abs(np.degrees(np.angle(quotient)))) < 0.5
    assert np.all(result.step < 1e-3)
    assert not result.failed


def test_a_held_input_costs_no_phase() -> None:
    # A step of a twentieth of a period would turn the phase by 9 degrees, were it measured from the sine.
    class Follower(EulerOscillator):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            t, _, u = super().rows(time, sine)
            return t, u, u

    result = nfr(FakeModel(lambda: Follower(0.0, 0.0), interface="cs"), "u", "y", [1.0], 1.0, step=0.05)
    assert result.response[0, 0] == pytest.approx(1.0)
    assert result.step[0, 0] == pytest.approx(0.05)


def test_an_answer_that_never_converges_fails_and_says_what_to_do() -> None:
    class StepDependent(EulerOscillator):
        def rows(self, time: Floats, sine: Sine) -> Rows:
            t, _, u = super().rows(time, sine)
            return t, u * (1.0 + 0.1 * math.log(time.size)), u

    result = nfr(FakeModel(lambda: StepDependent(0.0, 0.0), interface="cs"), "u", "y", [1.0], 1.0)
    assert np.isnan(result.gain[0, 0])
    assert "depends on the communication step" in result.failed[0].reason
    assert result.failed[0].reason.endswith("use a smaller `step`")  # a model of Python has no other interface


def explicit_euler(a: Floats, b: Floats, c: Floats, frequency: float, h: float) -> complex:
    """Return the response of x(k+1) = (I + hA) x(k) + hB u(k) at that frequency."""
    z = np.exp(2j * math.pi * frequency * h)
    return complex((c @ np.linalg.solve((z - 1.0) / h * np.eye(len(a)) - a, b)).item())


@pytest.mark.parametrize("errcrit", [0.1, 0.01])
def test_the_error_left_by_the_step_is_stated(errcrit: float) -> None:
    """300 random plants of one to three lightly damped modes, stepped by Euler's explicit method inside the FMU.

    Independent truth: C (sI − A)⁻¹ B, which the response tends to as the step goes to zero.
    """
    random = np.random.default_rng(13)
    covered, errors, steps = list[bool](), list[float](), 0
    for _ in range(300):
        modes = [(random.uniform(0.3, 3.0), 10.0 ** random.uniform(-2.0, 0.0)) for _ in range(random.integers(1, 4))]
        n = 2 * len(modes)
        a, b, c = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((1, n))
        for k, (f0, zeta) in enumerate(modes):
            w = 2.0 * math.pi * f0
            a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, 1.0], [-w * w, -2.0 * zeta * w]]
            b[2 * k + 1], c[0, 2 * k] = random.normal(), w * w
        frequency = random.uniform(0.2, 4.0)
        task = PointTask(
            input="u", output="y", frequency=frequency, amplitude=1.0, errcrit=errcrit, max_periods=20, rows=200
        )

        def run(tasks: Sequence[PointTask], _: int, model: tuple[Floats, Floats, Floats] = (a, b, c)) -> list[NfrPoint]:
            known = Certificate(errcrit=errcrit, max_periods=20)
            return [
                NfrPoint(
                    frequency=t.frequency, amplitude=1.0, offset=0.0,
                    response=explicit_euler(*model, t.frequency, 1.0 / (t.frequency * t.rows)),
                    periods=5, error=0.0, resolved=True, step=1.0 / (t.frequency * t.rows), certificate=known,
                )
                for t in tasks
            ]  # fmt: skip

        (found,) = refine([task], run, "use a smaller `step`")
        truth = complex((c @ np.linalg.solve(2j * math.pi * frequency * np.eye(n) - a, b)).item())
        assert found.response is not None
        assert found.error is not None
        assert found.step is not None
        error = abs(found.response / truth - 1.0)
        covered.append(error <= found.error)
        if found.status == "settled":
            errors.append(error)
        steps += round(1.0 / (frequency * found.step))
    assert np.mean(covered) >= 0.99
    assert len(errors) >= 297
    assert max(errors) <= 0.1 * errcrit
    assert steps / 300 < 3000.0  # rows per period


def test_a_model_unstable_at_any_step_fails_with_that_reason() -> None:
    model = FakeModel(lambda: EulerOscillator(damping=-40.0), interface="cs")
    result = nfr(model, "u", "y", [5.0], 1.0)
    assert "grows from period to period" in result.failed[0].reason


def test_an_explicit_step_is_kept_and_a_dependence_on_it_told() -> None:
    result = nfr(euler(), "u", "y", [10.0], 1.0, step=5e-4)
    assert result.step[0, 0] == pytest.approx(5e-4)
    assert len(result.warnings) == 1
    assert "half the communication step" in result.warnings[0]
    assert not nfr(euler(), "u", "y", [10.0], 1.0, step=1e-6).warnings


def test_an_explicit_step_at_which_it_diverges_fails() -> None:
    result = nfr(euler(), "u", "y", [1.0], 1.0, step=1e-2)
    assert result.failed[0].reason


def test_a_step_longer_than_a_quarter_period_is_refused() -> None:
    with pytest.raises(InputError, match=r"step: 0\.5 s is too long for 1 Hz"):
        nfr(euler(), "u", "y", [1.0], 1.0, step=0.5)


def test_a_carried_sweep_is_verified_too() -> None:
    result = nfr(euler(), "u", "y", [20.0, 10.0], 1.0, carry=True)
    s = 2j * math.pi * result.frequency_hz
    assert np.max(np.abs(np.abs(result.response[0] * (s * s + 10.0 * s + 1e4)) - 1.0)) < 0.005


@pytest.mark.parametrize("first", ["cs", "me"])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
def test_what_a_controlled_step_costs_is_in_the_error(first: str, tolerance: float, tmp_path: Path) -> None:
    """Two lags and the gain 3 in a loop: T = 3/((0.5 s + 1)(0.3 s + 1) + 3)."""
    file = tmp_path / "loop.toml"
    file.write_text(
        f"""
        components.a = {{model = "fmu:FirstOrderLag", interface = "{first}", set = {{tau = 0.5}}}}
        components.b = {{model = "fmu:FirstOrderLag", interface = "cs", set = {{tau = 0.3}}}}
        components.e = {{sum = "+-"}}
        components.k = {{gain = 3.0}}
        connections = {{"e.u2" = "b.y", "k.u" = "e.y", "a.u" = "k.y", "b.u" = "a.y"}}
        inputs = {{r = "e.u1"}}
        outputs = {{y = "b.y"}}
        """
    )
    frequencies = [0.2, 1.0, 3.0]
    with wb.load(file, tolerance=tolerance) as system:
        result = wb.nfr(system, "r", "y", frequencies, 1.0, in_process=True)
    s = 2j * math.pi * np.array(frequencies)
    truth = 3.0 / ((0.5 * s + 1.0) * (0.3 * s + 1.0) + 3.0)
    off = np.abs(result.response[0] / truth - 1.0)
    assert (off <= result.error[0]).all()
    assert (result.error[0] <= 1e-3).all()


def test_an_input_that_changes_at_events_only_follows_in_steps_and_the_error_counts_them(tmp_path: Path) -> None:
    """What passes through it drives 1/(0.05 s + 1): a staircase of 200 steps a period was 1e-3 off, and 4e-5 stated."""
    parts = {"pass": build_reference(tmp_path, "feedthrough", 3), "lag": "fmu:FirstOrderLag"}
    wires, frequencies = [("pass.Float64_discrete_output", "lag.u")], [0.2, 2.0, 20.0]
    with wb.connect(
        parts,
        wires,
        inputs={"k": "pass.Float64_discrete_input"},
        outputs={"y": "lag.y"},
        start_values={"lag.tau": 0.05},
    ) as system:
        assert system.interface == "me"
        result = wb.nfr(system, "k", "y", frequencies, 1.0, in_process=True)
    truth = 1.0 / (0.05 * 2j * math.pi * np.array(frequencies) + 1.0)
    off = np.abs(result.response[0] / truth - 1.0)
    assert result.status == (("settled",) * 3,)
    assert (off <= result.error[0]).all()
    assert (result.error[0] <= 3e-3).all()


@pytest.mark.parametrize("step", [0.05, 0.01, 0.002])
def test_halving_begins_at_the_models_own_step_where_that_is_shorter(step: float) -> None:
    """A first run of 200 steps a period and a second of 400 would both have had the model's own step: no change."""
    model = wb.load("fmu:FirstOrderLag", interface="cs", step=step)
    result = nfr(model, "u", "y", [0.1], 1.0)
    truth = 1.0 / (1.0 + 0.2j * math.pi)  # its time constant is 1 s
    assert result.step[0, 0] < 0.75 * min(step, 10.0 / 200)
    assert abs(result.response[0, 0] - truth) <= result.error[0, 0] * abs(truth)


@pytest.mark.parametrize("step", [None, 0.002])
def test_the_tolerance_falls_with_each_halving(step: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the first run had more steps than were asked for, since the model's own is shorter."""
    factors, whole = [1.0], LoadRecipe.tighter

    def tighter(self: LoadRecipe, factor: float) -> LoadRecipe:
        factors.append(factor)
        return whole(self, factor)

    monkeypatch.setattr(LoadRecipe, "tighter", tighter)
    with wb.load("fmu:FirstOrderLag", interface="cs", step=step) as model:
        nfr(model, "u", "y", [0.1], 1.0, drift_check=False, workers=wb.Workers(in_process=True))
    assert factors == [0.125**k for k in range(len(factors))]
    assert len(factors) > 1


def test_an_fmu_that_fails_at_a_tighter_tolerance_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = PointsJob._pass

    def passes(
        self: PointsJob, opened: AbstractContextManager[Model], tasks: Sequence[PointTask]
    ) -> Iterator[NfrPoint]:
        if isinstance(opened, nullcontext):
            yield from whole(self, opened, tasks)
        else:
            error = SimulationError("no such tolerance")
            yield from (failed_point(t.frequency, t.amplitude, error) for t in tasks)

    monkeypatch.setattr(PointsJob, "_pass", passes)
    with wb.load("fmu:FirstOrderLag", interface="cs") as model:
        result = nfr(model, "u", "y", [0.1], 1.0, workers=wb.Workers(in_process=True))
    assert any("own solver gets wrong is not in the error" in w and "no such tolerance" in w for w in result.warnings)


@pytest.mark.parametrize("step", [None, 0.005, 0.004])
def test_what_steps_of_the_fmus_own_cost_is_in_the_error(step: float | None, tmp_path: Path) -> None:
    """With shorter communication steps nothing changes any more, and input and output are held nevertheless.

    Independent truth: the oscillator in closed form. Before, 3.3 % were off at 10 Hz, and 0.03 % stated.
    """
    frequencies = [0.2, 0.5, 1.0, 1.6, 3.0, 10.0]
    with wb.load(build_mimic(tmp_path, "overshoots"), interface="cs") as model:
        result = nfr(model, "u", "y", frequencies, 0.1, step=step)
    s = 2j * math.pi * result.frequency_hz
    truth = 100.0 / (s * s + 4.0 * s + 100.0)
    off = np.abs(result.response[0] - truth) / np.abs(truth)
    assert np.all((off <= result.error[0]) | np.isnan(result.error[0]))
    assert np.all(result.error[0, :3] < 0.003)
    assert off[-1] > 0.02
    assert any("the output moves every 0.01 s only" in w or "the FMU's own, 0.01 s," in w for w in result.warnings)


def test_at_the_fmus_own_step_nothing_is_said_of_it(tmp_path: Path) -> None:
    with wb.load(build_mimic(tmp_path, "overshoots"), interface="cs") as model:
        result = nfr(model, "u", "y", [0.5, 1.0], 0.1, step=0.01)
    assert not any("only" in w or "own" in w for w in result.warnings)


@pytest.mark.parametrize("levels", [0.0, 0.3, 0.05])
def test_an_output_that_stands_still_irregularly_has_no_step_of_its_own(levels: float) -> None:
    def coarse(u: Floats) -> Floats:
        return np.asarray(np.round(u / levels) * levels if levels else u)

    model = FakeModel(lambda: StaticSession(coarse), interface="cs")
    task = PointTask(input="u", output="y", frequency=1.0, amplitude=1.0, errcrit=0.1, max_periods=20)
    assert own_step(model, task) == 0.0


def test_an_fmu_that_takes_one_step_only_is_measured_at_that_and_ends_at_a_multiple_of_it(tmp_path: Path) -> None:
    """The oscillator has 10 rad/s and damping 0.2; half the step, which would confirm it, is refused."""
    with wb.load(build_mimic(tmp_path, "insists"), interface="cs") as model:
        response = wb.nfr(model, "u", "y", [0.5], 0.1)
        run = wb.simulate(model)
    s = 2j * np.pi * 0.5
    assert response.response[0, 0] == pytest.approx(100.0 / (s**2 + 4.0 * s + 100.0), rel=1e-3)
    assert np.isnan(response.error[0, 0])
    assert run.time[-1] == pytest.approx(2.0)
    assert any("ends at 2 s, before 2.005 s: the FMU takes steps of 0.01 s only" in note for note in run.notes)
    assert any("what the step of 0.01 s makes of the answer is not known" in note for note in run.notes)
