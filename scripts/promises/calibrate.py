"""Calibrate models whose parameters are known, from data with noise, and count what the regions hold.

Each case is a model with planted parameters, played with a random staircase or a step; noise of 5 % of the output,
white or AR(1), is drawn anew for each trial. Counted: how often the 95 % regions hold the planted values, the median
error beside the Cramér-Rao bound (of the true model and noise, by differences of plain simulations), parameters that
were called unidentifiable in cases where all can be known, and those named where some cannot. Inputs are held between
samples, and once more straight lines: which, nobody tells the calibration.
"""

from __future__ import annotations

import io
import time
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import fmpy
import numpy as np
from scipy.optimize import differential_evolution, least_squares
from scipy.signal import lfilter

import workbench as wb
from tests.gemseo import gemseo_fmu
from workbench.core.values.arrays import Floats

__all__ = ["CASES", "UNSEEN", "PlantedCase", "played", "run"]

_MEDIAN = 0.6744897501960817  # of the absolute value of a standard normal number
_DIFFERENCE = 1e-4  # relative step of the bound's derivatives


@dataclass(frozen=True, kw_only=True)
class PlantedCase:
    """A model with planted parameters.

    Attributes:
        model: what `load` takes, or "gemseo:NAME"; "cs" behind an @@ chooses the interface.
        truth: parameter → planted value.
        limits: parameter → limits of the search.
        input, output: names.
        amplitude, middle: of the input.
        dt: [s].
        samples: how many.
        step: whether the input is one step, else a random staircase.
        between: "hold", or "linear": straight lines from sample to sample.
        given: other start values.
        named: words that `not_identifiable` must have, one for each direction; none: all can be known.
    """

    model: str
    truth: Mapping[str, float]
    limits: Mapping[str, tuple[float, float] | None] = field(default_factory=dict)
    input: str = "u"
    output: str = "y"
    amplitude: float = 1.0
    middle: float = 0.0
    dt: float = 0.1
    samples: int = 300
    step: bool = False
    between: Literal["hold", "linear"] = "hold"
    given: Mapping[str, float] = field(default_factory=dict)
    named: tuple[str, ...] = ()

    def opened(self, **values: float) -> wb.DescribedModel:
        """Return the model with these start values."""
        name, _, interface = self.model.partition("@@")
        path = str(gemseo_fmu(name.removeprefix("gemseo:"))) if name.startswith("gemseo:") else name
        starts = {**self.given, **values}
        step = self.dt if interface == "cs" else None  # what a co-simulation computes depends on it
        return wb.load(path, interface=interface or "auto", tolerance=1e-9, step=step, start_values=starts)

    @property
    def u(self) -> Floats:
        """The input, shape (samples,)."""
        if self.step:
            return np.where(np.arange(self.samples) >= self.samples // 10, self.middle + self.amplitude, self.middle)
        levels = np.random.default_rng(7).uniform(-1.0, 1.0, self.samples // 10 + 1)
        return np.asarray(self.middle + self.amplitude * np.repeat(levels, 10)[: self.samples])


_RUDDER: dict[str, Any] = {"input": "delC", "output": "del", "amplitude": 2.0, "dt": 0.004}
_DAMPER: dict[str, Any] = {"input": "f", "output": "y", "amplitude": 50.0, "dt": 0.002}
_ELEVATOR: dict[str, Any] = {"input": "side_stick", "output": "elevator", "amplitude": 0.9, "dt": 0.022}

CASES: Mapping[str, PlantedCase] = {
    "lag": PlantedCase(model="fmu:FirstOrderLag", truth={"tau": 0.6}, limits={"tau": (0.1, 10.0)}),
    "lag, a step": PlantedCase(model="fmu:FirstOrderLag", truth={"tau": 1.7}, step=True),
    "lag, cs": PlantedCase(model="fmu:FirstOrderLag@@cs", truth={"tau": 0.8}, limits={"tau": (0.1, 10.0)}),
    "Duffing": PlantedCase(model="fmu:Duffing", truth={"damping": 0.12, "stiffness": 1.3, "cubic": 0.7}),
    "Duffing, small": PlantedCase(
        model="fmu:Duffing", truth={"damping": 0.08, "stiffness": 0.8}, amplitude=0.2, limits={"damping": (0.01, 1.0)}
    ),
    "Duffing, large": PlantedCase(model="fmu:Duffing", truth={"damping": 0.2, "cubic": 1.4}, amplitude=3.0),
    "rudder, loop": PlantedCase(
        model="fmu:Rudder", truth={"tauSpool": 0.0056, "loopGain": 0.6}, **_RUDDER, limits={"tauSpool": (0.001, 0.05)}
    ),
    "rudder, oil": PlantedCase(
        model="fmu:Rudder", truth={"beta": 6e8, "tauCurrent": 0.02}, **_RUDDER, limits={"beta": (1e8, 1e10)}
    ),
    "rudder, a step": PlantedCase(
        model="fmu:Rudder", truth={"loopGain": 0.45, "tauCurrent": 0.02}, step=True, **_RUDDER
    ),
    "rudder, valve": PlantedCase(model="fmu:Rudder", truth={"cD": 0.7, "loopGain": 0.5}, **_RUDDER),
    "mass damper": PlantedCase(
        model="gemseo:Mass_Damper", truth={"mass.m": 1.3, "damper.d": 30.0, "spring.c": 9000.0},
        **{**_DAMPER, "dt": 0.01},
    ),
    "mass damper, cs": PlantedCase(
        model="gemseo:Mass_Damper@@cs", truth={"damper.d": 20.0, "spring.c": 12000.0}, **_DAMPER
    ),
    "elevator law": PlantedCase(
        model="fmu:ElevatorLaw", truth={"positiveByFlap[1]": 6.0, "negativeByFlap[1]": 6.6}, **_ELEVATOR
    ),
    "elevator law, offset": PlantedCase(
        model="fmu:ElevatorLaw", truth={"offsetByFlap[1]": 2.5, "positiveByFlap[1]": 7.5}, **_ELEVATOR
    ),
    "hysteresis": PlantedCase(model="fmu:Hysteresis", truth={"k": 2.4, "omegaC": 8.0}, amplitude=3.0, dt=0.05),
    "dead band": PlantedCase(model="fmu:DeadBand", truth={"C[1]": 0.8, "D": 0.35}, amplitude=2.0, dt=0.2),
    "actuator": PlantedCase(
        model="fmu:LimitedActuator", truth={"rateLimit": 0.5}, input="command", output="deflection", amplitude=0.3,
        dt=0.05,
    ),
    "aileron damper": PlantedCase(
        model="fmu:AileronDamper", truth={"alpha2": 6000.0}, input="rate", output="moment",
        limits={"alpha2": (1e3, 1e5)},
    ),
    "two FMUs": PlantedCase(
        model="system:rudder_loop", truth={"gain.gain": 1.7, "plant.tauSpool": 0.009}, input="reference",
        output="del", amplitude=1.0, dt=0.004,
    ),
    "law and rudder": PlantedCase(
        model="system:law_and_rudder", truth={"rudder.loopGain": 0.6}, input="reference", output="del", amplitude=4.0,
        dt=0.022,
    ),
}  # fmt: skip

_VALVE: dict[str, Any] = {"cD": (0.1, 2.0), "width": (0.002, 0.2), "rho": (100.0, 10000.0)}
_LIMITED: dict[str, Any] = {"input": "command", "output": "deflection", "amplitude": 0.3, "dt": 0.05}
_LAW = {"positiveByFlap[1]": 6.0}

UNSEEN: Mapping[str, PlantedCase] = {
    "valve's product": PlantedCase(
        model="fmu:Rudder", truth={"cD": 0.7, "width": 0.022}, limits=_VALVE, **_RUDDER,
        named=("only cD·width is seen",),
    ),
    "valve's quotient": PlantedCase(
        model="fmu:Rudder", truth={"cD": 0.7, "rho": 900.0}, limits=_VALVE, **_RUDDER, named=("only cD²/rho is seen",)
    ),
    "valve's width": PlantedCase(
        model="fmu:Rudder@3", truth={"width": 0.022, "rho": 900.0}, limits=_VALVE, **_RUDDER,
        named=("only width²/rho is seen",),
    ),
    "valve, all three": PlantedCase(
        model="fmu:Rudder", truth={"cD": 0.7, "width": 0.022, "rho": 900.0, "tauCurrent": 0.02}, limits=_VALVE,
        **_RUDDER, named=("", ""),
    ),
    "valve, cs": PlantedCase(
        model="fmu:Rudder@@cs", truth={"cD": 0.7, "width": 0.022}, limits=_VALVE, **_RUDDER,
        named=("only cD·width is seen",),
    ),
    "valve in a loop": PlantedCase(
        model="system:rudder_loop", truth={"plant.cD": 0.7, "plant.width": 0.022, "gain.gain": 1.7},
        limits={f"plant.{name}": x for name, x in _VALVE.items()}, input="reference", output="del", dt=0.004,
        named=("only plant.cD·plant.width is seen",),
    ),
    "amplifier and spool": PlantedCase(
        model="fmu:Rudder", truth={"loopGain": 0.45, "currentMax": 0.03, "spoolGain": 0.012},
        limits={"loopGain": (0.1, 3.0), "currentMax": (0.01, 0.2), "spoolGain": (0.002, 0.05)}, **_RUDDER,
        named=("trade off",),
    ),
    "no stop": PlantedCase(
        model="fmu:Rudder", truth={"tauCurrent": 0.02, "stopStiffness": 2e8}, **_RUDDER,
        named=("stopStiffness: does not act",), limits={"stopStiffness": (1e7, 1e9)},
    ),
    "no stop, no bypass": PlantedCase(
        model="fmu:Rudder", truth={"bypassArea": 1e-5, "tauCurrent": 0.02, "stopStiffness": 2e8}, **_RUDDER,
        named=("bypassArea: does not act", "stopStiffness: does not act"),
    ),
    "command within its limit": PlantedCase(
        model="fmu:Rudder", truth={"delMax": 20.0, "tauCurrent": 0.02}, **_RUDDER, named=("delMax: does not act",)
    ),
    "no upper limit": PlantedCase(
        model="fmu:LimitedActuator", truth={"rateLimit": 0.5, "upper": 0.5}, **_LIMITED,
        named=("upper: does not act",),
    ),
    "no limit at all": PlantedCase(
        model="fmu:LimitedActuator", truth={"lower": -0.5, "rateLimit": 0.5, "upper": 0.5}, **_LIMITED,
        named=("lower: does not act", "upper: does not act"),
    ),
    "another flap": PlantedCase(
        model="fmu:ElevatorLaw", truth={**_LAW, "positiveByFlap[2]": 8.0}, **_ELEVATOR,
        named=("positiveByFlap[2]: does not act",),
    ),
    "another flap's offset": PlantedCase(
        model="fmu:ElevatorLaw", truth={**_LAW, "offsetByFlap[3]": 4.0}, **_ELEVATOR,
        named=("offsetByFlap[3]: does not act",),
    ),
    "not on the ground": PlantedCase(
        model="fmu:ElevatorLaw", truth={**_LAW, "positiveGround[1]": 14.0}, **_ELEVATOR,
        named=("positiveGround[1]: does not act",),
    ),
    "no failure": PlantedCase(
        model="fmu:ElevatorLaw", truth={**_LAW, "failedFactor": 1.8}, **_ELEVATOR, named=("failedFactor: does not act",)
    ),
    "scale of the states": PlantedCase(
        model="fmu:Saturation", truth={"B[1]": 1.1, "C[1]": 0.7, "C[2]": 0.6}, amplitude=0.4, named=("trade off",)
    ),
    "scale of a state": PlantedCase(
        model="fmu:Saturation", truth={"A[1,2]": -0.4, "A[2,1]": 0.45, "C[2]": 0.7, "D": 0.4}, amplitude=0.4,
        named=("trade off",),
    ),
    "not saturated": PlantedCase(
        model="fmu:Saturation", truth={"D": 0.4, "upper": 5.0}, amplitude=0.4, named=("upper: does not act",)
    ),
    "weak spring": PlantedCase(
        model="fmu:Duffing", truth={"stiffness": 1.2, "cubic": 1.1}, amplitude=1e-3,
        named=("cubic: the data leave it open",),
    ),
}  # fmt: skip


def played(case: PlantedCase, **values: float) -> Floats:
    """Return the output of a case, computed by plain simulation, shape (n,).

    Args:
        case: which.
        values: parameters in place of the planted ones.
    """
    with case.opened(**{**case.truth, **values}) as model:
        data = wb.make_experiment(case.dt, case.u, case.u, input_names=[case.input], output_names=["rest"])
        time_ = data.time + model.start_time
        late = 1e-6 * case.dt if _samples(case) else 0.0
        signal = wb.Table((time_ - late).tolist(), case.u.tolist(), interpolate=case.between)
        points = time_ + late
        run_ = wb.simulate(
            model, stop=float(points[-1]), inputs={case.input: signal}, outputs=[case.output],
            points=points[points > model.start_time], verify_step=False, in_process=True,
        )  # fmt: skip
        rows = np.searchsorted(run_.time, points + 1e-9 * case.dt, side="right") - 1
        return np.asarray(run_[case.output])[rows]


def _samples(case: PlantedCase) -> bool:
    return case.model in ("fmu:ElevatorLaw", "system:law_and_rudder")


@dataclass(frozen=True)
class _Bound:
    """True output, and by how much parameters err at least."""

    y: Floats
    sigma: float
    errors: Mapping[str, float]


def _bound(case: PlantedCase, colour: float) -> _Bound:
    """Return the Cramér-Rao bound; of white residuals the first sample's variance is that of the stationary noise."""
    y = played(case)
    sigma = 0.05 * float(np.std(y))
    columns = []
    for name, value in case.truth.items():
        h = _DIFFERENCE * abs(value)
        columns.append((played(case, **{name: value + h}) - played(case, **{name: value - h})) / (2.0 * h))
    J = lfilter([1.0, -colour], [1.0], np.column_stack(columns), axis=0)
    J[0] *= np.sqrt(1.0 - colour**2)
    covariance = np.linalg.inv(J.T @ J) * sigma**2
    return _Bound(y, sigma, dict(zip(case.truth, np.sqrt(np.diag(covariance)), strict=True)))


def _noise(case: PlantedCase, sigma: float, colour: float, seed: int) -> Floats:
    e = np.random.default_rng(seed).normal(0.0, sigma, case.samples)
    e[0] /= np.sqrt(1.0 - colour**2)
    return np.asarray(lfilter([1.0], [1.0, -colour], e))


def _calibrated(case: PlantedCase, y: Floats) -> wb.CalibrateResult:
    data = wb.make_experiment(case.dt, case.u, y, input_names=[case.input], output_names=[case.output])
    free = {name: case.limits.get(name) for name in case.truth}
    with case.opened() as model:
        return wb.calibrate(model, data, free=free, in_process=True)


def _trials(name: str, case: PlantedCase, draws: int, colour: float, seed: int) -> tuple[int, int, int, list[float]]:
    """Return how many regions hold the truth, of how many, false alarms, and errors over the bound."""
    bound = _bound(case, colour)
    held = alarms = runs = doubts = mistaken = 0
    errors, begun = [], time.process_time()
    for draw in range(draws):
        y = bound.y + _noise(case, bound.sigma, colour, seed + draw)
        found = _calibrated(case, y)
        alarms += bool(found.not_identifiable)
        runs += found.runs
        doubts += bool(found.doubt)
        mistaken += found.between_samples != case.between
        for p in found.parameters:
            true = case.truth[p.name]
            held += p.low is not None and p.high is not None and p.low <= true <= p.high
            errors.append(abs(p.value - true) / bound.errors[p.name])
    count = draws * len(case.truth)
    cpu = (time.process_time() - begun) / draws
    ratio = float(np.median(errors)) / _MEDIAN
    print(
        f"{name:22} {case.between:6} AR {colour:.1f}: held {held:4} of {count:4}, median error {ratio:.2f} of the "
        f"bound, {alarms} false alarms, {doubts} doubts, {mistaken} wrong between samples, {runs / draws:.0f} runs, "
        f"{cpu:.2f} s CPU each",
        flush=True,
    )
    return held, count, alarms, errors


def _unseen(name: str, case: PlantedCase, seed: int) -> bool:
    y = played(case)
    y = y + np.random.default_rng(seed).normal(0.0, 0.05 * float(np.std(y)), len(y))
    found = _calibrated(case, y)
    named = len(found.not_identifiable) == len(case.named) and all(
        any(words in line for line in found.not_identifiable) for words in case.named
    )
    print(f"{name:22} {'named' if named else 'NOT NAMED'}: {found.not_identifiable}", flush=True)
    return named


def _peers() -> None:
    """Print runs and CPU time beside SciPy's differential evolution and its least squares through FMPy."""
    case = CASES["rudder, loop"]
    y = played(case)
    y = y + _noise(case, 0.05 * float(np.std(y)), 0.0, 1)
    names, limits = list(case.truth), [(0.001, 0.05), (0.1, 3.0)]
    limited = replace(case, limits=dict(zip(names, limits, strict=True)))
    data = wb.make_experiment(case.dt, case.u, y, input_names=[case.input], output_names=[case.output])
    results, cpu = [], []
    for _ in range(4):  # what is imported at the first call is not counted, as FMPy's is not
        begun = time.process_time()
        with wb.load("fmu:Rudder", tolerance=1e-8) as model:
            results.append(wb.calibrate(model, data, free=limited.limits, in_process=True))
        cpu.append(time.process_time() - begun)
    found = results[-1]
    print(f"calibrate: {found.runs} runs, {min(cpu[1:]):.2f} s CPU, {found.values}", flush=True)
    least = float(np.sum((y - played(case, **found.values)) ** 2))
    counted = [0]

    def cost(z: Floats) -> float:
        counted[0] += 1
        return float(np.sum((y - played(case, **dict(zip(names, np.exp(z).tolist(), strict=True)))) ** 2))

    ended = differential_evolution(cost, np.log(limits).tolist(), seed=1, tol=1e-4, polish=False, maxiter=60)
    print(f"differential evolution: {counted[0]} runs, cost over the least {ended.fun / least:.5f}", flush=True)
    path, table = Path(__file__).parents[2] / "fmus/fmi2/Rudder.fmu", _fmpy_input(case)
    counted[0], begun = 0, time.process_time()

    def residuals(z: Floats) -> Floats:
        counted[0] += 1
        with redirect_stdout(io.StringIO()):  # it warns of inputs that are not given
            run_ = fmpy.simulate_fmu(
                str(path), stop_time=case.dt * (case.samples - 1), output_interval=case.dt, relative_tolerance=1e-8,
                start_values=dict(zip(names, np.exp(z).tolist(), strict=True)), input=table, output=[case.output],
                fmi_type="ModelExchange",
            )  # fmt: skip
        return np.asarray(y - np.interp(case.dt * np.arange(case.samples), run_["time"], run_[case.output]))

    with wb.load("fmu:Rudder") as model:
        start = [float(next(v.start or 0.0 for v in model.parameters if v.name == n)) for n in names]
    naive = least_squares(residuals, np.log(start), bounds=np.log(limits).T, x_scale="jac", diff_step=1e-4)
    spent = time.process_time() - begun
    print(
        f"FMPy and least squares: {counted[0]} runs, {spent:.2f} s CPU, {spent / min(cpu[1:]):.1f} times as much, "
        f"{np.exp(naive.x).tolist()}",
        flush=True,
    )


def _fmpy_input(case: PlantedCase) -> Any:
    """Return the staircase as FMPy reads it: two rows at each change."""
    time_, u = case.dt * np.arange(case.samples), case.u
    rows = [(0.0, u[0])]
    for k in np.flatnonzero(np.diff(u)) + 1:
        rows += [(time_[k], u[k - 1]), (time_[k], u[k])]
    return np.array([*rows, (time_[-1] + case.dt, u[-1])], dtype=[("time", float), (case.input, float)])


def run(*, cases: int = 50, only: str = "", every: int = 1, seed: int = 1, peers: bool = False) -> int:
    """Calibrate all cases.

    Args:
        cases: draws of the noise for each model and colour.
        only: words that the name of a case must have.
        every: take every so many of the cases.
        seed: of the noise.
        peers: measure runs and CPU time beside other tools, and nothing else.
    """
    if peers:
        _peers()
        return 0
    chosen = [(n, c) for n, c in list(CASES.items())[::every] if only in n]
    held = count = alarms = 0
    errors: list[float] = []
    for number, (name, case) in enumerate(chosen):
        straight = [] if _samples(case) else [(replace(case, between="linear"), 0.0, 250)]
        for one, colour, more in [(case, 0.0, 0), (case, 0.7, 500), *straight]:
            found = _trials(name, one, cases, colour, seed + 1000 * number + more)
            held, count, alarms = held + found[0], count + found[1], alarms + found[2]
            errors += found[3]
    named = [_unseen(name, case, seed) for name, case in list(UNSEEN.items())[::every] if only in name]
    rate = 100.0 * held / max(count, 1)
    ratio = float(np.median(errors)) / _MEDIAN if errors else 0.0
    print(
        f"held {held} of {count} ({rate:.1f} %), median error {ratio:.2f} of the bound, {alarms} false alarms, "
        f"{sum(named)} of {len(named)} unseen directions named"
    )
    spread = 196.0 * np.sqrt(0.95 * 0.05 / max(count, 1))
    return int(not (93.0 - spread <= rate <= 97.0 + spread and ratio < 1.2 and alarms == 0 and all(named)))
