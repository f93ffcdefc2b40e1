"""An analysis declared once: its options, and where it is run.

A request is a frozen dataclass; each option is a field with its type, its unit and a sentence of help. The function in
Python, the command with its help, the table of a study and the reference page are derived from these fields. The
algorithm is named and imported when it is called: what is only asked about needs no numerics.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import KW_ONLY
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Concatenate, Generic, ParamSpec, TypeVar

from workbench.core.job import Job, Progress
from workbench.core.option import Options, option, options_of
from workbench.origin import with_origin

if TYPE_CHECKING:
    from workbench.model import Model

__all__ = ["Analysis", "function", "with_options"]

_Record = TypeVar("_Record")
_ARGUMENTS = "Args:"

_Options = ParamSpec("_Options")
_Asked = TypeVar("_Asked")
_Made = TypeVar("_Made")


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
    """

    command: ClassVar[str]
    algorithm: ClassVar[str]
    example: ClassVar[str]

    _: KW_ONLY
    progress: Progress | None = option(
        "Called after each finished part with what it is, the number done and the number in all.",
        default=None,
        python=True,
    )

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.__doc__ = _documented(cls)

    def run(self, model: Model, job: Job) -> _Record:
        """Run the analysis.

        Args:
            model: what is analysed; it stays open.
            job: is told what is finished.
        """
        module, _, name = self.algorithm.partition(":")
        record: _Record = getattr(import_module(module), name)(model, self, job)
        return record


def function(request: Callable[_Options, Analysis[_Record]]) -> Callable[Concatenate[Model, _Options], _Record]:
    """Return the function that runs a request on a model, with the request's options as its parameters.

    Args:
        request: class of the analysis.
    """
    kind: Any = request
    return with_origin()(with_options(request, _run, name=kind.command.replace("-", "_")))


def _run(model: Model, asked: Analysis[_Record]) -> _Record:
    return asked.run(model, Job(asked.progress))


def with_options(
    request: Callable[_Options, _Asked], make: Callable[[Model, _Asked], _Made], *, name: str, words: str = ""
) -> Callable[Concatenate[Model, _Options], _Made]:
    """Return a function of a model and the options of a request.

    Args:
        request: class of the analysis.
        make: what the function does with the model and the request.
        name: of the function.
        words: what comes before the docstring of the request.
    """
    kind: Any = request

    def call(model: Model, *args: _Options.args, **kwargs: _Options.kwargs) -> _Made:
        return make(model, request(*args, **kwargs))

    model = inspect.Parameter("model", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation="Model")
    own = inspect.signature(kind).parameters
    call.__signature__ = inspect.Signature([model, *(own[d.name] for d in options_of(kind))])  # type: ignore[attr-defined]
    call.__doc__ = f"{words}\n\n" if words else ""
    call.__doc__ += kind.__doc__.replace(_ARGUMENTS, f"{_ARGUMENTS}\n    model: The model to analyse; it stays open.")
    call.__name__ = call.__qualname__ = name
    call.__module__ = kind.__module__
    return call  # type: ignore[return-value]  # the model may be given by name, too, which Concatenate cannot say


def _documented(request: type[Analysis[Any]]) -> str:
    """Return the docstring with the options before what is returned."""
    head, returns, tail = inspect.cleandoc(request.__doc__ or "").partition("\nReturns:")
    lines = [_ARGUMENTS, *(f"    {d.name}: {d.help}" for d in options_of(request))]
    return "\n".join([head.rstrip(), "", *lines, "", *([f"{returns.strip()}{tail}"] if returns else [])])
