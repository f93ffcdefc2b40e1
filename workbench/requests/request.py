"""An analysis declared once: its options, and where it is run.

A request is a frozen dataclass; each option is a field with its type, its unit and a sentence of help. The function in
Python, the command with its help, the table of a study and the reference page are derived from these fields. The
algorithm is named and imported when it is called: what is only asked about needs no numerics.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, fields, is_dataclass, replace
from functools import partial
from os import PathLike
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Concatenate,
    ForwardRef,
    Generic,
    ParamSpec,
    Self,
    TypeVar,
    get_args,
)

from workbench.core.records.named import named
from workbench.core.records.option import (
    EACH,
    DeclaredOption,
    Options,
    asked_of,
    documented,
    option,
    options_of,
    parts_of,
    put_together,
    recast,
    with_options,
)
from workbench.core.records.quantity import quantities_in
from workbench.errors import InputError, SimulationError, StoppedError, WorkbenchError
from workbench.jobs.job import Job, Progress
from workbench.jobs.options import InWorker, Worker, Workers
from workbench.model.loading import Loading
from workbench.requests.decorator import with_origin
from workbench.requests.kept import origin_of, remember

if TYPE_CHECKING:
    from workbench.model import Model  # noqa: F401 - the subject's type, below

__all__ = [
    "MODEL_FILE",
    "ModelRequest",
    "Request",
    "Subject",
    "answered",
    "asked_options",
    "command_line_of",
    "function",
    "modules_of",
    "record_of",
    "request_from",
    "values_from",
]

_Subject = TypeVar("_Subject")
_Record = TypeVar("_Record")
_Options = ParamSpec("_Options")


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What a request is run on.

    Attributes:
        name: name of the argument.
        type: in Python.
        help: in Python.
        metavar: what `--help` shows in its place.
        words: help on the command line.
        argument: its name there and in studies; empty: the same.
        several: whether it is a list of such; the command line takes them one after the other.
        optional: whether a list may be empty.
        opened: whether it is a model that the command line and studies open; of several, name → model.
        rest: option that takes what the command line names behind it; empty: nothing more may be named.
    """

    name: str
    type: str
    help: str
    metavar: str
    words: str
    argument: str = ""
    several: bool = False
    optional: bool = False
    opened: bool = False
    rest: str = ""

    @property
    def spelt(self) -> str:
        """Name of the argument on the command line and in studies."""
        return self.argument or self.name

    @property
    def first(self) -> tuple[str, str, str]:
        """Name, type and help of the argument, as `with_options` takes them."""
        return self.name, self.type, self.help


