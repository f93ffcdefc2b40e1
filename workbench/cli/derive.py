"""A command derived from a request: its options, its help, and what happens when it is called."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import click

from workbench.cli.plain import GroupedOption, PlainCommand
from workbench.core.records.forms import File, written
from workbench.core.records.option import (
    DeclaredOption,
    Options,
    asked_in_json,
    option,
    parts_of,
    put_together,
    values_of,
)
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.end_signals import INTERRUPTED
from workbench.requests.request import Request, asked_options, function, request_from, values_from
from workbench.show.files_written import Written, written_of

if TYPE_CHECKING:
    from workbench.cli.interrupt import OnInterrupt
    from workbench.cli.output import Output
    from workbench.cli.questions import Before
    from workbench.jobs.job import Job
    from workbench.requests.origin import Origin
    from workbench.show.page import Page

__all__ = ["command", "meant"]

_OUTPUT = ("json", "csv", "mat", "plot", "report")
_SUBJECT = "subject"  # name of the argument
_NOT_WELL = 1  # exit code of a record that says so


class _Json(Options):
    """The file that every record has; a study writes it by itself."""

    json: File | None = option("Write the result as JSON; - is standard output.", default=None, first=True)


def command(requests: Sequence[type[Request[Any, Any]]], before: Before | None = None) -> click.Command:
    """Return the command of the requests.

    Args:
        requests: what it may mean, see `Request.takes`; the first is what it means without more.
        before: returns the request that is run, see `workbench.cli.questions`.
    """
    first = requests[0]

    def run(**given: Any) -> int:  # noqa: ANN401 - of any option
        from workbench.cli.interrupt import OnInterrupt, interrupted
        from workbench.cli.notes import note
        from workbench.cli.output import Output

        files = {name: given.get(name) for name in (*_OUTPUT, "junit")}
        out = Output(first.command, **files, judged="junit" in given)
        with out.failing():
            request, subject = meant(requests, given)
            kind = written_of(request)
            asked, loading = request_from(request, given)
            written = put_together(kind, values_from(_files(request, kind), given))
            written.check(asked)
            asked = asked if out.report is None else asked.for_page()
            if before is not None:
                asked = before(asked, given, out)
            with request.opened(subject, loading) as (opened, notes):
                for text in notes:
                    note(text)
                with OnInterrupt() as wish:
                    with _under_way(wish) as work:
                        work.record = asked.run(opened, work.job)
                    code = _ended(opened, asked, work, out, written)
                if wish.came and work.stopped is None:
                    note(f"{interrupted()}: the result is written")
                    return INTERRUPTED
                return code

    return PlainCommand(first.command, callback=run, params=_parameters(requests), help=_help(requests))


def meant(requests: Sequence[type[Request[Any, Any]]], given: dict[str, Any]) -> tuple[type[Request[Any, Any]], Any]:
    """Return the request that is meant and what it is run on.

    Args:
        requests: of a command.
        given: what the command line says; the options of the request are as it reads them afterwards.

    Raises:
        InputError: an option of another request is given, one of its own is missing, or it is run on one thing.
    """
    named = given.pop(_SUBJECT) or []
    words = [named] if isinstance(named, str) else list(named)
    flags = {r: given.pop(_named(r.chosen_by)) for r in requests if r.chosen_by}
    request = next(
        (r for r in requests[1:] if flags.get(r) or (words and not r.chosen_by and r.takes(words))), requests[0]
    )
    own = _options(request)
    for other in requests:
        foreign = {name: declared for name, (declared, _) in _options(other).items() if name not in own}
        flags_given = [d.flag for name, d in foreign.items() if given.get(name) not in (None, _usual(d))]
        if flags_given:
            verb, them = ("is", "it") if len(flags_given) == 1 else ("are", "them")
            case = other.case or other.subject.metavar
            others = [f"--{request.instead[name]}" for name, d in foreign.items()
                      if d.flag in flags_given and name in request.instead]  # fmt: skip
            remedy = f"use {', '.join(others)}" if len(others) == len(flags_given) else f"leave {them} out"
            raise InputError(f"{', '.join(flags_given)} {verb} for {case}; {remedy}")
    words = _with_rest(request, words, given)
    for name, (declared, _) in own.items():
        if given.get(name) is not None:
            given[name] = _as_read(declared, given[name])
    missing = next((d for name, (d, _) in own.items() if d.required and given.get(name) is None), None)
    if missing is not None:
        raise InputError(f"{missing.flag} is missing: {missing.help}")
    if not words and not request.subject.optional:
        raise InputError(f"name a {request.subject.metavar}; workbench {request.command} --help has an example")
    if request.subject.several:
        return request, words
    if len(words) > 1:
        raise InputError(f"takes one {request.subject.metavar}, not {', '.join(words)}")
    return request, words[0] if words else ()


def _with_rest(request: type[Request[Any, Any]], words: list[str], given: dict[str, Any]) -> list[str]:
    """Return what a request is run on; what stands behind it is put to the option that takes it."""
    rest = request.subject.rest
    if rest and words[1:]:
        given[rest] = [*(given.get(rest) or ()), *words[1:]]
    return words[:1] if rest else words


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
def _under_way(wish: OnInterrupt) -> Iterator[_CommandRun]:
    """Show how far a request is while it is run here; whatever ends it, what it has is kept."""
    from workbench.cli.notes import say
    from workbench.jobs.job import Job
    from workbench.requests.progress_bar import Bar

    def tell(what: object, done: int, total: int) -> None:
        bar.update(done / total, str(what))

    bar, work = Bar(1.0), _CommandRun(Job(tell))
    work.job.say, wish.act = say, work.job.stop
    with bar:
        try:
            yield work
        except (KeyboardInterrupt, WorkbenchError) as error:
            work.stopped, work.record = error, work.job.partial()


def _ended(subject: Any, request: Request[Any, Any], work: _CommandRun, out: Output, written: Written) -> int:  # noqa: ANN401
    """Show and write what a request gave; return its exit code, or raise what ended it."""
    from workbench.cli.interrupt import interrupted
    from workbench.cli.notes import note
    from workbench.requests.call import origin_of_call

    record, stopped = work.record, work.stopped
    for text in work.job.notes:
        note(text)
    if record is not None:
        origin = origin_of_call(function(type(request)), (subject,), values_of(request), seconds=0.0, result=record)
        try:
            _show(record, request, out, written, origin, stopped)
        except InputError:
            if stopped is None:  # else the picture or file that cannot be made is not the error to tell
                raise
    if stopped is None:
        return 0 if request.went_well(record) else _NOT_WELL
    if isinstance(stopped, KeyboardInterrupt):
        done, total = work.job.reached
        far = f" after {done} of {total} {request.counts}" if total else ": there is no result"
        again = "; the same command continues" if total and getattr(request, "store", None) is not None else ""
        note(f"{interrupted()}{far}{again}")
        if record is None:
            out.tell_failure(stopped)
        return INTERRUPTED
    raise stopped


def _show(
    record: Any,  # noqa: ANN401
    request: Request[Any, Any],
    out: Output,
    written: Written,
    origin: Origin,
    stopped: BaseException | None,
) -> None:
    """Print the page of a record, and write its files."""
    from workbench.cli.command_line import in_flags
    from workbench.cli.github import tell_github
    from workbench.cli.notes import flush, note
    from workbench.cli.output import failure_in_json
    from workbench.show.cases import Judged
    from workbench.show.result import page_of
    from workbench.show.terminal import text_of

    page: Page = in_flags(page_of(record, **written.told(written.drawn)))
    for text in [*page.notes, *out.unsaid(record)]:
        note(text)
    flush()
    how = ", ".join(getattr(record, name) for name in ("interface", "solver") if hasattr(record, name))
    out.say(lambda width: text_of(page, width, how))
    out.write(
        lambda: {"asked": asked_in_json(request), **record.to_dict(), **failure_in_json(stopped)},
        csv=getattr(record, "to_csv", None),
        mat=getattr(record, "to_mat", None),
        plot=lambda path: record.plot(path, **written.told((*written.drawn, *written.plotted))),
        report=record,
        page=lambda: page,
        origin=origin,
    )
    for path in written.write(record):
        out.wrote(path)
    for name in type(request).writes if stopped is None else ():
        if path := getattr(request, name):
            out.wrote(path)
    if isinstance(record, Judged):
        tell_github(record, lambda: page, stopped)


# -- options -----------------------------------------------------------------------------------


def _parameters(requests: Sequence[type[Request[Any, Any]]]) -> list[click.Parameter]:
    """Return the options of the requests, then those by which models are opened, then the files."""
    chosen = [(request.chosen_by, _first_sentence(request)) for request in requests if request.chosen_by]
    result: list[click.Parameter] = [_argument(requests)]
    result += [click.Option([_named(flag), flag], is_flag=True, help=words) for flag, words in chosen]
    own = [_options(request) for request in requests]
    for name in dict.fromkeys(chain.from_iterable(own)):
        known = [(request, *options[name]) for request, options in zip(requests, own, strict=True) if name in options]
        request, _, group = known[0]
        declared = [d for _, d, _ in known]
        everywhere = len(known) == len(own) and name != request.subject.rest
        result.append(_merged(name, declared, group or _heading(request), everywhere=everywhere))
    return sorted(result, key=lambda p: not p.required)


def _argument(requests: Sequence[type[Request[Any, Any]]]) -> click.Argument:
    subject, several = requests[0].subject, any(r.subject.several for r in requests)
    optional = any(r.subject.optional for r in requests)
    metavar = f"{subject.metavar}.." if several and not subject.several else subject.metavar
    words = " Or: ".join(dict.fromkeys(request.subject.words for request in requests))
    if subject.rest:
        metavar, words = f"{metavar} {subject.rest.upper()}..", f"{words} Behind it: what --{subject.rest} takes."
    return click.Argument(
        [_SUBJECT],
        nargs=-1 if several or subject.rest else 1,
        required=not optional,
        metavar=f"[{metavar}]" if optional else metavar,
        help=words,
    )


def _merged(name: str, known: Sequence[DeclaredOption], group: str, *, everywhere: bool) -> click.Option:
    """Return an option that requests of one command share, as the first declares it: texts and switches are read."""
    first = known[0]
    switch, flag = first.form is None, first.flag
    if switch and any(d.default for d in known):
        flag = f"{flag}/--no-{flag.removeprefix('--')}"
    usual = {repr(d.default) for d in known}
    return GroupedOption(
        [name, flag, *filter(None, [first.option.also])],
        group=group,
        first=any(d.option.first for d in known),
        is_flag=switch,
        multiple=any(d.repeated for d in known),
        required=everywhere and all(d.required for d in known),
        default=None if len(usual) > 1 or first.required else _usual(first),
        help=f"{first.help} Repeatable." if first.repeated else first.help,
        metavar=first.metavar or None,
    )


def _usual(declared: DeclaredOption) -> Any:  # noqa: ANN401
    """Return the default as a command line would give it; None: it is not shown, as that of a list or the like."""
    if declared.form is None:
        return declared.default
    return written(declared.default) if isinstance(declared.default, str | int | float) else None


# -- values ------------------------------------------------------------------------------------


def _options(request: type[Request[Any, Any]]) -> dict[str, tuple[DeclaredOption, str]]:
    """Return name → option and heading of all that a command line can give to a request."""
    return {**asked_options(request), **_files(request, written_of(request))}


def _as_read(declared: DeclaredOption, given: Any) -> Any:  # noqa: ANN401
    """Return what was read as another request's option of that name has it."""
    if declared.repeated:
        return [given] if isinstance(given, str) else given
    return given[-1] if isinstance(given, list) and given else given


