"""FMI workbench: analyses of FMUs from Python and from the command line.

```python
import workbench as wb

with wb.load("fmu:Rudder") as rudder:
    result = wb.nfr(rudder, "delC", "del", band=(0.5, 20.0), amplitudes=[1.0, 4.0])
result.plot("bode.png")
```

Names are loaded when they are first used, so that importing the package is quick.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # as type checkers know it; importing typing would take the longest of importing the package
if TYPE_CHECKING:
    from workbench.analysis.advice import Advice, Finding
    from workbench.analysis.advice.advise import advise
    from workbench.analysis.bla.request import bla
    from workbench.analysis.bla.result import BlaResult
    from workbench.analysis.bla.run import best_linear
    from workbench.analysis.branches.request import branches
    from workbench.analysis.branches.result import BranchesResult, Fold, Onset, ResponseBranch
    from workbench.analysis.check.request import check
    from workbench.analysis.check.result import HealthCard, HealthLine
    from workbench.analysis.delays.request import delays
    from workbench.analysis.delays.result import DelayReport, NoDelays
    from workbench.analysis.describing.base import Block
    from workbench.analysis.describing.describe import DescribingFunction, describing_function, standard_block
    from workbench.analysis.excite.multisine import MultisineDesign
    from workbench.analysis.excite.prbs import PrbsDesign
    from workbench.analysis.excite.request import excite
    from workbench.analysis.excite.result import ExciteResult
    from workbench.analysis.experiment.experiment import Experiment, make_experiment, read_experiment
    from workbench.analysis.feed_forward.request import feed_forward
    from workbench.analysis.feed_forward.result import FeedForwardResult
    from workbench.analysis.feed_forward.step import FilterStep
    from workbench.analysis.feed_forward.trial import Trial
    from workbench.analysis.feedback.request import feedback
    from workbench.analysis.feedback.result import FeedbackResult
    from workbench.analysis.feedback.run import FeedbackRun
    from workbench.analysis.feedback.settling import SettlingStudy
    from workbench.analysis.fit.request import fit
    from workbench.analysis.fit.result import FitResult
    from workbench.analysis.identified.model import IdentifiedModel
    from workbench.analysis.identify.request import identify
    from workbench.analysis.identify.result import IdentifyResult
    from workbench.analysis.info.request import info
    from workbench.analysis.info.result import FmuInfo, SystemInfo
    from workbench.analysis.limit_cycle.branch import Branch, BranchPoint
    from workbench.analysis.limit_cycle.free_run import FreeRun
    from workbench.analysis.limit_cycle.request import limit_cycle
    from workbench.analysis.limit_cycle.result import LimitCycle, LimitCycleResult, SimulatedCycle
    from workbench.analysis.lin.compare import LinComparison, Verdict
    from workbench.analysis.lin.request import compare, lin, lin_along, lin_over
    from workbench.analysis.lin.result import Doubt, LinResult, Zero
    from workbench.analysis.lin.state_space import LinearModel
    from workbench.analysis.lin.step_check import StepCheck, step_check
    from workbench.analysis.lin.sweep import LinGrid, LinPoint
    from workbench.analysis.loop.request import loop
    from workbench.analysis.loop.result import LoopResult
    from workbench.analysis.modes.request import modes
    from workbench.analysis.modes.result import Critical, Mode, ModeSet, ModesMeeting, ModesResult
    from workbench.analysis.motions.measures import Measure
    from workbench.analysis.motions.request import compare_motions
    from workbench.analysis.motions.result import Motion, MotionComparison, MotionFailed, MotionHistory
    from workbench.analysis.nfr.certificate import Certificate
    from workbench.analysis.nfr.point import NfrPoint
    from workbench.analysis.nfr.request import Nfr, nfr
    from workbench.analysis.nfr.result import FailedPoint, NfrResult
    from workbench.analysis.nfr.run import NfrSweep
    from workbench.analysis.nfr.zero_input import ZeroInput
    from workbench.analysis.nyquist.nyquist import nyquist
    from workbench.analysis.nyquist.result import Crossing, NyquistResult
    from workbench.analysis.preprocess import cut_settling, detrend, remove_offset, remove_outliers, resample, scale
    from workbench.analysis.reduction.balanced import BalancedReduction, balanced_reduction
    from workbench.analysis.simulate.divergence import Divergence, DivergenceError
    from workbench.analysis.simulate.request import simulate
    from workbench.analysis.simulate.result import SimulationResult
    from workbench.analysis.spectra import Coherence, SpectralDensity, sdf
    from workbench.analysis.spectra.coherence import coherence
    from workbench.analysis.subspace import SubspaceEstimate
    from workbench.analysis.subspace.estimate import estimate
    from workbench.analysis.trim.request import trim
    from workbench.analysis.trim.result import TrimResult
    from workbench.analysis.validate import (
        ModelSpread,
        Overlay,
        PoleBootstrap,
        Validation,
        bootstrap_poles,
        model_spread,
    )
    from workbench.analysis.validate.overlay import overlay
    from workbench.analysis.validate.validate import validate
    from workbench.build.export import ExportResult
    from workbench.core.linear import Linear, LinearPart
    from workbench.core.margins import Margins
    from workbench.core.operating_point import OperatingPoint
    from workbench.core.response import Response, ResponseDifference
    from workbench.errors import (
        BuildError,
        CrashedError,
        ExitedError,
        FmuError,
        InputError,
        LostError,
        OutOfMemoryError,
        SimulationError,
        StoppedError,
        TimedOutError,
        WorkbenchError,
    )
    from workbench.model import FmuModel, Model, Variable
    from workbench.model.described import DescribedModel
    from workbench.session import Recorded, Session, Snapshot
    from workbench.signals import Constant, Prbs, Signal, Sine, Step, Table, gust, parse_signal, pulse
    from workbench.study.result import StudyResult
    from workbench.study.run import run_study
    from workbench.system.connect import connect
    from workbench.system.container import ContainerResult, export_container
    from workbench.system.description import (
        Connection,
        FmuComponent,
        FunctionComponent,
        GainComponent,
        LinearComponent,
        SumComponent,
        SystemDescription,
    )
    from workbench.system.load import load
    from workbench.system.master.model import MasterModel
    from workbench.system.model import SystemModel
    from workbench.system.read import read_system
    from workbench.system.ssp_write import write_ssp
    from workbench.to_fmu.request import export
    from workbench.workers import Workers
    from workbench.workers.cluster import Cluster

__version__ = "0.1.0"

__all__ = [
    "Advice",
    "BalancedReduction",
    "BlaResult",
    "Block",
    "Branch",
    "BranchPoint",
    "BranchesResult",
    "BuildError",
    "Certificate",
    "Cluster",
    "Coherence",
    "Connection",
    "Constant",
    "ContainerResult",
    "CrashedError",
    "Critical",
    "Crossing",
    "DelayReport",
    "DescribedModel",
    "DescribingFunction",
    "Divergence",
    "DivergenceError",
    "Doubt",
    "ExciteResult",
    "ExitedError",
    "Experiment",
    "ExportResult",
    "FailedPoint",
    "FeedForwardResult",
    "FeedbackResult",
    "FeedbackRun",
    "FilterStep",
    "Finding",
    "FitResult",
    "FmuComponent",
    "FmuError",
    "FmuInfo",
    "FmuModel",
    "Fold",
    "FreeRun",
    "FunctionComponent",
    "GainComponent",
    "HealthCard",
    "HealthLine",
    "IdentifiedModel",
    "IdentifyResult",
    "InputError",
    "LimitCycle",
    "LimitCycleResult",
    "LinComparison",
    "LinGrid",
    "LinPoint",
    "LinResult",
    "Linear",
    "LinearComponent",
    "LinearModel",
    "LinearPart",
    "LoopResult",
    "LostError",
    "Margins",
    "MasterModel",
    "Measure",
    "Mode",
    "ModeSet",
    "Model",
    "ModelSpread",
    "ModesMeeting",
    "ModesResult",
    "Motion",
    "MotionComparison",
    "MotionFailed",
    "MotionHistory",
    "MultisineDesign",
    "Nfr",
    "NfrPoint",
    "NfrResult",
    "NfrSweep",
    "NoDelays",
    "NyquistResult",
    "Onset",
    "OperatingPoint",
    "OutOfMemoryError",
    "Overlay",
    "PoleBootstrap",
    "Prbs",
    "PrbsDesign",
    "Recorded",
    "Response",
    "ResponseBranch",
    "ResponseDifference",
    "Session",
    "SettlingStudy",
    "Signal",
    "SimulatedCycle",
    "SimulationError",
    "SimulationResult",
    "Sine",
    "Snapshot",
    "SpectralDensity",
    "Step",
    "StepCheck",
    "StoppedError",
    "StudyResult",
    "SubspaceEstimate",
    "SumComponent",
    "SystemDescription",
    "SystemInfo",
    "SystemModel",
    "Table",
    "TimedOutError",
    "Trial",
    "TrimResult",
    "Validation",
    "Variable",
    "Verdict",
    "WorkbenchError",
    "Workers",
    "Zero",
    "ZeroInput",
    "advise",
    "balanced_reduction",
    "best_linear",
    "bla",
    "bootstrap_poles",
    "branches",
    "check",
    "coherence",
    "compare",
    "compare_motions",
    "connect",
    "cut_settling",
    "delays",
    "describing_function",
    "detrend",
    "estimate",
    "excite",
    "export",
    "export_container",
    "feed_forward",
    "feedback",
    "fit",
    "gust",
    "identify",
    "info",
    "limit_cycle",
    "lin",
    "lin_along",
    "lin_over",
    "load",
    "loop",
    "make_experiment",
    "model_spread",
    "modes",
    "nfr",
    "nyquist",
    "overlay",
    "parse_signal",
    "pulse",
    "read_experiment",
    "read_system",
    "remove_offset",
    "remove_outliers",
    "resample",
    "run_study",
    "scale",
    "sdf",
    "simulate",
    "standard_block",
    "step_check",
    "trim",
    "validate",
    "write_ssp",
]

_HOMES = {
    "workbench.analysis.delays.request": ("delays",),
    "workbench.analysis.delays.result": ("DelayReport", "NoDelays"),
    "workbench.analysis.describing.base": ("Block",),
    "workbench.analysis.describing.describe": ("DescribingFunction", "describing_function", "standard_block"),
    "workbench.analysis.limit_cycle.branch": ("Branch", "BranchPoint"),
    "workbench.analysis.limit_cycle.free_run": ("FreeRun",),
    "workbench.analysis.limit_cycle.request": ("limit_cycle",),
    "workbench.analysis.limit_cycle.result": ("LimitCycle", "LimitCycleResult", "SimulatedCycle"),
    "workbench.core.linear": ("Linear", "LinearPart"),
    "workbench.core.response": ("Response", "ResponseDifference"),
    "workbench.analysis.nyquist.nyquist": ("nyquist",),
    "workbench.analysis.nyquist.result": ("Crossing", "NyquistResult"),
    "workbench.core.margins": ("Margins",),
    "workbench.analysis.loop.request": ("loop",),
    "workbench.analysis.loop.result": ("LoopResult",),
    "workbench.build.export": ("ExportResult",),
    "workbench.to_fmu.request": ("export",),
    "workbench.analysis.advice": ("Advice", "Finding", "advise"),
    "workbench.analysis.excite.multisine": ("MultisineDesign",),
    "workbench.analysis.excite.prbs": ("PrbsDesign",),
    "workbench.analysis.excite.request": ("excite",),
    "workbench.analysis.excite.result": ("ExciteResult",),
    "workbench.analysis.experiment.experiment": ("Experiment", "make_experiment", "read_experiment"),
    "workbench.analysis.simulate.divergence": ("Divergence", "DivergenceError"),
    "workbench.analysis.feed_forward.request": ("feed_forward",),
    "workbench.analysis.feed_forward.result": ("FeedForwardResult",),
    "workbench.analysis.feed_forward.step": ("FilterStep",),
    "workbench.analysis.feed_forward.trial": ("Trial",),
    "workbench.analysis.feedback.request": ("feedback",),
    "workbench.analysis.feedback.result": ("FeedbackResult",),
    "workbench.analysis.feedback.run": ("FeedbackRun",),
    "workbench.analysis.feedback.settling": ("SettlingStudy",),
    "workbench.analysis.reduction.balanced": ("BalancedReduction", "balanced_reduction"),
    "workbench.analysis.identified.model": ("IdentifiedModel",),
    "workbench.analysis.fit.request": ("fit",),
    "workbench.analysis.fit.result": ("FitResult",),
    "workbench.analysis.identify.request": ("identify",),
    "workbench.analysis.info.request": ("info",),
    "workbench.analysis.info.result": ("FmuInfo", "SystemInfo"),
    "workbench.analysis.identify.result": ("IdentifyResult",),
    "workbench.analysis.preprocess": (
        "cut_settling",
        "detrend",
        "remove_offset",
        "remove_outliers",
        "resample",
        "scale",
    ),
    "workbench.analysis.spectra": ("Coherence", "SpectralDensity", "coherence", "sdf"),
    "workbench.analysis.subspace": ("SubspaceEstimate", "estimate"),
    "workbench.analysis.validate": (
        "ModelSpread",
        "Overlay",
        "PoleBootstrap",
        "Validation",
        "bootstrap_poles",
        "model_spread",
        "overlay",
        "validate",
    ),
    "workbench.analysis.nfr.certificate": ("Certificate",),
    "workbench.analysis.bla.request": ("bla",),
    "workbench.analysis.bla.result": ("BlaResult",),
    "workbench.analysis.bla.run": ("best_linear",),
    "workbench.analysis.branches.request": ("branches",),
    "workbench.analysis.branches.result": ("BranchesResult", "Fold", "Onset", "ResponseBranch"),
    "workbench.analysis.check.request": ("check",),
    "workbench.analysis.check.result": ("HealthCard", "HealthLine"),
    "workbench.analysis.lin.compare": ("LinComparison", "Verdict"),
    "workbench.analysis.lin.request": ("compare", "lin", "lin_along", "lin_over"),
    "workbench.analysis.lin.result": ("Doubt", "LinResult", "Zero"),
    "workbench.analysis.lin.state_space": ("LinearModel",),
    "workbench.analysis.lin.step_check": ("StepCheck", "step_check"),
    "workbench.analysis.lin.sweep": ("LinGrid", "LinPoint"),
    "workbench.analysis.motions.measures": ("Measure",),
    "workbench.analysis.motions.request": ("compare_motions",),
    "workbench.analysis.motions.result": ("Motion", "MotionComparison", "MotionFailed", "MotionHistory"),
    "workbench.analysis.modes.request": ("modes",),
    "workbench.analysis.modes.result": ("Critical", "Mode", "ModeSet", "ModesMeeting", "ModesResult"),
    "workbench.analysis.nfr.request": ("Nfr", "nfr"),
    "workbench.analysis.nfr.run": ("NfrSweep",),
    "workbench.analysis.nfr.point": ("NfrPoint",),
    "workbench.analysis.nfr.result": ("FailedPoint", "NfrResult"),
    "workbench.analysis.simulate.request": ("simulate",),
    "workbench.analysis.simulate.result": ("SimulationResult",),
    "workbench.core.operating_point": ("OperatingPoint",),
    "workbench.analysis.trim.request": ("trim",),
    "workbench.analysis.trim.result": ("TrimResult",),
    "workbench.analysis.nfr.zero_input": ("ZeroInput",),
    "workbench.errors": (
        "BuildError",
        "CrashedError",
        "ExitedError",
        "FmuError",
        "InputError",
        "LostError",
        "OutOfMemoryError",
        "SimulationError",
        "StoppedError",
        "TimedOutError",
        "WorkbenchError",
    ),
    "workbench.model": ("FmuModel", "Model", "Variable"),
    "workbench.model.described": ("DescribedModel",),
    "workbench.session": ("Recorded", "Session", "Snapshot"),
    "workbench.signals": ("Constant", "Prbs", "Signal", "Sine", "Step", "Table", "gust", "parse_signal", "pulse"),
    "workbench.study.result": ("StudyResult",),
    "workbench.study.run": ("run_study",),
    "workbench.system.connect": ("connect",),
    "workbench.system.container": ("ContainerResult", "export_container"),
    "workbench.system.description": (
        "Connection",
        "FmuComponent",
        "FunctionComponent",
        "GainComponent",
        "LinearComponent",
        "SumComponent",
        "SystemDescription",
    ),
    "workbench.system.load": ("load",),
    "workbench.system.master.model": ("MasterModel",),
    "workbench.system.model": ("SystemModel",),
    "workbench.system.read": ("read_system",),
    "workbench.system.ssp_write": ("write_ssp",),
    "workbench.workers": ("Workers",),
    "workbench.workers.cluster": ("Cluster",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import a public name from the module it lives in."""
    if name not in _HOME:
        raise AttributeError(f"module 'workbench' has no attribute '{name}'")
    from workbench.core.interrupts import insisting  # noqa: PLC0415 - so that importing the package is quick

    with insisting():
        value: object = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names."""
    return sorted([*globals(), *__all__])