class Request(Options, Generic[_Subject, _Record]):
    """Work with its options: a value that can be run on a model, on data, or on whatever its `subject` says.

    Obligations of a subclass:
      1. It is made of fields as `Options` says.
      2. The docstring's first paragraph and `details` are in `--help`; equations and sources follow.
      3. Its module imports no numerics.
      4. The algorithm is a function of subject, request and job. It tells the job what is finished. Before each
         `job.done` it sets `job.partial` to what there is by then: `done` is where a stop comes as a
         KeyboardInterrupt, also in a worker, and so do sessions while they advance. Only an algorithm that waits
         for workers of its own, or computes long without either, enters `job.ended_by` or looks at `job.stopped`.

    Attributes:
        command: name on the command line.
        called: name of the function in Python; empty: that of the command.
        algorithm: where it is, "module:function".
        example: a command line that works.
        case: what it is for, if it is not the first request of its command: "several models".
        chosen_by: flag by which the command means this request, if it is not seen by what it is run on: "--delays".
        details: further paragraph of `--help`; empty: none.
        subject: what it is run on.
        usual_tolerance: relative tolerance of the integration on the command line and in studies where none is given;
            set it where 1e-6 is too coarse for the analysis; None: the model's own.
        needs: options that a form asks for although the command does not, as its other subject has no use for them.
        counts: what the job counts, in the plural.
        parts: attributes of the record that are results themselves.
        withheld: its options that have the name of one of `Loading`, and that the model is not opened with.
        unwritten: files that its record has not: "csv", "mat", "plot".
        writes: its options that name files which the analysis itself writes: the command says that they are written.
        instead: option of another request of its command → its own that does the same, as a message says.
        in_shell: whether a command of this name asks for the same.
        written: class of what can be asked of its record, "module:class"; empty: the files that all have.
        of_system: whether it needs several models connected, and makes no sense for one.
        isolated: whether it runs as a whole in a worker process; else it runs no FMU here, or sees to that itself.
        undivided: whether `--timeout` limits the whole run; else it limits the time from one `job.done` to the next.
            Set it where `done` tells only how far one result is, as the percent of a simulation.
    """

    command: ClassVar[str]
    called: ClassVar[str] = ""
    algorithm: ClassVar[str]
    example: ClassVar[str]
    case: ClassVar[str] = ""
    chosen_by: ClassVar[str] = ""
    details: ClassVar[str] = ""
    subject: ClassVar[Subject]
    usual_tolerance: ClassVar[float | None] = None
    needs: ClassVar[tuple[str, ...]] = ()
    counts: ClassVar[str] = "points"
    parts: ClassVar[tuple[str, ...]] = ()
    withheld: ClassVar[tuple[str, ...]] = ()
    unwritten: ClassVar[tuple[str, ...]] = ()
    writes: ClassVar[tuple[str, ...]] = ()
    instead: ClassVar[Mapping[str, str]] = {}
    in_shell: ClassVar[bool] = True
    written: ClassVar[str] = ""
    of_system: ClassVar[bool] = False
    isolated: ClassVar[bool] = False
    undivided: ClassVar[bool] = False

    _: KW_ONLY
    progress: Progress | None = option(
        "Function that is called after each finished part with a description, the number done and the total number.",
        default=None,
        python=True,
    )

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.__doc__ = documented(cls)

    def run(self, subject: _Subject, job: Job) -> _Record:
        """Do the work, behind a wall where it runs an FMU; the job hears of its end in any case.

        Args:
            subject: what it is done on; a model stays open.
            job: is told what is finished.
        """
        stored = getattr(self, "store", None) is not None  # perhaps all of it, and no worker is needed
        if isinstance(self, InWorker) and not stored and _expected(self.place) and _portable(subject):
            from workbench.jobs.worker_main import inside  # noqa: PLC0415 - not for what is only asked about
            from workbench.jobs.worker_process import prepare  # noqa: PLC0415 - as above

            if not inside(self.place.limits):
                prepare(modules_of(type(self)))
        try:
            with self._reached(job) as request:
                request = request.by_own_names(subject, job).in_own_units(subject)  # noqa: PLW2901
                job.notes += request.beyond_limits(subject)
                result = named(_BEHIND_A_WALL if self.isolated else self.algorithm)(subject, request, job)
        except BaseException:
            job.partial = partial(_so_far, job.partial, job)
            raise
        record: _Record = _noted(result, job)
        job.ended(self.command, record)
        return record

    def by_own_names(self, subject: _Subject, job: Job) -> Self:
        """Return the request with every variable by its own name, where it was given by another one that it has.

        Args:
            subject: the model that has the variables.
            job: is told what was replaced.

        Raises:
            InputError: two names of one variable have a value each.
        """
        if not self.subject.opened or self.subject.several:
            return self
        notes: set[str] = set()
        values = {d.name: getattr(self, d.name) for d in options_of(type(self)) if not d.choices}
        changed = named(_BY_OWN_NAMES)(subject, values, notes)
        job.notes += sorted(notes)
        return replace(self, **changed) if changed else self

    def in_own_units(self, subject: _Subject) -> Self:
        """Return the request with every number in the unit of the variable that it belongs to.

        Args:
            subject: the model that has the variables.

        Raises:
            InputError: the model has no such variable, or its unit does not fit.
        """
        result = {}
        for declared in options_of(type(self)):
            value = getattr(self, declared.name)
            if next(quantities_in(value), None) is None:
                continue
            names = value if declared.option.of == EACH else self.variable_of(declared, subject)
            result[declared.name] = named(_IN_OWN_UNITS)(subject, names, value, declared)
        return replace(self, **result) if result else self

    def beyond_limits(self, subject: _Subject) -> list[str]:
        """Return a note on each variable that is set or forced outside of the limits that the model declares for it.

        Args:
            subject: the model.
        """
        if not self.subject.opened or self.subject.several:
            return []
        options = [(d, getattr(self, d.name)) for d in options_of(type(self))]
        notes: list[str] = named(_BEYOND_LIMITS)(subject, options, getattr(self, "at", None))
        return notes

    def variable_of(self, declared: DeclaredOption, subject: _Subject) -> str:
        """Return the name of the variable in whose unit an option is.

        Args:
            declared: the option; its `of` names the option that names the variable.
            subject: the model.
        """
        return str(getattr(self, declared.option.of))

    @contextmanager
    def _reached(self, job: Job) -> Iterator[Self]:
        """Yield the request with a cluster that is connected, where its parts run on one."""
        place = getattr(self, "place", None)
        if getattr(place, "scheduler", None) is None:
            yield self
            return
        with named("workbench.jobs.cluster:reached")(place) as (workers, words):
            if words:
                job.say(words)
            yield replace(self, workers=workers)  # type: ignore[call-arg]

    @classmethod
    def takes(cls, given: Sequence[str]) -> bool:
        """Return whether a command with several requests means this one, by what it is run on; else it means the first.

        Args:
            given: as the command line names it, one or more.
        """
        return not given  # never

    @classmethod
    def loading(cls, given: Mapping[str, Any]) -> Loading:
        """Return how the model is opened.

        Args:
            given: values of `asked_options`.
        """
        models = {n.removeprefix(_MODELS): value for n, value in given.items() if n.startswith(_MODELS)}
        result = put_together(Loading, {**given, **dict.fromkeys(cls.withheld), **models})
        return result if result.tolerance is not None else recast(Loading, result, tolerance=cls.usual_tolerance)

    @classmethod
    @contextmanager
    def opened(cls, given: Any, loading: Loading) -> Iterator[tuple[Any, tuple[str, ...]]]:  # noqa: ANN401
        """Yield what the request is run on, models opened, and their notes.

        Args:
            given: what a command line or a study names: a text, or a list of such.
            loading: how models are opened.
        """
        if not cls.subject.opened:
            yield given, ()
            return
        names = given if cls.subject.several else [given]
        with named("workbench.system.load:open_files")(names, loading) as models:
            notes = tuple(dict.fromkeys(note for model in models.values() for note in model.notes))
            yield (models if cls.subject.several else next(iter(models.values()))), notes

    def for_page(self) -> Self:
        """Return the request with what its page needs besides."""
        return self

    def went_well(self, record: _Record) -> bool:
        """Return whether the record is what was asked for; where it is not, the command still shows it and ends with 1.

        Override it where an answer can fail without an error: points that failed, a search that did not converge.

        Args:
            record: record of this request.
        """
        return True