def _files(request: type[Request[Any, Any]], written: type[Written]) -> dict[str, tuple[DeclaredOption, str]]:
    """Return the options of a command's pictures and files, those that every command has last."""
    every = {d.name: (d, group) for kind in (_Json, written) for d, group in parts_of(kind)}
    known = (name for name in every if name not in request.unwritten)
    return {name: every[name] for name in sorted(known, key=lambda n: _OUTPUT.index(n) if n in _OUTPUT else -1)}


# -- help --------------------------------------------------------------------------------------


def _named(flag: str) -> str:
    return flag.lstrip("-").replace("-", "_")


def _heading(request: type[Request[Any, Any]]) -> str:
    return f"{request.case[:1].upper()}{request.case[1:]}"


def _first_sentence(request: type[Request[Any, Any]]) -> str:
    first = " ".join(inspect.cleandoc(request.__doc__ or "").split("\n\n")[0].split())
    return f"{first.partition('. ')[0].removesuffix('.')}."


def _help(requests: Sequence[type[Request[Any, Any]]]) -> str:
    """Return what each request does, and its example."""
    parts = [(r, inspect.cleandoc(r.__doc__ or "").split("\n\n")[0]) for r in requests]
    texts = [f"{_heading(r)}: {text}" if r.case else text for r, text in parts]
    details = [r.details for r in requests if r.details]
    examples = [f"Example: `{r.example}`" for r in requests]
    return "\n\n".join([*texts, *details, *examples])
