"""Identify the rudder behind the sampled elevator law: noise at the sensor, friction at the surface, feedback.

How far the model's response is from that of sines, taken as from an open loop, directly and by the recorded reference,
and how large the 95 % regions say that it may be.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy import signal

import workbench as wb
from workbench.identification.validate.overlay import sine_response

AR = 0.95
# The law of `system:law_and_rudder` through a noisy sensor; the rudder's surface has friction [N.m].
_FRICTION = """
rate = {block = "transfer_function", numerator = [1.0, 0.0], denominator = [0.002, 1.0]}
friction = {block = "friction", coulomb = 100.0, stuck_speed = 0.2}
[connections]
"rate.u" = "rudder.del"
"friction.u1" = "rate.y"
"rudder.mH" = {from = "friction.y", gain = -1.0}
"""
_ALONE = f"""[components]
rudder = "fmu:Rudder"{_FRICTION}
[inputs]
delC = "rudder.delC"
[outputs]
del = "rudder.del"
"""
_DRIVEN = f"""[components]
error = {{sum = "+-", unit = "deg"}}
sensor = {{sum = "++", unit = "deg"}}
stick = {{gain = 0.2, units = {{u = "deg", y = "1"}}}}
rudder = "fmu:Rudder"
law = {{model = "fmu:ElevatorLaw", set = {{deflection = 0.0, positiveByFlap = [7.0, 7.8, 8.6, 9.4, 10.5], \
negativeByFlap = [7.0, 6.5, 7.2, 8.0, 9.0], stickOut = [-1.0, -0.5, 0.0, 0.5, 1.0], \
offsetByFlap = [0.0, 3.0, 4.2, 5.8, 7.0]}}}}{_FRICTION}"sensor.u1" = "rudder.del"
"error.u2" = "sensor.y"
"stick.u" = "error.y"
"law.side_stick" = "stick.y"
"rudder.delC" = "law.elevator"
[inputs]
r = "error.u1"
noise = "sensor.u2"
[outputs]
delC = "law.elevator"
del = "sensor.y"
""".replace("\\\n", "")
_PERIOD = 0.022  # of the law [s]
_ORDER = 2  # of the model: these records determine no more poles


def run(*, cases: int = 12, seed: int = 0, samples: int = 2000) -> int:
    """Print the error of the rudder's response, found behind the elevator law, and what the regions say of it.

    Args:
        cases: records.
        seed: of the first.
        samples: of each.
    """
    f = np.array([0.2, 0.5, 1.0, 2.0, 4.0])
    ways = {
        "subspaces, as from an open loop": (None, "never"),
        "as from an open loop": (None, "auto"),
        "direct": ("direct", "auto"),
        "by the reference": ("r", "auto"),
    }
    ratios = {name: np.zeros((cases, len(f)), dtype=np.complex128) for name in ways}
    said = {name: np.full((cases, len(f)), np.nan) for name in ways}
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder, "alone.toml"), Path(folder, "driven.toml")
        for file, text in zip(files, (_ALONE, _DRIVEN), strict=True):
            file.write_text(text, encoding="utf-8")
        with wb.load(files[0]) as model:
            truth = wb.nfr(model, "delC", "del", f.tolist(), [1.8]).response[0]
        for k in range(cases):
            data = _driven(files[1], seed + k, samples)
            for name, (how, refine) in ways.items():
                found = wb.identify(
                    data, inputs=["delC"], outputs=["del"], order=_ORDER, feedthrough=False, settle=1.0,
                    closed_loop=how, refine=refine,
                ).model  # fmt: skip
                ratios[name][k] = sine_response(found, "continuous", "delC", "del")[0](f) / truth
                if found.spread is not None:
                    said[name][k] = wb.model_spread(found, frequencies=f).gain_error[:, 0, 0]
    print(f"at {', '.join(f'{x:g}' for x in f)} Hz, {cases} records of {samples} samples [%]:")
    for name, ratio in ratios.items():
        off = np.abs(ratio - 1.0)
        columns = {
            "error of the mean": np.abs(ratio.mean(axis=0) - 1.0),
            "error, median": np.median(off, axis=0),
        }
        if known := int(np.sum(np.isfinite(said[name][:, 0]))):
            columns[f"95 % region, longer half axis, of {known}"] = np.nanmedian(said[name], axis=0)
        print(f"{name}: " + "; ".join(f"{words} {np.round(100.0 * c, 1).tolist()}" for words, c in columns.items()))
    return 0


def _driven(file: Path, seed: int, samples: int) -> wb.Experiment:
    """A record of the law and the rudder: reference ±2 deg, AR(1) 0.95 noise of 0.39 deg at the sensor."""
    random, t = np.random.default_rng(seed), _PERIOD * np.arange(samples + 1)
    r = np.repeat(random.choice([-2.0, 2.0], samples // 5 + 1), 5)[: samples + 1]
    v = signal.lfilter([1.0], [1.0, -AR], 0.12 * random.standard_normal(samples + 1))
    with wb.load(file) as model:
        run = wb.simulate(
            model,
            stop=float(t[-1]),
            points=t[1:].tolist(),
            inputs={"r": wb.Table(t.tolist(), r.tolist()), "noise": wb.Table(t.tolist(), v.tolist())},
        )
    command, deflection = (np.interp(t, run.time, run.signals[name]) for name in ("delC", "del"))
    return wb.make_experiment(
        _PERIOD, np.column_stack([r, command]), deflection, input_names=["r", "delC"], output_names=["del"]
    )