def _expected(place: Worker) -> bool:
    """Return whether one of the worker processes that are kept will do the work."""
    elsewhere = isinstance(place, Workers) and (place.scheduler is not None or place.executor is not None)
    return not (place.in_process or place.limits.apart or elsewhere)


def _portable(subject: object) -> bool:
    """Return whether other processes can open a model, too; True of anything that is not a model."""
    recipe: Any = getattr(subject, "recipe", _NO_MODEL)
    return recipe is _NO_MODEL or (recipe is not None and recipe.portable)


_NO_MODEL = object()
_BY_OWN_NAMES = "workbench.model.names:by_own_names"
_IN_OWN_UNITS = "workbench.model.names:in_own_units"
_BEYOND_LIMITS = "workbench.model.declared_limits:beyond_limits"
_BEHIND_A_WALL = "workbench.requests.in_worker:in_worker"  # which knows requests
_MODELS = "model_"  # begins the name of a model's option where the request has one of that name
_MODEL: Mapping[str, Any] = {
    "metavar": "MODEL",
    "words": "FMU file or folder, fmu:NAME[@3], or a system: .toml, .ssp, system:NAME.",
}

# A model that the request opens itself.
MODEL_FILE = Subject(name="path", type="str | Path", help="An FMU, as for `load`, or a system: .toml, .ssp.", **_MODEL)


