"""Validation of identified models: one test a file, `validate` puts them together."""

from workbench.analysis.validate.bootstrap import PoleBootstrap, bootstrap_poles
from workbench.analysis.validate.estimator import same_settings
from workbench.analysis.validate.fit import ERROR_FIGURES, Fit, error_figure
from workbench.analysis.validate.overlay import Overlay, overlay
from workbench.analysis.validate.result import Validation
from workbench.analysis.validate.spread import ModelSpread, model_spread
from workbench.analysis.validate.validate import validate

__all__ = [
    "ERROR_FIGURES",
    "Fit",
    "ModelSpread",
    "Overlay",
    "PoleBootstrap",
    "Validation",
    "bootstrap_poles",
    "error_figure",
    "model_spread",
    "overlay",
    "same_settings",
    "validate",
]
