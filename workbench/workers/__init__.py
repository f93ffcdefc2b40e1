"""Worker processes: run functions of a model where a crash of the FMU harms nobody.

An analysis describes its work as a generator function of a model and a job (`Task`) and hands a queue of
jobs to a `Runner`; which runner that is, this process, worker processes or any executor, `choose` decides. `at_work`
lets the job note what is to be told of how they ran.
"""

from workbench.core.where import DEFAULT_TIMEOUT, Limits, Workers
from workbench.workers.choose import at_work, choose
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
    "at_work",
    "choose",
    "perform",
]
