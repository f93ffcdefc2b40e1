"""Refine a subspace model, and take the refined one where it validates no worse."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, suggest
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.identify.data import PreparedData, without_joints
from workbench.identification.identify.request import Identify
from workbench.identification.prediction.model import RefinedModel, refined_model
from workbench.identification.prediction.model_selection import SelectionOptions
from workbench.identification.prediction.result import NOT_REFINED, Refinement
from workbench.identification.subspace.order import cost
from workbench.identification.subspace.result import SubspaceEstimate
from workbench.identification.validate.validate import suited

__all__ = ["refined", "wished"]

_DOUBT = 0.01  # probability below which the data are said to disagree with a gain
_NOTHING_LEFT = 1e-6  # of the output: prediction errors below are rounding, not noise
# How much larger the simulation's error may be, in log det for each output. On other data both models have the same
# noise in it, so that little is a lot; on the data of the fit the subspace model has fitted the noise.
_SAME = 1e-3  # a change of the prediction error that counts as none, in log det for each output
_WORSE = {"other": 0.02, "own": 0.1}


def refined(
    result: SubspaceEstimate, prepared: PreparedData, other: Experiment | None, request: Identify
) -> tuple[SubspaceEstimate, Refinement, IdentifiedModel | None]:
    """Return the better estimate, how it was refined, and a rival.

    The rival is a model of a higher order that explains significantly more; the regions of the response allow for it.

    Args:
        result: of the subspaces.
        prepared: the data of the fit.
        other: data to validate with; None: those of the fit.
        request: with the options.
    """
    gains = _gains(request, prepared)
    if request.refine == "never":
        return result, NOT_REFINED, None
    if _noise_free(result.model, prepared):
        if request.refine == "always" or gains is not None:
            raise InputError(f"{prepared.data.name}: the data are free of noise: there is nothing to refine")
        return result, Refinement(taken=False, reason="the data are free of noise"), None
    direct = request.closed_loop == "direct"
    best = refined_model(result.model, prepared.u, prepared.y, wished(result, prepared, request))
    if best is None and gains is not None:
        raise InputError(
            f"{prepared.data.name}: no model of this order has the gains {_told(request)}; leave gains out"
        )
    if best is None:
        return result, Refinement(taken=False, reason="no model has a finite prediction of these data"), None
    taken, reason = _judged(result.model, best, prepared, other, closed=direct)
    if request.refine == "always" or request.closed_loop is not None or gains is not None:
        taken = True
    if not taken:
        reason += "; so there are no regions of poles and response, which refine=always gives"
    elif best.model.spread is None:
        reason += "; the data leave a direction of the parameters open, so there are no regions of poles and response"
    reason += _agreement(best, request)
    words = _refinement(best, taken=taken, reason=reason)
    if not taken:
        return result, words, None
    return _in_place(result, best), words, best.above


def wished(result: SubspaceEstimate, prepared: PreparedData, request: Identify) -> SelectionOptions:
    """Return what the refined model is to be.

    Args:
        result: of the subspaces.
        prepared: the data of the fit.
        request: with the options.

    Raises:
        InputError: a gain between channels that the data do not have.
    """
    return SelectionOptions(
        order=result.order if request.order != "auto" or request.biased else None,
        noise=None if request.noise == "auto" else request.noise,
        most=request.max_order,
        feedthrough=request.feedthrough,
        stable=request.stable,
        closed_loop=request.closed_loop == "direct",
        gains=_gains(request, prepared),
    )


def _gains(request: Identify, prepared: PreparedData) -> Floats | None:
    """Return the gains that are held, shape (p, m) with the inputs that join experiments; None: there are none."""
    if not request.gains:
        return None
    data = prepared.data
    places = {f"{y}/{u}": (i, j) for i, y in enumerate(data.output_names) for j, u in enumerate(data.input_names)}
    result = np.full((prepared.y.shape[1], prepared.u.shape[1]), np.nan)
    for name, value in request.gains.items():
        if name not in places:
            raise InputError(f"gains: '{name}' is not an output/input of {data.name}; {suggest(name, places)}")
        if not math.isfinite(value):
            raise InputError(f"gains: {name} is not a finite number: {value:g}")
        result[places[name]] = value
    return result


def _told(request: Identify) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in (request.gains or {}).items())


def _agreement(best: RefinedModel, request: Identify) -> str:
    """Return what is held, and whether the data agree; empty: nothing is."""
    if not request.gains:
        return ""
    p = best.chosen.agree
    words = "not known" if p is None else f"the data {'agree' if p >= _DOUBT else 'disagree'} (p = {p:.2g})"
    return f"; steady gain held: {_told(request)}, {words}"


def _noise_free(model: IdentifiedModel, prepared: PreparedData) -> bool:
    left = np.sqrt(np.maximum(np.diag(model.covariance), 0.0))
    return bool(np.all(left <= _NOTHING_LEFT * np.sqrt(np.mean(prepared.y**2, axis=0))))


def _judged(
    before: IdentifiedModel, best: RefinedModel, prepared: PreparedData, other: Experiment | None, *, closed: bool
) -> tuple[bool, str]:
    """Return whether the refined model is taken, and why."""
    after = best.model
    where = "the data of the fit" if other is None else other.name
    models = [before, after]
    u, y = prepared.u, prepared.y
    if other is not None:
        own = [without_joints(m, len(prepared.u0)) for m in models]
        models = [_at(m, prepared.u0, prepared.y0) for m in own]
        u, y = _channels(own[0], prepared, other)
    predicted = [cost(y - m.predict(u, y)) for m in models]
    simulated = [_simulation_cost(m, u, y) for m in models]
    p = len(before.y0)
    reason = f"on {where} the prediction error changes by {_change(predicted, p)}"
    better = predicted[1] < predicted[0] + max(_SAME * p, 0.0 if other is not None else _saved(before, best, len(u)))
    if not after.is_stable:
        if before.is_stable and not closed:
            return False, f"{reason}, but the model is unstable and has no simulation; refine=always takes it"
        return better, reason
    reason += f", the simulation error by {_change(simulated, p)}" if before.is_stable else ""
    worse = _WORSE["own" if other is None else "other"]
    return better and (closed or simulated[1] <= simulated[0] + worse * p), reason


def _saved(before: IdentifiedModel, best: RefinedModel, samples: int) -> float:
    """Return what the numbers that the refined model has less are worth, by the Bayesian criterion, in log det.

    Those of the predictor's gain follow the noise of the fit, where a disturbance is white.
    """
    (p, m), n = before.D.shape, before.undelayed().order
    fewer = n * (2 * p + m) + p * m - best.chosen.refined.freedom
    return float(fewer * math.log(samples) / samples)


def _change(costs: list[float], outputs: int) -> str:
    return f"{100.0 * math.expm1(min((costs[1] - costs[0]) / (2.0 * outputs), 50.0)):+.2g} %"


def _simulation_cost(model: IdentifiedModel, u: Floats, y: Floats) -> float:
    return cost(y - model.simulate(u, model.initial_state(u, y))) if model.is_stable else math.inf


def _at(model: IdentifiedModel, u0: Floats, y0: Floats) -> IdentifiedModel:
    return replace(model, u0=u0, y0=model.y0 + y0)


def _channels(model: IdentifiedModel, prepared: PreparedData, other: Experiment) -> tuple[Floats, Floats]:
    named = model.named(input_names=prepared.data.input_names, output_names=prepared.data.output_names)
    given = suited(named, other)
    return given.u, given.y


def _refinement(best: RefinedModel, *, taken: bool, reason: str) -> Refinement:
    refined = best.chosen.refined
    return Refinement(
        taken=taken, reason=reason, order=refined.model.plant, noise_order=refined.model.disturbance,
        shared=refined.model.shared, steps=refined.steps, settled=refined.settled, tried=best.chosen.tried,
    )  # fmt: skip


def _in_place(result: SubspaceEstimate, best: RefinedModel) -> SubspaceEstimate:
    """Return the estimate with the refined model in place of its own."""
    order = best.chosen.refined.model.plant
    if result.order_reason == "given":
        return replace(result, model=best.model, stabilised=0)
    why = f"smallest Bayesian criterion of the prediction error among {len(best.chosen.tried)} structures"
    least = {n: min(c.criterion for c in best.chosen.tried if c.order == n) for n in (order - 1, order, order + 1)
             if any(c.order == n for c in best.chosen.tried)}  # fmt: skip
    for n in (order - 1, order + 1):
        if n in least:
            why += f"; order {n} would raise it by {least[n] - least[order]:.4g}"
    if order != result.order:
        why += f"; the simulation error alone would take {result.order}"
    return replace(result, model=best.model, order=order, order_reason=why, stabilised=0)
