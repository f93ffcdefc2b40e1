"""Identification experiments: design a signal, run the model, record."""

from workbench.analysis.excite.design import Design
from workbench.analysis.excite.multisine import MultisineDesign
from workbench.analysis.excite.parse import parse_design
from workbench.analysis.excite.prbs import PrbsDesign
from workbench.analysis.excite.record import Excitation, excite
from workbench.analysis.excite.result import ExciteResult, SignalFacts

__all__ = [
    "Design",
    "Excitation",
    "ExciteResult",
    "MultisineDesign",
    "PrbsDesign",
    "SignalFacts",
    "excite",
    "parse_design",
]