def modules_of(request: type[Request[Any, Any]]) -> tuple[str, ...]:
    """Return the modules that a worker needs for a request.

    Args:
        request: its class.
    """
    names = [_BEHIND_A_WALL] * request.isolated + [request.algorithm] * bool(request.algorithm)
    return tuple(name.partition(":")[0] for name in names)


class ModelRequest(InWorker, Request["Model", _Record]):
    """An analysis of a model; the command line opens the model."""

    isolated = True
    subject = Subject(name="model", type="Model", help="The model to analyse; it stays open.", opened=True, **_MODEL)


def asked_options(request: type[Request[Any, Any]]) -> dict[str, tuple[DeclaredOption, str]]:
    """Return name → option and heading of what can be asked in a line or a table, also of how the model is opened.

    An option that the analysis declares itself, as its own `step`, is given to the model as well, unless it is
    withheld; where the flag alone is the same, the model does without; where the name alone is, both have theirs.

    Args:
        request: class of what is asked for.
    """
    own = {declared.name: (declared, group) for declared, group in parts_of(request)}
    if request.subject.opened:
        flags = {declared.flag for declared, _ in own.values()}
        models = [(d, group) for d, group in parts_of(Loading) if d.flag not in flags]
        own |= {_MODELS + d.name if d.name in own else d.name: (d, group) for d, group in models}
    return own


