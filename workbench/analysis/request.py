"""An analysis declared once: its options, and where it is run.

A request is a frozen dataclass; each option is a field with its type, its unit and a sentence of help. The function in
Python, the command with its help, the table of a study and the reference page are derived from these fields. The
algorithm is named and imported when it is called: what is only asked about needs no numerics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Concatenate, Generic, ParamSpec, TypeVar

from workbench.core.job import Job, Progress
from workbench.core.option import Options, documented, option, with_options
from workbench.origin import with_origin

if TYPE_CHECKING:
    from workbench.model import Model

__all__ = ["Analysis", "function"]

_Record = TypeVar("_Record")
_Options = ParamSpec("_Options")

_FIRST = ("model", "Model", "The model to analyse; it stays open.")


class Analysis(Options, Generic[_Record]):
    """An analysis with its options: a value that can be run on a model.

    Obligations of a subclass:
      1. It is made of fields as `Options` says.
      2. The docstring's first paragraph stands in `--help`; equations and sources follow.
      3. Its module imports no numerics.
      4. The algorithm is a function of model, request and job. It tells the job what is finished, stops soon after
         `job.stop`, and leaves in `job.partial` what it has if it ends early.

    Attributes:
        command: name on the command line.
        algorithm: where it is, "module:function".
        example: a command line that works.
        usual_tolerance: relative, of the integration, where the command line names none; None: the model's own.
    """

    command: ClassVar[str]
    algorithm: ClassVar[str]
    example: ClassVar[str]
    usual_tolerance: ClassVar[float | None] = None

    _: KW_ONLY
    progress: Progress | None = option(
        "Called after each finished part with what it is, the number done and the number in all.",
        default=None,
        python=True,
    )

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.__doc__ = documented(cls)

    def run(self, model: Model, job: Job) -> _Record:
        """Run the analysis.

        Args:
            model: what is analysed; it stays open.
            job: is told what is finished.
        """
        module, _, name = self.algorithm.partition(":")
        record: _Record = getattr(import_module(module), name)(model, self, job)
        return record

    def went_well(self, record: _Record) -> bool:
        """Return whether the record is what was asked for; a command line ends with 1 otherwise.

        Args:
            record: of this request.
        """
        return True


def function(request: Callable[_Options, Analysis[_Record]]) -> Callable[Concatenate[Model, _Options], _Record]:
    """Return the function that runs a request on a model, with the request's options as its parameters.

    Args:
        request: class of the analysis.
    """
    kind: Any = request
    return with_origin()(with_options(request, _run, name=kind.command.replace("-", "_"), first=_FIRST))


def _run(model: Model, asked: Analysis[_Record]) -> _Record:
    return asked.run(model, Job(asked.progress))
