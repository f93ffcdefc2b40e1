"""Judge recorded data before fitting a model to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from workbench.core.machine.blas import one_thread
from workbench.data.advice.delay import judge_delay
from workbench.data.advice.excitation import excited_orders, is_single_sine, judge_excitation
from workbench.data.advice.feedback import judge_feedback
from workbench.data.advice.linearity import judge_linearity, judge_noise
from workbench.data.advice.record import (
    judge_length,
    judge_outliers,
    judge_sampling,
    judge_settling,
    judge_trend,
)
from workbench.data.advice.result import Advice, Finding
from workbench.data.advice.saturation import judge_saturation
from workbench.data.advice.shared_estimates import DataStudy
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, suggest
from workbench.requests.decorator import with_origin

__all__ = ["TOPICS", "advise"]

TOPICS: Mapping[str, Callable[[DataStudy], Finding]] = {
    "excitation": judge_excitation,
    "length": judge_length,
    "settling": judge_settling,
    "sampling": judge_sampling,
    "delay": judge_delay,
    "noise": judge_noise,
    "linearity": judge_linearity,
    "feedback": judge_feedback,
    "saturation": judge_saturation,
    "outliers": judge_outliers,
    "trend": judge_trend,
}


@with_origin()
def advise(
    experiment: Experiment,
    *,
    order: int | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    feedthrough: bool = True,
) -> Advice:
    """Judge data: excitation, length, sampling, delay, noise, linearity, feedback, saturation, outliers and more.

    Nothing is changed. Each finding has a verdict, the evidence in numbers and what to do. Of a long record the
    first 20 000 samples are judged.

    Args:
        experiment: recorded data, as they came: not detrended, not scaled.
        order: order of the model they are meant for; None: not known yet.
        limits: output → lowest and highest value that the system allows, where they are known; two-level inputs
            leave no other way to tell a limit from a settled response.
        feedthrough: the plant may have a direct feedthrough; False: it has none, so that inputs and outputs that move
            together within a sample are a sign of feedback.

    Raises:
        InputError: fewer than 40 samples, a limit for a column that is not an output.

    Examples:
        A constant input excites nothing.

        >>> import numpy as np
        >>> data = wb.make_experiment(0.1, u=np.ones(100), y=np.random.default_rng(0).standard_normal(100))
        >>> print([finding.topic for finding in wb.advise(data).concerns])
        ['excitation', 'delay', 'noise']
    """
    for name in limits or {}:
        if name not in experiment.output_names:
            raise InputError(f"limits: '{name}' is not an output of the data; {suggest(name, experiment.output_names)}")
    with one_thread():
        study = DataStudy(experiment, order=order, limits=limits, feedthrough=feedthrough)
        return Advice(
            experiment=experiment,
            findings=tuple(judge(study) for judge in TOPICS.values()),
            excited_orders=excited_orders(study),
            single_sine=is_single_sine(study),
            order=order,
        )
