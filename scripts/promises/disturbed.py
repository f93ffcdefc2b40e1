"""Measure how often the error that a frequency response states covers the truth where the model moves by itself.

Each model (tests/modelica/Disturbed.mo) is a lag of 0.03 … 3 s and a mode at 1 Hz with a damping ratio of 0.02 … 0.7
beside it, forced at 0.1 … 3 Hz with an amplitude of 1. From within both are moved by one of: sines at unrelated
frequencies; sines within 1e-4 of the forcing or of two or three times it; sines at exactly these; a gust (eight
sines of 0.02 … 5 Hz); pulses at events; a ramp; sines in the output alone. Amplitudes are 1e-3 … 0.3
(logarithmic). Every third model has a cubic spring of up to 0.05 besides. The truth is the closed form; with the
spring it is what the same model answers when it does not move by itself, solved for with tighter settings.
"""

from __future__ import annotations

import cmath
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import workbench as wb
from scripts.promises.trial import Trial, held, lines
from workbench.build.fmu import build_fmu
from workbench.fmi.platforms import host

SOURCE = Path(__file__).resolve().parents[2] / "tests" / "modelica" / "Disturbed.mo"
_PULSES = " + (if mod(time, every) < width then pulse else 0)"
KINDS = ("unrelated", "near", "exact", "gust", "pulses", "ramp", "output")

Values = dict[str, float]


@dataclass(frozen=True)
class Disturbed:
    """A model that moves by itself.

    Attributes:
        kind: of its own motion.
        frequencies: of the forcing [Hz].
        plant: parameters of lag and mode.
        own: parameters of its own motion.
    """

    kind: str
    frequencies: tuple[float, ...]
    plant: Values
    own: Values

    @classmethod
    def random(cls, kind: str, random: np.random.Generator) -> Disturbed:
        """Return one of that kind, linear."""

        def spread(low: float, high: float) -> float:
            return float(10.0 ** random.uniform(math.log10(low), math.log10(high)))

        frequencies = (spread(0.1, 3.0), spread(0.1, 3.0))
        plant = {"tau": spread(0.03, 3.0), "zeta": spread(0.02, 0.7), "share": random.uniform(0.0, 1.0)}
        size = spread(1e-3, 0.3)
        if kind == "ramp":
            return cls(kind, frequencies, plant, {"ramp": 0.3 * size})
        if kind == "pulses":
            every = spread(0.1, 10.0)
            return cls(kind, frequencies, plant, {"pulse": size, "every": every, "width": every * spread(0.03, 0.5)})
        count = 8 if kind == "gust" else int(random.integers(1, 4))
        at = random.choice(frequencies) * random.choice([1.0, 2.0, 3.0], count, p=[0.6, 0.2, 0.2])
        near = 1.0 + 1e-4 * random.uniform(-1.0, 1.0, count)
        own_frequencies = {"near": at * near, "exact": at}.get(kind, 10.0 ** random.uniform(-1.7, 0.7, count))
        own = {"seen": 1.0 / plant["share"] if kind == "output" else 0.0}
        amplitudes, phases = size * random.uniform(0.1, 1.0, count), random.uniform(0.0, 2.0 * math.pi, count)
        for i, (a, f, p) in enumerate(zip(amplitudes, own_frequencies, phases, strict=True)):
            own |= {f"a[{i + 1}]": float(a), f"f[{i + 1}]": float(f), f"p[{i + 1}]": float(p)}
        return cls(kind, frequencies, plant, own)

    def truth(self, f: float) -> complex:
        """Return the response of the linear model at f [Hz]."""
        tau, zeta, share = (self.plant[name] for name in ("tau", "zeta", "share"))
        return (1.0 - share) / (1.0 + 2j * math.pi * f * tau) + share / (1.0 - f * f + 2j * zeta * f)


def build(folder: Path, *, pulses: bool) -> Path:
    """Return the FMU; without pulses it has no events, and could be solved for."""
    source = folder / f"{'Pulsed' if pulses else 'Smooth'}.mo"
    text = SOURCE.read_text(encoding="utf-8").replace("Disturbed", source.stem)
    source.write_text(text if pulses else text.replace(_PULSES, ""), encoding="utf-8")
    build_fmu([source], out=source.with_suffix(".fmu"), platforms=[host()])
    return source.with_suffix(".fmu")


def measure(fmu: Path, of: Disturbed, interface: str, *, method: str = "auto", cubic: float = 0.0) -> Iterator[Trial]:
    """Measure a model in this process."""
    here = wb.Workers(in_process=True)
    values = {**of.plant, "cubic": cubic}
    with wb.load(fmu, interface, start_values={**values, **of.own}) as model:
        found = wb.nfr(model, "u", "y", of.frequencies, 1.0, method=method, workers=here)
    truth = [of.truth(f) for f in found.frequency_hz]
    if cubic:
        with wb.load(fmu, "me", start_values=values) as model:
            alone = wb.nfr(model, "u", "y", of.frequencies, 1.0, errcrit=1e-4, workers=here, max_periods=200)
        truth = [complex(x) for x in alone.response[0]]
    for k, true in enumerate(truth):
        measured = cmath.rect(found.gain[0, k], math.radians(found.phase_deg[0, k]))
        stated = float("nan") if found.error[0, k] is None else float(found.error[0, k])
        yield Trial(found.status[0][k], stated, abs(measured - true) / abs(true), int(found.periods[0, k]))


def trials(folder: Path, count: int, seed: int, method: str = "auto") -> Iterator[tuple[Disturbed, str, Trial]]:
    """Measure random models, each kind in turn, in turn by both interfaces; the FMUs are put into a folder."""
    fmus = {pulses: build(folder, pulses=pulses) for pulses in (False, True)}
    random = np.random.default_rng(seed)
    for i in range(count):
        of, interface = Disturbed.random(KINDS[i % len(KINDS)], random), ("me", "cs")[i // len(KINDS) % 2]
        cubic = random.uniform(0.0, 0.05) if i % 3 == 2 else 0.0
        if cubic:
            of = Disturbed(of.kind, of.frequencies, {**of.plant, "zeta": max(0.2, of.plant["zeta"])}, of.own)
        for trial in measure(fmus[of.kind == "pulses"], of, interface, method=method, cubic=cubic):
            yield of, interface + (" cubic" if cubic else ""), trial


def report(found: Sequence[tuple[Disturbed, str, Trial]]) -> Iterator[str]:
    """Yield the tables: all, by kind, and those that do not hold."""
    yield from lines([t for *_, t in found])
    for key in [*KINDS, *sorted({how for _, how, _ in found})]:
        yield f"{key}:"
        yield from lines([t for of, how, t in found if key in (of.kind, how)])
    for of, how, t in found:
        if t.status == "settled" and not t.true <= t.stated:
            yield f"off {t.true:.2g}, stated {t.stated:.2g} ({t.periods} periods, {how}): {of}"


def run(*, cases: int = 100, seed: int = 1, method: str = "auto") -> int:
    """Return 1 if settled points fall short.

    Args:
        cases: models, at two frequencies each.
        seed: of the first.
        method: auto, or settle: waited for, not solved for.
    """
    with tempfile.TemporaryDirectory() as folder:
        found = list(trials(Path(folder), cases, seed, method))
    print("\n".join(report(found)))
    return int(not held([t for *_, t in found]))
