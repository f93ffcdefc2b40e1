"""Where an envelope is evaluated: grids, random points, Latin hypercubes, Sobol' points."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from workbench.study.description import Envelope, GridPoint, Study
from workbench.study.requirements.base import Scalar
from workbench.study.spread import Spread

__all__ = ["COUNTS", "planned", "point_of", "shares"]

# What the interval of a probability is worth with the points of a plan.
COUNTS: Mapping[str, str] = {
    "grid": "a grid is not a sample: how many of its points meet the requirement is not a probability",
    "random": "independent points: Wilson's interval holds",
    "latin": (
        "Wilson's interval is for independent points. Those of a Latin hypercube scatter less for most functions, and "
        "their variance is at most n/(n − 1) times as large (Owen 1997): the interval is usually too wide"
    ),
    "sobol": (
        "Wilson's interval is for independent points. It is a guide here, not a promise: scrambled Sobol' points "
        "usually scatter less, but no bound near 1 is known for their variance; for a guaranteed interval take "
        'plan = "random"'
    ),
}


def shares(plan: str, points: int, dimensions: int, seed: int) -> NDArray[np.float64]:
    """Return points in the unit cube, shape (points, dimensions).

    Args:
        plan: "random", "latin" or "sobol" (scrambled; balanced where `points` is a power of two).
        points: number of them.
        dimensions: of the cube.
        seed: the same seed gives the same points.

    Source: M. D. McKay, R. J. Beckman, W. J. Conover, Technometrics 21 (1979) 239-245; I. M. Sobol', USSR Comput. Math.
    Math. Phys. 7 (1967) 86-112; A. B. Owen, J. Complexity 14 (1998) 466-489, by `scipy.stats.qmc`.
    """
    if plan == "random":
        return np.random.default_rng(seed).random((points, dimensions))
    sampler = qmc.LatinHypercube(dimensions, seed=seed) if plan == "latin" else qmc.Sobol(dimensions, seed=seed)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="The balance properties")  # said in the notes of the result
        return np.asarray(sampler.random(points), dtype=np.float64)


def planned(study: Study, envelope: Envelope) -> list[GridPoint]:
    """Return the points of an envelope: the same values under every failure.

    Args:
        study: that it belongs to.
        envelope: what it asks for.
    """
    spreads = envelope.spreads
    if envelope.plan == "grid":
        values = list(product(*(s.grid for s in spreads)))
    else:
        rows = shares(envelope.plan, envelope.points, len(spreads), envelope.seed)
        values = [tuple(s.at(float(u)) for s, u in zip(spreads, row, strict=True)) for row in rows]
    failures: list[str | None] = [*study.configurations] or [None]
    return [point_of(study, spreads, failure, row) for failure in failures for row in values]


def point_of(study: Study, spreads: Sequence[Spread], failure: str | None, values: Sequence[Scalar]) -> GridPoint:
    """Return one point; what a failure sets is not varied under it.

    Args:
        study: that it belongs to.
        spreads: of the parameters.
        failure: name of the configuration; None: the study has none.
        values: of the parameters.
    """
    changes = study.configurations[failure] if failure is not None else {}
    fixed = {f"{m}.{name}": v for m, change in changes.items() for name, v in change.options.get("set", {}).items()}
    pairs = zip((s.name for s in spreads), values, strict=True)
    return GridPoint(configuration=failure, values={name: fixed.get(name, value) for name, value in pairs})
