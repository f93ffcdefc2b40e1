"""Worker processes: run functions of a model where a crash of the FMU harms nobody.

An analysis describes its work as a generator function of a model and a job (`Task`) and hands a queue of
jobs to a `Runner`; which runner that is, this process, worker processes or any executor, `choose` decides.
"""

from workbench.core.where import DEFAULT_TIMEOUT, Limits, Workers
from workbench.workers.choose import choose
from workbench.workers.runner import InProcess, Job, Lost, Remark, Reply, Runner, perform

__all__ = [
    "DEFAULT_TIMEOUT",
    "InProcess",
    "Job",
    "Limits",
    "Lost",
    "Remark",
    "Reply",
    "Runner",
    "Workers",
    "choose",
    "perform",
]
