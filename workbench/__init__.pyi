from workbench.analysis.advice import Advice as Advice
from workbench.analysis.advice import Finding as Finding
from workbench.analysis.advice.advise import advise as advise
from workbench.analysis.branches.request import branches as branches
from workbench.analysis.branches.result import (
    BranchesResult as BranchesResult,
)
from workbench.analysis.branches.result import (
    Fold as Fold,
)
from workbench.analysis.branches.result import (
    Onset as Onset,
)
from workbench.analysis.branches.result import (
    ResponseBranch as ResponseBranch,
)
from workbench.analysis.check.request import check as check
from workbench.analysis.check.result import HealthCard as HealthCard
from workbench.analysis.check.result import HealthLine as HealthLine
from workbench.analysis.delays.request import delays as delays
from workbench.analysis.delays.result import DelayReport as DelayReport
from workbench.analysis.delays.result import NoDelays as NoDelays
from workbench.analysis.describing.base import Block as Block
from workbench.analysis.describing.describe import (
    DescribingFunction as DescribingFunction,
)
from workbench.analysis.describing.describe import (
    describing_function as describing_function,
)
from workbench.analysis.describing.describe import (
    standard_block as standard_block,
)
from workbench.analysis.excite.multisine import MultisineDesign as MultisineDesign
from workbench.analysis.excite.prbs import PrbsDesign as PrbsDesign
from workbench.analysis.excite.request import excite as excite
from workbench.analysis.excite.result import ExciteResult as ExciteResult
from workbench.analysis.experiment.experiment import (
    Experiment as Experiment,
)
from workbench.analysis.experiment.experiment import (
    make_experiment as make_experiment,
)
from workbench.analysis.experiment.experiment import (
    read_experiment as read_experiment,
)
from workbench.analysis.feed_forward.request import feed_forward as feed_forward
from workbench.analysis.feed_forward.result import FeedForwardResult as FeedForwardResult
from workbench.analysis.feed_forward.step import FilterStep as FilterStep
from workbench.analysis.feed_forward.trial import Trial as Trial
from workbench.analysis.feedback.request import feedback as feedback
from workbench.analysis.feedback.result import FeedbackResult as FeedbackResult
from workbench.analysis.feedback.run import FeedbackRun as FeedbackRun
from workbench.analysis.feedback.settling import SettlingStudy as SettlingStudy
from workbench.analysis.identified.model import IdentifiedModel as IdentifiedModel
from workbench.analysis.identify.request import identify as identify
from workbench.analysis.identify.result import IdentifyResult as IdentifyResult
from workbench.analysis.info.request import info as info
from workbench.analysis.info.result import FmuInfo as FmuInfo
from workbench.analysis.info.result import SystemInfo as SystemInfo
from workbench.analysis.limit_cycle.branch import Branch as Branch
from workbench.analysis.limit_cycle.branch import BranchPoint as BranchPoint
from workbench.analysis.limit_cycle.free_run import FreeRun as FreeRun
from workbench.analysis.limit_cycle.request import limit_cycle as limit_cycle
from workbench.analysis.limit_cycle.result import (
    LimitCycle as LimitCycle,
)
from workbench.analysis.limit_cycle.result import (
    LimitCycleResult as LimitCycleResult,
)
from workbench.analysis.limit_cycle.result import (
    SimulatedCycle as SimulatedCycle,
)
from workbench.analysis.lin.compare import LinComparison as LinComparison
from workbench.analysis.lin.compare import Verdict as Verdict
from workbench.analysis.lin.request import compare as compare
from workbench.analysis.lin.request import lin as lin
from workbench.analysis.lin.request import lin_along as lin_along
from workbench.analysis.lin.request import lin_over as lin_over
from workbench.analysis.lin.result import Doubt as Doubt
from workbench.analysis.lin.result import LinResult as LinResult
from workbench.analysis.lin.result import Zero as Zero
from workbench.analysis.lin.state_space import LinearModel as LinearModel
from workbench.analysis.lin.step_check import StepCheck as StepCheck
from workbench.analysis.lin.step_check import step_check as step_check
from workbench.analysis.lin.sweep import LinGrid as LinGrid
from workbench.analysis.lin.sweep import LinPoint as LinPoint
from workbench.analysis.loop.request import loop as loop
from workbench.analysis.loop.result import LoopResult as LoopResult
from workbench.analysis.modes.request import modes as modes
from workbench.analysis.modes.result import (
    Critical as Critical,
)
from workbench.analysis.modes.result import (
    Mode as Mode,
)
from workbench.analysis.modes.result import (
    ModeSet as ModeSet,
)
from workbench.analysis.modes.result import (
    ModesMeeting as ModesMeeting,
)
from workbench.analysis.modes.result import (
    ModesResult as ModesResult,
)
from workbench.analysis.motions.measures import Measure as Measure
from workbench.analysis.motions.request import compare_motions as compare_motions
from workbench.analysis.motions.result import (
    Motion as Motion,
)
from workbench.analysis.motions.result import (
    MotionComparison as MotionComparison,
)
from workbench.analysis.motions.result import (
    MotionFailed as MotionFailed,
)
from workbench.analysis.motions.result import (
    MotionHistory as MotionHistory,
)
from workbench.analysis.nfr.certificate import Certificate as Certificate
from workbench.analysis.nfr.point import NfrPoint as NfrPoint
from workbench.analysis.nfr.request import Nfr as Nfr
from workbench.analysis.nfr.request import nfr as nfr
from workbench.analysis.nfr.result import FailedPoint as FailedPoint
from workbench.analysis.nfr.result import NfrResult as NfrResult
from workbench.analysis.nfr.run import NfrSweep as NfrSweep
from workbench.analysis.nfr.zero_input import ZeroInput as ZeroInput
from workbench.analysis.nyquist.nyquist import nyquist as nyquist
from workbench.analysis.nyquist.result import Crossing as Crossing
from workbench.analysis.nyquist.result import NyquistResult as NyquistResult
from workbench.analysis.preprocess import (
    cut_settling as cut_settling,
)
from workbench.analysis.preprocess import (
    detrend as detrend,
)
from workbench.analysis.preprocess import (
    remove_offset as remove_offset,
)
from workbench.analysis.preprocess import (
    remove_outliers as remove_outliers,
)
from workbench.analysis.preprocess import (
    resample as resample,
)
from workbench.analysis.preprocess import (
    scale as scale,
)
from workbench.analysis.reduction.balanced import (
    BalancedReduction as BalancedReduction,
)
from workbench.analysis.reduction.balanced import (
    balanced_reduction as balanced_reduction,
)
from workbench.analysis.simulate.divergence import Divergence as Divergence
from workbench.analysis.simulate.divergence import DivergenceError as DivergenceError
from workbench.analysis.simulate.request import simulate as simulate
from workbench.analysis.simulate.result import SimulationResult as SimulationResult
from workbench.analysis.spectra import Coherence as Coherence
from workbench.analysis.spectra import SpectralDensity as SpectralDensity
from workbench.analysis.spectra import sdf as sdf
from workbench.analysis.spectra.coherence import coherence as coherence
from workbench.analysis.subspace import SubspaceEstimate as SubspaceEstimate
from workbench.analysis.subspace.estimate import estimate as estimate
from workbench.analysis.trim.request import trim as trim
from workbench.analysis.trim.result import TrimResult as TrimResult
from workbench.analysis.validate import (
    Overlay as Overlay,
)
from workbench.analysis.validate import (
    PoleBootstrap as PoleBootstrap,
)
from workbench.analysis.validate import (
    Validation as Validation,
)
from workbench.analysis.validate import (
    bootstrap_poles as bootstrap_poles,
)
from workbench.analysis.validate.overlay import overlay as overlay
from workbench.analysis.validate.validate import validate as validate
from workbench.build.export import ExportResult as ExportResult
from workbench.core.linear import Linear as Linear
from workbench.core.linear import LinearPart as LinearPart
from workbench.core.margins import Margins as Margins
from workbench.core.operating_point import OperatingPoint as OperatingPoint
from workbench.core.response import Response as Response
from workbench.core.response import ResponseDifference as ResponseDifference
from workbench.errors import (
    BuildError as BuildError,
)
from workbench.errors import (
    CrashedError as CrashedError,
)
from workbench.errors import (
    ExitedError as ExitedError,
)
from workbench.errors import (
    FmuError as FmuError,
)
from workbench.errors import (
    InputError as InputError,
)
from workbench.errors import (
    LostError as LostError,
)
from workbench.errors import (
    OutOfMemoryError as OutOfMemoryError,
)
from workbench.errors import (
    SimulationError as SimulationError,
)
from workbench.errors import (
    StoppedError as StoppedError,
)
from workbench.errors import (
    TimedOutError as TimedOutError,
)
from workbench.errors import (
    WorkbenchError as WorkbenchError,
)
from workbench.model import FmuModel as FmuModel
from workbench.model import Model as Model
from workbench.model import Variable as Variable
from workbench.model.described import DescribedModel as DescribedModel
from workbench.session import Recorded as Recorded
from workbench.session import Session as Session
from workbench.session import Snapshot as Snapshot
from workbench.signals import (
    Constant as Constant,
)
from workbench.signals import (
    Prbs as Prbs,
)
from workbench.signals import (
    Signal as Signal,
)
from workbench.signals import (
    Sine as Sine,
)
from workbench.signals import (
    Step as Step,
)
from workbench.signals import (
    Table as Table,
)
from workbench.signals import (
    gust as gust,
)
from workbench.signals import (
    parse_signal as parse_signal,
)
from workbench.signals import (
    pulse as pulse,
)
from workbench.study.result import StudyResult as StudyResult
from workbench.study.run import run_study as run_study
from workbench.system.connect import connect as connect
from workbench.system.container import ContainerResult as ContainerResult
from workbench.system.container import export_container as export_container
from workbench.system.description import (
    Connection as Connection,
)
from workbench.system.description import (
    FmuComponent as FmuComponent,
)
from workbench.system.description import (
    FunctionComponent as FunctionComponent,
)
from workbench.system.description import (
    GainComponent as GainComponent,
)
from workbench.system.description import (
    LinearComponent as LinearComponent,
)
from workbench.system.description import (
    SumComponent as SumComponent,
)
from workbench.system.description import (
    SystemDescription as SystemDescription,
)
from workbench.system.load import load as load
from workbench.system.master.model import MasterModel as MasterModel
from workbench.system.model import SystemModel as SystemModel
from workbench.system.read import read_system as read_system
from workbench.system.ssp_write import write_ssp as write_ssp
from workbench.to_fmu.request import export as export
from workbench.workers import Workers as Workers
from workbench.workers.cluster import Cluster as Cluster

__all__: list[str]  # noqa: PYI035 - the names above
__version__: str
