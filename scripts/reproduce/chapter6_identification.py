"""Identification of the elevator law: chapter 6.3 of the source report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scripts.reproduce.drawings import titled
from scripts.reproduce.error_figures import ERROR_FIGURES, error_figure
from scripts.reproduce.identification import (
    SEEDS,
    SEGMENTS,
    a_gain,
    coherence_of,
    crossing,
    first_order,
    law,
    limited,
    outside,
    swept,
)
from scripts.reproduce.measurement import Measurement, Picture, Reproduction
from scripts.reproduce.targets import read_targets
from workbench.data.excite.result import ExciteResult
from workbench.data.experiment.experiment import Experiment as Record
from workbench.data.spectra.coherence import Coherence, coherence
from workbench.data.spectra.density import sdf
from workbench.identification.identify.request import identify
from workbench.identification.identify.result import IdentifyResult

__all__ = ["EXPERIMENTS"]

OWN = "elevator"
ALMOST_IDLE = 0.055  # amplitude at which the rate limiter just acts


def _full_stick() -> Measurement:
    """Measure what the published experiment shows, with five binary sequences."""
    data = [law(seed, amplitude=1.0) for seed in SEEDS]
    models = [first_order(d) for d in data]
    seen = [coherence_of(d.identification, "boxcar", 0.0) for d in data]
    tapered = [coherence_of(d.identification, "hann", 0.5) for d in data]
    # The tool's authors define it as ‖y − ŷ‖/‖y‖ of detrended data (P. Van Overschee, B. De Moor, Subspace
    # Identification for Linear Systems, 1996, chapter 6): ‖y − ŷ‖/‖y − ȳ‖ of these.
    errors = [error_figure(m.own.data.y[:, 0], m.own.simulation.computed[:, 0], "fit") for m in models]
    positive = [first_order(law(s, amplitude=0.5, offset=0.5)).own.fit_percent[OWN] for s in SEEDS]
    gained = np.array(positive) - [m.own.fit_percent[OWN] for m in models]
    values = [m.estimate.singular_values for m in models]
    return Measurement(
        {
            "law-coherence": [float(c.max()) for c in seen],
            "law-coherence-median": [float(np.median(c)) for c in seen],
            "law-spectrum": [_fall(d) for d in data],
            "law-singular-values": [float(v[0] / v[1]) for v in values],
            "law-error": errors,
            "law-error-range": [min(errors), max(errors)],
            "law-error-spread": abs(_published_error() - float(np.mean(errors))) / float(np.std(errors, ddof=1)),
            "law-residuals": [outside(m) for m in models],
            "law-cross-correlation": [crossing(m) for m in models],
            "law-positive-fit-prbs": float(gained.mean()),
        },
        {
            "law-coherence": f"a Hann window, which leaks less, shows {min(c.max() for c in tapered):.3f} at least",
            "law-error": _by_definition(models),
            "law-positive-fit-prbs": f"{int((gained > 0).sum())} of {len(SEEDS)} sequences: {_range(gained)} %",
        },
        _pictures(data[0], models[0]),
    )


def _published_error() -> float:
    value = read_targets()["law-error"].value
    return float(np.asarray(value))


def _fall(data: ExciteResult) -> float:
    """Return how far the density of the elevator falls from the lowest to the highest frequency [dB]."""
    density = 10.0 * np.log10(sdf(data.identification, length=128).density[2:, 1])
    return float(density[0] - density[-2])


def _by_definition(models: Sequence[IdentifyResult]) -> str:
    """Return the error under each definition in words."""
    sides = [(m.own.data.y[:, 0], m.own.simulation.computed[:, 0]) for m in models]
    found = {n: [error_figure(y, computed, n) for y, computed in sides] for n in ERROR_FIGURES}
    return "by definition: " + "; ".join(f"{name} {_range(np.array(e))}" for name, e in found.items()) + " %"


def _range(values: np.ndarray) -> str:
    return f"{values.min():.4g} … {values.max():.4g}"


def _pictures(data: ExciteResult, model: IdentifyResult) -> list[Picture]:
    record = data.identification
    return [
        Picture(
            (32, 33),
            "Binary sequence of the stick, its spectrum, and what the law makes of it.",
            lambda: titled(data.plot(), "Figures 32 and 33"),
        ),
        Picture(
            (32, 34),
            "Spectral densities: only low frequencies pass.",
            lambda: titled(
                sdf(record, length=128).plot(), "Figures 32 and 34: spectral densities of stick and elevator"
            ),
        ),
        Picture(
            (35,),
            f"Coherence of stick and elevator, {SEGMENTS} segments without taper, as in the source report.",
            lambda: titled(
                coherence(record, segments=SEGMENTS, overlap=0.0, window="boxcar").plot(), "Figure 35: coherence"
            ),
        ),
        Picture(
            (36,), "Singular values: one stands out.", lambda: titled(model.plot_order(), "Figure 36: singular values")
        ),
        Picture(
            (37,),
            "Elevator, and the model of first order on the data of the fit.",
            lambda: titled(model.own.plot(), "Figure 37: validation on the data of the fit"),
        ),
        Picture(
            (37, 38),
            "Residuals of the simulation: far from white; input and residuals are uncorrelated.",
            lambda: titled(
                model.own.plot_residuals(kind="simulation"), "Figures 37 and 38: residuals of the simulation"
            ),
        ),
    ]


def _plain(record: Record) -> Coherence:
    """Return the coherence as the source report has it."""
    return coherence(record, segments=SEGMENTS, overlap=0.0, window="boxcar")


def _other_inputs() -> Measurement:
    """Measure what a smaller or one-sided input and a failed elevator change."""
    idle = [law(s, amplitude=0.04, offset=0.3) for s in SEEDS]
    small = [identify(d.identification, validation=d.validation, refine="never") for d in idle]
    almost = [first_order(law(s, amplitude=ALMOST_IDLE, offset=0.3)) for s in SEEDS]
    centred, positive = ([a_gain(swept(s, offset)).fit_percent for s in SEEDS] for offset in (0.0, 0.5))
    return Measurement(
        {
            "law-small-fit": [m.fit_percent for m in small],
            "law-small-order": [float(m.order) for m in small],
            "law-small-pole-zero": [_apart(m) for m in almost],
            "law-positive-fit": np.array(positive) - centred,
            "law-failed-limit": [max(limited(0.0, s) for s in SEEDS), min(limited(1.0, s) for s in SEEDS)],
        },
        {
            "law-small-order": "a gain; a model of first order is refused as too high",
            "law-small-pole-zero": f"fit {_range(np.array([m.fit_percent for m in almost]))} %",
            "law-positive-fit": f"{_range(np.array(centred))} % centred, {_range(np.array(positive))} % positive",
        },
        [
            Picture(
                (39,),
                f"A model of first order with the rate limiter almost idle (stick 0.3 ± {ALMOST_IDLE:g}).",
                lambda: titled(almost[0].own.plot_poles(), "Figure 39: pole and zero at small amplitude"),
            )
        ],
    )


def _apart(model: IdentifyResult) -> float:
    """Return the distance of the pole from the zero."""
    zeros = model.to_ss().zeros()
    return float(np.min(np.abs(model.model.poles[:, None] - np.asarray(zeros)[None, :])))


EXPERIMENTS = (
    Reproduction(
        "identification of the law",
        (
            "law-coherence",
            "law-coherence-median",
            "law-spectrum",
            "law-singular-values",
            "law-error",
            "law-error-range",
            "law-error-spread",
            "law-residuals",
            "law-cross-correlation",
            "law-positive-fit-prbs",
        ),
        _full_stick,
        3.0,
    ),
    Reproduction(
        "other inputs of the law",
        ("law-small-fit", "law-small-order", "law-small-pole-zero", "law-positive-fit", "law-failed-limit"),
        _other_inputs,
        3.0,
    ),
)
