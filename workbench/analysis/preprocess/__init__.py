"""Pre-processing of recorded data: each step returns new data and says what was done."""

from workbench.analysis.preprocess.detrend import Detrended, detrend, remove_offset
from workbench.analysis.preprocess.flat import Flat
from workbench.analysis.preprocess.outliers import OutliersRemoved, remove_outliers
from workbench.analysis.preprocess.prepared import Prepared
from workbench.analysis.preprocess.resample import Resampled, resample
from workbench.analysis.preprocess.scale import Scaled, scale
from workbench.analysis.preprocess.settle import WithoutStart, cut_settling, settling_samples

__all__ = [
    "Detrended",
    "Flat",
    "OutliersRemoved",
    "Prepared",
    "Resampled",
    "Scaled",
    "WithoutStart",
    "cut_settling",
    "detrend",
    "remove_offset",
    "remove_outliers",
    "resample",
    "scale",
    "settling_samples",
]
