"""Identify a linear model from recorded data and hold it against other data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from workbench.analysis.advice import Advice, advise
from workbench.analysis.experiment import Experiment
from workbench.analysis.identified import IdentifiedModel
from workbench.analysis.identify.prepare import Prepared, chosen, cut, prepare
from workbench.analysis.identify.result import IdentifyResult
from workbench.analysis.subspace import DEFAULT_METHOD, SubspaceEstimate, estimate
from workbench.analysis.validate import PoleBootstrap, bootstrap_poles, same_settings, validate
from workbench.errors import InputError
from workbench.origin import with_origin

__all__ = ["identify"]


@with_origin()
def identify(
    data: Experiment | str | Path,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    order: int | Literal["auto"] = "auto",
    method: str = DEFAULT_METHOD,
    basis: str | None = None,
    validation: Experiment | str | Path | None = None,
    horizon: int | None = None,
    max_order: int = 20,
    feedthrough: bool = True,
    delay: int | Sequence[int] | Literal["auto"] = 0,
    biased: bool = False,
    stable: bool = False,
    detrend: str = "mean",
    settle: float = 0.0,
    dt: float | None = None,
    lags: int | None = None,
    bootstrap: int = 0,
    seed: int = 0,
) -> IdentifyResult:
    """Identify a discrete linear state-space model and validate it.

    The steps of the source report's chapter 5: the data are judged (`advise`), their operating point is taken off, the
    order is chosen from singular values or principal angles, the model is estimated by a subspace method, and its
    simulation and one-step prediction are compared with other data, if there are any.

    Not for data from a closed loop (the estimate is biased; the advice and the cross-correlation at negative lags tell)
    and not for models whose gain depends on the amplitude, beyond the amplitude of the data.

    Args:
        data: an experiment, or a CSV file.
        inputs: names of columns; None: those the experiment has.
        outputs: likewise.
        order: number of states, 0 for a gain, or "auto".
        method: "n4sid", "moesp" or "cva".
        basis: "combined" or "unscaled", the source report's keyword; None: the method's own.
        validation: other data of the same model; None: validated on the same data, which flatters.
        horizon: block rows of the subspace method [samples]; None: chosen.
        max_order: largest order that the automatic choice considers.
        feedthrough: estimate D; else it is zero.
        delay: known delay of the inputs [samples], or "auto": the one that the advice estimates.
        biased: regression on the state sequence (less variance, a bias that stays).
        stable: poles outside the unit circle are moved inside.
        detrend: "mean", "linear" or "none": what is taken off before the fit.
        settle: so much is cut off the beginning [s].
        dt: sampling interval of a file without times [s].
        lags: of the residual tests [samples]; None: 25.
        bootstrap: replicates for the confidence of the poles; 0: none.
        seed: of the bootstrap's random numbers.

    Raises:
        InputError: the data cannot be read or excite too little for the order, unknown name, too few samples.
    """
    prepared = prepare(chosen(data, inputs, outputs, dt), how=detrend, settle=settle)
    advice = advise(prepared.data, order=None if order == "auto" else order, feedthrough=feedthrough)
    if order != "auto":
        advice.refuse(order)
    options: dict[str, Any] = {
        "method": method, "basis": basis, "horizon": horizon, "feedthrough": feedthrough,
        "delay": _delays(advice) if delay == "auto" else delay, "biased": biased, "stable": stable,
    }  # fmt: skip
    found = estimate(prepared.u, prepared.y, prepared.data.dt, order=order, max_order=max_order, **options)
    advice.refuse(found.order)
    model = _named(found, prepared)
    other = _other(validation, prepared.data, settle, dt)
    regions = _regions(found.with_model(model), prepared, bootstrap, seed)
    return IdentifyResult(
        data=prepared.data,
        advice=advice,
        estimate=found.with_model(model),
        detrend=detrend,
        settle=settle,
        own=validate(model, prepared.data, lags=lags, bootstrap=regions),
        other=None if other is None else validate(model, other, lags=lags, bootstrap=regions),
    )


def _delays(advice: Advice) -> tuple[int, ...]:
    """Return the delay of each input that the advice estimates, beyond the sample that all systems take [samples]."""
    found = advice.finding("delay").values
    names, outputs = advice.experiment.input_names, advice.experiment.output_names
    waits = [[found.get(f"{u} → {y}") for y in outputs] for u in names]
    return tuple(max(0, min((w for w in row if w is not None), default=1) - 1) for row in waits)


def _named(found: SubspaceEstimate, prepared: Prepared) -> IdentifiedModel:
    data = prepared.data
    return found.model.named(
        input_names=data.input_names,
        output_names=data.output_names,
        input_units=data.input_units,
        output_units=data.output_units,
        name=data.name,
        u0=prepared.u0,
        y0=prepared.y0 + found.model.y0,
    )


def _other(
    validation: Experiment | str | Path | None, data: Experiment, settle: float, dt: float | None
) -> Experiment | None:
    if validation is None:
        return None
    other = chosen(validation, data.input_names, data.output_names, dt)
    if abs(other.dt - data.dt) > 1e-6 * data.dt:
        raise InputError(f"{other.name}: sampled every {other.dt:g} s, {data.name} every {data.dt:g} s; resample one")
    return cut(other, settle)


def _regions(found: SubspaceEstimate, prepared: Prepared, replicates: int, seed: int) -> PoleBootstrap | None:
    if not replicates:
        return None
    again = same_settings(found)
    return bootstrap_poles(found.model, prepared.data, again, replicates=replicates, seed=seed)
