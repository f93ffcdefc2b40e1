"""Linear models of any FMU: one method a file, a table of them in `methods`."""

from workbench.analysis.lin.linearise import lin
from workbench.analysis.lin.result import LinearModel, LinResult

__all__ = ["LinResult", "LinearModel", "lin"]
