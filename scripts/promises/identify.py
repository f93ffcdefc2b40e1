"""Measure identification against the Cramér-Rao bound, and how often its regions hold the truth.

Each system has order 1 to 8, one to three inputs and outputs, white or AR(1) noise (pole 0.95) at each output, 10 or
20 dB below it, and a white input. The error is that of the frequency response, root mean square over 60 frequencies and
all channels, each output relative to its response; the bound is the same of the covariance that Fisher's information of
the true model gives. A ratio of 1 is what no unbiased method can beat on average. Beside the refinement with the right
orders and with automatic ones: the subspace method alone (n4sid), with the right order.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from scipy import signal

import workbench as wb
from tests.random_systems import Plant, random_plant, truth_spread
from workbench.core.values.arrays import Complex, Floats
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.prediction.innovations import Innovations

AR = 0.95
FREQUENCIES = np.linspace(0.003, 0.497, 60)


@dataclass(frozen=True, eq=False)
class Case:
    """A record of a random system.

    Attributes:
        number: of the system.
        plant: the truth.
        colour: pole of the noise; 0: white.
        decibel: signal over noise.
        u: shape (N, m).
        y: shape (N, p).
        sizes: shape (p,), standard deviation of the innovations.
    """

    number: int
    plant: Plant
    colour: float
    decibel: float
    u: Floats
    y: Floats
    sizes: Floats

    @property
    def noise_order(self) -> int:
        """States of the disturbance."""
        return len(self.plant.C) if self.colour else 0

    @property
    def truth(self) -> Complex:
        """The frequency response, shape (k, p, m)."""
        plant = wb.Linear(self.plant.A, self.plant.B, self.plant.C, self.plant.D, dt=1.0)
        return plant.response(FREQUENCIES)

    @property
    def innovations(self) -> Innovations:
        """The true model of plant and disturbance."""
        A, B, C, D = self.plant.A, self.plant.B, self.plant.C, self.plant.D
        (n, m), p, d = B.shape, len(C), self.noise_order
        return Innovations(
            A=scipy.linalg.block_diag(A, self.colour * np.eye(d)) if d else A, B=np.vstack([B, np.zeros((d, m))]),
            C=np.hstack([C, self.colour * np.eye(p, d)]), D=D,
            K=np.vstack([np.zeros((n, p)), np.eye(d, p)]), offset=np.zeros(p), x0=np.zeros(n + d), plant=n,
            shared=False,
        )  # fmt: skip

    def data(self) -> wb.Experiment:
        """The record."""
        return wb.make_experiment(1.0, self.u, self.y)


def records(first: int, count: int, samples: int) -> Iterator[Case]:
    """Yield records.

    Args:
        first: number of the first system.
        count: how many.
        samples: N.
    """
    for number in range(first, first + count):
        random = np.random.default_rng(number)
        m, p = (int(k) for k in random.integers(1, 4, 2))
        plant = random_plant(random, 1 + number % 8, m, p)
        u = random.standard_normal((samples, m))
        y = plant.output(u)
        colour, decibel = (0.0, AR)[number // 8 % 2], (10.0, 20.0)[number // 16 % 2]
        sizes = y.std(axis=0) * 10.0 ** (-decibel / 20.0) * np.sqrt(1.0 - colour**2)
        e = sizes * random.standard_normal((samples + 300, p))
        v = signal.lfilter([1.0], [1.0, -colour], e, axis=0)[300:]
        yield Case(number, plant, colour, decibel, u, y + v, sizes)


@dataclass(frozen=True, eq=False)
class Row:
    """What one system gave: ratios to the bound, and coverage of 95 % regions."""

    ratios: Mapping[str, float]
    poles: tuple[int, int]
    response: tuple[int, int]
    colour: float
    decibel: float
    right: tuple[int, int]


def measure(case: Case) -> Row:
    """Return the row of a system.

    Args:
        case: the record.
    """
    truth, n = case.truth, len(case.plant.A)
    weight = 1.0 / np.mean(np.abs(truth) ** 2, axis=(0, 2), keepdims=True)
    spread = truth_spread(case.innovations, case.u, case.y, case.sizes)
    known = wb.model_spread(_as_identified(case, spread), frequencies=FREQUENCIES)
    variance = np.trace(known.shape, axis1=-2, axis2=-1) / 5.991
    bound = np.sqrt(np.mean(weight * variance))

    def ratio(response: Complex) -> float:
        return float(np.sqrt(np.mean(weight * np.abs(response - truth) ** 2)) / bound)

    given = wb.identify(case.data(), order=n, noise=case.noise_order, refine="always", detrend="none")
    auto = wb.identify(case.data(), max_order=12, detrend="none", refine="always")
    ratios = {"right orders": ratio(given.model.response(FREQUENCIES)), "auto": ratio(auto.model.response(FREQUENCIES))}
    subspaces = wb.estimate(case.u, case.y, 1.0, order=n, method="n4sid")
    ratios["n4sid"] = ratio(subspaces.model.response(FREQUENCIES))
    if given.model.spread is None:
        return Row(ratios, (0, 0), (0, 0), case.colour, case.decibel, (auto.order, n))
    own = wb.model_spread(given.model, frequencies=FREQUENCIES)
    inside = own.holds_response(truth)
    held = held_poles(own, case.plant)
    return Row(
        ratios, (sum(held), len(held)), (int(inside.sum()), inside.size), case.colour, case.decibel, (auto.order, n)
    )


def held_poles(own: wb.ModelSpread, plant: Plant) -> list[bool]:
    """Return which poles of a plant lie in the regions of those nearest to them.

    Args:
        own: the regions.
        plant: the truth.
    """
    rows, columns = scipy.optimize.linear_sum_assignment(
        np.abs(np.array([r.pole for r in own.regions])[:, None] - plant.poles[None])
    )
    return [own.regions[i].contains(complex(plant.poles[j])) for i, j in zip(rows, columns, strict=True)]


def _as_identified(case: Case, spread: Floats) -> IdentifiedModel:
    plant, (p, m), n = case.plant, case.plant.D.shape, len(case.plant.A)
    return IdentifiedModel(
        A=plant.A, B=plant.B, C=plant.C, D=plant.D, K=np.zeros((n, p)), x0=np.zeros(n), dt=1.0, u0=np.zeros(m),
        y0=np.zeros(p), covariance=np.diag(case.sizes**2), input_names=tuple(f"u{k}" for k in range(m)),
        output_names=tuple(f"y{k}" for k in range(p)), input_units=(None,) * m, output_units=(None,) * p, spread=spread,
    )  # fmt: skip


def report(rows: list[Row]) -> None:
    """Print medians and coverage so far.

    Args:
        rows: of all systems.
    """
    for name in rows[0].ratios:
        ratios = np.array([row.ratios[name] for row in rows])
        each = ", ".join(
            f"{'AR(1)' if colour else 'white'} {decibel:g} dB {np.median(part):.2f}"
            for colour in (0.0, AR)
            for decibel in (10.0, 20.0)
            if (part := [r.ratios[name] for r in rows if (r.colour, r.decibel) == (colour, decibel)])
        )
        print(f"{name}: median ratio {np.median(ratios):.2f}, above 2: {np.mean(ratios > 2.0):.0%}; {each}")
    for what in ("poles", "response"):
        for colour in (0.0, AR):
            pairs = np.array([getattr(row, what) for row in rows if row.colour == colour])
            if len(pairs) and pairs[:, 1].sum():
                share = pairs[:, 0].sum() / pairs[:, 1].sum()
                noise = "AR(1)" if colour else "white"
                print(f"95 % regions of {what}, {noise} noise, hold {share:.1%} of {pairs[:, 1].sum()}")
    right = sum(found == true for found, true in (row.right for row in rows))
    above = sum(found > true for found, true in (row.right for row in rows))
    print(f"automatic order right in {right} of {len(rows)}, above in {above}", flush=True)


# -- closed loops and a large record ---------------------------------------------------------------


def closed_loops(count: int) -> None:
    """Print the gain at rest over the true one, open and closed methods, and how often the regions hold the truth.

    Args:
        count: records.
    """
    found: dict[str, list[float]] = {}
    orders = []
    held: dict[str, list[tuple[bool, float]]] = {}
    truth = signal.freqz([0.0, 0.1, 0.05], [1.0, -1.6, 0.8], 2.0 * np.pi * FREQUENCIES)[1].reshape(-1, 1, 1)
    for seed in range(count):
        data = _looped(seed)
        for how in (None, "direct", "r"):
            options = {"refine": "never"} if how is None else {"closed_loop": how}
            result = wb.identify(data, inputs=["u"], outputs=["y"], order=2, feedthrough=False, **options)
            found.setdefault(how or "as from an open loop", []).append(
                float(result.model.response([0.0])[0, 0, 0].real)
            )
            if how is not None and result.model.spread is not None:
                own = wb.model_spread(result.model, frequencies=FREQUENCIES)
                inside = float(own.holds_response(truth).mean())
                held.setdefault(how, []).append((own.holds(0.8 + 0.4j, 0.8 + 0.4j), inside))
        orders.append(wb.identify(data, inputs=["u"], outputs=["y"], feedthrough=False, closed_loop="direct").order)
    for how, gains in found.items():
        low, middle, high = np.quantile(np.array(gains) / _GAIN, [0.05, 0.5, 0.95])
        print(f"{how}: gain at rest over the true one, median {middle:.2f}, 5 % … 95 % {low:.2f} … {high:.2f}")
    for how, each in held.items():
        poles, response = np.mean(np.array(each, dtype=np.float64), axis=0)
        print(
            f"{how}, right order: 95 % regions, known in {len(each)} of {count}, hold the pole in {poles:.1%}, the "
            f"response in {response:.1%}"
        )
    print(f"direct, automatic order right (2) in {sum(n == 2 for n in orders)} of {count}", flush=True)


def random_loops(count: int) -> None:
    """Print how often the regions by a reference hold the truth, over random plants with random feedback.

    Args:
        count: plants, of orders 1 to 4 with one input and one or two outputs.
    """
    held, known = np.zeros((count, 3)), np.zeros(count, dtype=bool)
    for seed in range(count):
        plant, data = _random_loop(seed)
        n, truth = len(plant.A), wb.Linear(plant.A, plant.B, plant.C, 0.0 * plant.D, dt=1.0).response(FREQUENCIES)
        found = wb.identify(
            data, inputs=["u"], outputs=list(data.output_names), order=n, feedthrough=False, closed_loop="r",
            detrend="none",
        )  # fmt: skip
        if found.model.spread is not None:
            own = wb.model_spread(found.model, frequencies=FREQUENCIES)
            poles = held_poles(own, plant)
            known[seed], held[seed] = True, (sum(poles), len(poles), own.holds_response(truth).mean())
        if (seed + 1) % 20 == 0 or seed + 1 == count:
            poles, each, response = held[: seed + 1][known[: seed + 1]].sum(axis=0)
            print(
                f"by a reference, {seed + 1} random loops: 95 % regions, known in {known[: seed + 1].sum()}, hold "
                f"{poles / each:.1%} of {each:.0f} poles, {response / known[: seed + 1].sum():.1%} of the responses",
                flush=True,
            )


def _random_loop(seed: int, samples: int = 3000) -> tuple[Plant, wb.Experiment]:
    """A random plant without feedthrough, white or AR(1) 0.9 noise, u = r − L y(k − 1), L 0.6 of what it stands."""
    random = np.random.default_rng(1000 + seed)
    n, p = 1 + seed % 4, 1 + seed // 4 % 2
    plant = random_plant(random, n, 1, p)
    L, size = random.standard_normal((1, p)), 1e-3
    while size < 1e3 and _radius(plant, size * L) < 0.97:
        size *= 1.1
    L *= 0.6 * size
    r, colour = random.standard_normal(samples), (0.0, 0.9)[seed // 8 % 2]
    v = signal.lfilter([1.0], [1.0, -colour], random.standard_normal((samples, p)), axis=0)
    y = plant.output(r[:, None]) - np.outer(r, plant.D)
    v *= y.std(axis=0) * 10.0 ** (-(10.0, 20.0)[seed // 16 % 2] / 20.0) / v.std(axis=0)
    x, u = np.zeros(n), r.copy()
    for k in range(samples):
        y[k] = plant.C @ x + v[k]
        u[k] -= (L @ y[k - 1]).item() if k else 0.0
        x = plant.A @ x + plant.B[:, 0] * u[k]
    return plant, wb.make_experiment(1.0, np.column_stack([r, u]), y, input_names=["r", "u"])


def _radius(plant: Plant, L: Floats) -> float:
    p = len(plant.C)
    loop = np.block([[plant.A, -plant.B @ L], [plant.C, np.zeros((p, p))]])
    return float(np.max(np.abs(np.linalg.eigvals(loop))))


_GAIN = (0.1 + 0.05) / (1.0 - 1.6 + 0.8)


def _looped(seed: int, samples: int = 4000) -> wb.Experiment:
    """The resonance 0.1 q⁻¹ + 0.05 q⁻² over 1 − 1.6 q⁻¹ + 0.8 q⁻², AR(1) noise, u = r − 0.5 y(k − 1)."""
    random = np.random.default_rng(seed)
    r = random.choice([-1.0, 1.0], samples)
    v = signal.lfilter([1.0], [1.0, -0.9], 0.3 * random.standard_normal(samples))
    u, w, y = np.zeros(samples), np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        if k >= 2:
            w[k] = 1.6 * w[k - 1] - 0.8 * w[k - 2] + 0.1 * u[k - 1] + 0.05 * u[k - 2]
        y[k] = w[k] + v[k]
        u[k] = r[k] - 0.5 * (y[k - 1] if k else 0.0)
    return wb.make_experiment(1.0, np.column_stack([r, u]), y, input_names=["r", "u"], output_names=["y"])


def large(samples: int = 1_000_000) -> None:
    """Print seconds of processor time and memory of a large record.

    Args:
        samples: N.
    """
    random = np.random.default_rng(0)
    plant = random_plant(random, 10, 1, 1)
    u = random.standard_normal((samples, 1))
    y = plant.output(u)
    y = y + 0.1 * y.std() * random.standard_normal(y.shape)
    data, before = wb.make_experiment(1.0, u, y), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for refine in ("never", "always"):
        start = time.process_time()
        wb.identify(data, order=10, refine=refine)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        seconds, megabytes = time.process_time() - start, (peak - before) / 1024
        print(f"refine={refine}: {seconds:.1f} s of processor time, peak memory +{megabytes:.0f} MB")


def run(
    *, cases: int = 200, seed: int = 0, samples: int = 2000, closed_loop: bool = False, large_record: bool = False
) -> int:
    """Print errors beside their bound, coverage and orders; return 0.

    Args:
        cases: systems.
        seed: of the first.
        samples: of each record.
        closed_loop: bias, orders and coverage in closed loops instead.
        large_record: seconds and memory of 1e6 samples of 2 channels, order 10, instead.
    """
    if closed_loop:
        closed_loops(cases)
        random_loops(cases)
    elif large_record:
        large()
    else:
        rows = []
        for k, case in enumerate(records(seed, cases, samples), 1):
            rows.append(measure(case))
            if k % 20 == 0 or k == cases:
                print(f"-- {k} systems", flush=True)
                report(rows)
    return 0
