"""A command derived from a request: its options, its help, and what happens when it is called."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.core.records.forms import File
from workbench.core.records.option import (
    DeclaredOption,
    Options,
    asked_in_json,
    option,
    parts_of,
    put_together,
    values_of,
)
from workbench.errors import InputError, WorkbenchError, suggest
from workbench.jobs.end_signals import INTERRUPTED
from workbench.requests.request import Request, asked_options, function, request_from, values_from
from workbench.show.files_written import Written, written_of

if TYPE_CHECKING:
    from workbench.cli.output import Output
    from workbench.cli.questions import Before
    from workbench.jobs.job import Job
    from workbench.requests.origin import Origin
    from workbench.show.page import Page

__all__ = ["command"]

_OUTPUT = ("json", "csv", "plot", "report")
_NOT_WELL = 1  # exit code of a record that says so


class _Json(Options):
    """The file that every record has; a study writes it by itself."""

    json: File | None = option("Write the result as JSON; - is standard output.", default=None)


def command(request: type[Request[Any, Any]], before: Before | None = None) -> Callable[..., int]:
    """Return the command of a request, as typer takes it.

    Args:
        request: what is asked for.
        before: returns the request that is run, see `workbench.cli.questions`.
    """
    kind = written_of(request)

    def run(**given: Any) -> int:  # noqa: ANN401 - what typer read
        from workbench.cli.notes import note
        from workbench.cli.output import Output

        out = Output(request.command, **{name: given.get(name) for name in _OUTPUT})
        with out.failing():
            asked, loading = request_from(request, given)
            written = put_together(kind, values_from(_files(request, kind), given))
            written.check(asked)
            asked = asked if out.report is None else asked.for_page()
            if before is not None:
                asked = before(asked, given, out)
            with request.opened(given[request.subject.spelt] or (), loading) as (subject, notes):
                for text in notes:
                    note(text)
                with _under_way() as work:
                    work.record = asked.run(subject, work.job)
                return _ended(subject, asked, work, out, written)

    run.__doc__ = _help(request)
    run.__name__ = request.command.replace("-", "_")
    run.__signature__ = _signature(request, kind)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in _signature(request, kind).parameters.values()}
    return run


@dataclass
class _CommandRun:
    """A request that runs.

    Attributes:
        job: shows how far it is.
        record: what it gave, or what there was when it ended early.
        stopped: what ended it early.
    """

    job: Job
    record: object = None
    stopped: BaseException | None = None


@contextmanager
def _under_way() -> Iterator[_CommandRun]:
    """Show how far a request is while it is run here; whatever ends it, what it has is kept."""
    from workbench.cli.interrupt import OnInterrupt
    from workbench.cli.notes import say
    from workbench.jobs.job import Job
    from workbench.requests.progress_bar import Bar

    def tell(what: object, done: int, total: int) -> None:
        bar.update(done / total, str(what))

    bar, work = Bar(1.0), _CommandRun(Job(tell))
    work.job.say = say
    with bar, OnInterrupt(work.job.stop):
        try:
            yield work
        except (KeyboardInterrupt, WorkbenchError) as error:
            work.stopped, work.record = error, work.job.partial()


def _ended(subject: Any, asked: Request[Any, Any], work: _CommandRun, out: Output, written: Written) -> int:  # noqa: ANN401
    """Show and write what a request gave; return its exit code, or raise what ended it."""
    from workbench.cli.interrupt import interrupted
    from workbench.cli.notes import note
    from workbench.requests.call import origin_of_call

    record, stopped = work.record, work.stopped
    for text in work.job.notes:
        note(text)
    if record is not None:
        origin = origin_of_call(function(type(asked)), (subject,), values_of(asked), seconds=0.0, result=record)
        try:
            _show(record, asked, out, written, origin, stopped)
        except InputError:
            if stopped is None:  # else the picture or file that cannot be made is not the error to tell
                raise
        if stopped is None:
            return 0 if asked.went_well(record) else _NOT_WELL
    if isinstance(stopped, KeyboardInterrupt):
        done, total = work.job.reached
        far = f" after {done} of {total} {asked.counts}" if total else ": there is no result"
        again = "; the same command continues" if total and getattr(asked, "store", None) is not None else ""
        note(f"{interrupted()}{far}{again}")
        if record is None:
            out.tell_failure(stopped)
        return INTERRUPTED
    assert stopped is not None  # noqa: S101
    raise stopped


def _show(
    record: Any,  # noqa: ANN401
    asked: Options,
    out: Output,
    written: Written,
    origin: Origin,
    stopped: BaseException | None,
) -> None:
    """Print the page of a record, and write its files."""
    from workbench.cli.notes import flush, note
    from workbench.cli.output import failure_in_json
    from workbench.show.result import page_of
    from workbench.show.terminal import text_of

    page: Page = page_of(record, **written.told(written.drawn))
    for text in [*page.notes, *out.unsaid(record)]:
        note(text)
    flush()
    how = ", ".join(getattr(record, name) for name in ("interface", "solver") if hasattr(record, name))
    out.say(lambda width: text_of(page, width, how))
    out.write(
        lambda: {"asked": asked_in_json(asked), **record.to_dict(), **failure_in_json(stopped)},
        csv=getattr(record, "to_csv", None),
        plot=lambda path: record.plot(path, **written.told((*written.drawn, *written.plotted))),
        report=record,
        page=lambda: page,
        origin=origin,
    )
    for path in written.write(record):
        out.wrote(path)


# -- options -----------------------------------------------------------------------------------


def _signature(request: type[Request[Any, Any]], written: type[Written]) -> inspect.Signature:
    """Return the options of the request, then those by which models are opened, then the files."""
    subject = request.subject
    own = {**asked_options(request), **_files(request, written)}
    typed: Any = list[str] if subject.several else str
    typed = typed | None if subject.optional else typed
    argument = Annotated[typed, typer.Argument(metavar=subject.metavar, help=subject.words)]
    parameters = [_parameter(subject.spelt, argument, None if subject.optional else inspect.Parameter.empty)]
    parameters += [
        _parameter(name, _annotation(declared, group), _default(declared)) for name, (declared, group) in own.items()
    ]
    return inspect.Signature(sorted(parameters, key=lambda p: p.default is not inspect.Parameter.empty))


def _parameter(name: str, kind: Any, default: Any) -> inspect.Parameter:  # noqa: ANN401
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=default)


def _default(declared: DeclaredOption) -> Any:  # noqa: ANN401
    if declared.required:
        return inspect.Parameter.empty
    return None if declared.form is not None else declared.default


def _annotation(declared: DeclaredOption, group: str) -> Any:  # noqa: ANN401 - a type for typer
    flag = declared.flag
    if declared.type is bool and declared.default:
        flag = f"{flag}/--no-{flag.removeprefix('--')}"
    form = declared.form
    choices = declared.option.choices
    metavar = declared.option.metavar or (form.metavar if form is not None else "|".join(choices) or None)
    flags = [flag, *filter(None, [declared.option.also])]
    option = typer.Option(
        *flags,
        help=f"{declared.help} Repeatable." if form is not None and form.repeated else declared.help,
        metavar=metavar,
        rich_help_panel=group or None,
        hidden=declared.option.hidden,
        parser=partial(_one_of, choices) if choices and form is None else None,
    )
    return Annotated[_typer_type(declared), option]


def _one_of(choices: tuple[str, ...], text: str) -> str:
    if text not in choices:
        raise typer.BadParameter(f"'{text}' is unknown; {suggest(text, choices)}")
    return text


def _typer_type(declared: DeclaredOption) -> Any:  # noqa: ANN401
    if declared.form is not None:
        kind: Any = list[str] if declared.form.repeated else str
    else:
        kind = declared.type
    return kind if declared.required or kind is bool else kind | None


# -- values ------------------------------------------------------------------------------------


def _files(request: type[Request[Any, Any]], written: type[Written]) -> dict[str, tuple[DeclaredOption, str]]:
    """Return the options of a command's pictures and files, those that every command has last."""
    every = {d.name: (d, group) for kind in (_Json, written) for d, group in parts_of(kind)}
    known = (name for name in every if name not in request.unwritten)
    return {name: every[name] for name in sorted(known, key=lambda n: _OUTPUT.index(n) if n in _OUTPUT else -1)}


def _help(request: type[Request[Any, Any]]) -> str:
    first = inspect.cleandoc(request.__doc__ or "").split("\n\n")[0]
    return "\n\n".join(filter(None, [first, request.details, f"Example: `{request.example}`"]))