def values_from(options: Mapping[str, tuple[DeclaredOption, str]], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of options by name, read from what a command line or a form gives; None: not given.

    Args:
        options: as `asked_options` returns them.
        given: see `DeclaredOption.read`.

    Raises:
        InputError: a value that an option cannot have.
    """
    flags = {d.flag for d, _ in options.values()}
    return {name: _read(d, given[name], flags) for name, (d, _) in options.items() if given.get(name) is not None}


def _read(declared: DeclaredOption, given: Any, flags: Collection[str]) -> Any:  # noqa: ANN401 - of any option
    try:
        return declared.read(given)
    except InputError as error:
        other = f"{declared.flag}s"
        raise InputError(f"{error}; did you mean {other}?" if other in flags else str(error)) from None


def request_from(request: type[Request[Any, Any]], given: Mapping[str, Any]) -> tuple[Any, Loading]:
    """Return a request, and how its model is opened.

    Args:
        request: class of what is asked for.
        given: what a command line or a form gives for its options.

    Raises:
        InputError: a value that an option cannot have.
    """
    values = values_from(asked_options(request), given)
    return put_together(request, values), request.loading(values)


def command_line_of(request: Request[Any, Any], subject: str, loading: Loading | None = None) -> str:
    """Return the command line that runs a request again.

    Args:
        request: what is asked for.
        subject: how the command line names what it is run on.
        loading: how the model is opened.
    """
    own = asked_of(request)
    models = asked_of(loading) if loading is not None else {}
    if models.get("tolerance") == [f"--tolerance={request.usual_tolerance}"]:
        del models["tolerance"]
    every = {word: None for words in (*own.values(), *models.values()) for word in words}
    return shlex.join(["workbench", request.command, subject, *filter(None, [request.chosen_by]), *every])


def function(
    request: Callable[_Options, Request[_Subject, _Record]],
) -> Callable[Concatenate[_Subject, _Options], _Record]:
    """Return the function that runs a request, with the request's options as its parameters.

    Args:
        request: class of what is asked for.
    """
    kind: Any = request
    name = kind.called or kind.command.replace("-", "_")
    subject = kind.subject
    made: Any = with_options(
        request, answered, name=name, first=subject.first, optional=subject.optional, returns=record_of(kind)
    )
    made.command_line = partial(_line_of, kind)
    return with_origin(*kind.parts)(made)


def _line_of(kind: type[Request[Any, Any]], given: Mapping[str, Any]) -> str:
    """Return the command line of a call in Python; empty: a shell cannot say the same."""
    values = dict(given)
    subject: Any = values.pop(kind.subject.name, None)
    recipe = getattr(subject, "recipe", None)
    if not isinstance(recipe, Loading) or recipe.hold_inputs or getattr(recipe, "at", None) is not None:
        return ""
    if any(values.get(d.name) is not None for d in options_of(kind) if d.option.python and d.name != "progress"):
        return ""
    from workbench.requests.model_facts import facts_of  # noqa: PLC0415 - it knows models

    source = facts_of(subject).source
    if not source or not kind.in_shell:  # as lin_over, which is a part of the command lin
        return ""
    tolerance = recipe.tolerance if kind.usual_tolerance is None else recipe.tolerance or subject.rtol or None
    try:
        return command_line_of(kind(**values), source, recast(Loading, recipe, tolerance=tolerance))
    except (AttributeError, TypeError, ValueError, WorkbenchError):  # a value that has no words
        return ""


def record_of(request: type[Request[Any, Any]]) -> str:
    """Return the name of a request's record, as its class has it in its brackets; of several, with | between them.

    Args:
        request: the class.
    """
    bases = (base for owner in request.__mro__ for base in vars(owner).get("__orig_bases__", ()))
    record = next(args[-1] for base in bases if (args := get_args(base)))
    return str(record.__forward_arg__ if isinstance(record, ForwardRef) else record.__name__)


def answered(subject: _Subject, request: Request[_Subject, _Record]) -> _Record:
    """Return the record of a request that was called as a function.

    Args:
        subject: that it is run on.
        request: what is asked.

    Raises:
        InputError: a model that is not open, or not any more.
        StoppedError: it was interrupted; with what was finished.
    """
    if request.subject.opened and isinstance(subject, str | PathLike):
        words = f"model: {str(subject)!r} is not open; write with wb.load({str(subject)!r}) as model: … and give model"
        raise InputError(words)
    if "Path" in request.subject.type and hasattr(subject, "open_session"):
        raise InputError(f"{request.subject.name}: this takes what `wb.load` takes, not an open model; give its file")
    if getattr(subject, "closed", False) is True:
        raise InputError(
            f"model: {getattr(subject, 'name', '')} was closed; work with it inside its `with` block, or load it again"
        )
    if request.progress is not None or "IPython" not in sys.modules:
        return _stoppable(subject, request, Job(request.progress))
    from workbench.requests.progress_bar import Bar, in_notebook  # noqa: PLC0415 - seldom needed

    with Bar(1.0) as bar:
        show = in_notebook()
        job = Job((lambda what, done, n: bar.update(done / n, str(what))) if show else None)
        return _stoppable(subject, request, job)


def _stoppable(subject: _Subject, request: Request[_Subject, _Record], job: Job) -> _Record:
    """Run a request; a KeyboardInterrupt brings along what is finished."""
    try:
        return request.run(subject, job)
    except KeyboardInterrupt:
        raise StoppedError(job.partial(), job.reached) from None  # where it was just then tells nobody anything
    except SimulationError as error:
        if error.before is None:
            error.before = job.partial()  # nothing is lost
        raise


def _noted(record: Any, job: Job) -> Any:  # noqa: ANN401 - any record
    """Return a record with what its job notes: how it ran belongs to every result."""
    own = {f.name for f in fields(record)} if is_dataclass(record) else set[str]()
    name = next((n for n in ("notes", "warnings") if n in own), "")
    known = getattr(record, name, ())
    new = [note for note in dict.fromkeys(job.notes) if note not in known]
    if not name or not new:
        return record
    noted = replace(record, **{name: (*known, *new)})
    if (origin := origin_of(record)) is not None:
        remember(noted, origin)
    return noted


def _so_far(partial_record: Callable[[], object], job: Job) -> object:
    return _noted(partial_record(), job)
