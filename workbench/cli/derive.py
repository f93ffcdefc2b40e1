"""A command derived from a request: its options, its help, and what happens when it is called."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from workbench.analysis.request import Analysis
from workbench.cli.options import Csv, Json, ModelName, Plot, Report, open_model
from workbench.core.loading import Loading
from workbench.core.option import Declared, Options, options_of
from workbench.endings import INTERRUPTED
from workbench.errors import InputError, WorkbenchError

if TYPE_CHECKING:
    from workbench.cli.output import Output
    from workbench.report import Page

__all__ = ["command"]

_OUTPUT = {"json_path": (Json, None), "csv_path": (Csv, None), "plot": (Plot, None), "report": (Report, None)}
_NOT_WELL = 1  # exit code of a record that says so


def command(request: type[Analysis[Any]], *, drawn: Mapping[str, tuple[Any, Any]] | None = None) -> Callable[..., int]:
    """Return the command of a request, as typer takes it.

    Args:
        request: the analysis.
        drawn: options that only pages and pictures have: name → (type, default).
    """
    own = drawn or {}

    def run(model: str, **given: Any) -> int:  # noqa: ANN401 - what typer read
        from workbench.cli.output import Output

        out = Output(request.command, **{name: given[name] for name in _OUTPUT})
        asked, loading = _request(request, given), _request(Loading, given)
        if loading.tolerance is None:
            loading = replace(loading, tolerance=request.usual_tolerance)
        with open_model(model, loading) as loaded:
            return _run(loaded, asked, out, {name: given[name] for name in own})

    run.__doc__ = _help(request)
    run.__name__ = request.command.replace("-", "_")
    run.__signature__ = _signature(request, own)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in _signature(request, own).parameters.values()}
    return run


def _run(model: Any, asked: Analysis[Any], out: Output, drawn: Mapping[str, Any]) -> int:  # noqa: ANN401
    """Run a request; whatever ends it, what it has is shown and written."""
    from workbench.cli.interrupt import OnInterrupt, interrupted
    from workbench.cli.notes import note
    from workbench.cli.progress import Bar
    from workbench.core.job import Job

    bar = Bar(1.0)
    reached = [0, 0]

    def tell(what: object, done: int, total: int) -> None:
        reached[:] = done, total
        bar.update(done / total, str(what))

    job = Job(tell)
    stopped: BaseException | None = None
    with bar, OnInterrupt(job.stop):
        try:
            record: object = asked.run(model, job)
        except (KeyboardInterrupt, WorkbenchError) as error:
            stopped, record = error, job.partial()
    if record is not None:
        for text in job.notes:
            note(text)
        _show(record, out, drawn)
        if stopped is None:
            return 0 if asked.went_well(record) else _NOT_WELL
    if isinstance(stopped, KeyboardInterrupt):
        note(f"{interrupted()} after {reached[0]} of {reached[1]} points")
        return INTERRUPTED
    assert stopped is not None  # noqa: S101
    raise stopped


def _show(record: Any, out: Output, drawn: Mapping[str, Any]) -> None:  # noqa: ANN401 - of any class that has a page
    """Print the page of a record, and write its files."""
    from workbench.cli.notes import flush, note
    from workbench.report.results import page_of
    from workbench.report.terminal import text_of

    page: Page = page_of(record, **drawn)
    for text in page.notes:
        note(text)
    flush()
    how = ", ".join(getattr(record, name) for name in ("interface", "solver") if hasattr(record, name))
    out.say(lambda width: text_of(page, width, how))
    out.write(
        record.to_dict(),
        csv=getattr(record, "to_csv", None),
        plot=lambda path: record.plot(path, **drawn),
        report=record,
        page=lambda: page,
    )


# -- options -----------------------------------------------------------------------------------


def _flat(request: type[Options], group: str = "") -> Iterator[tuple[str, Declared, str]]:
    """Yield name, option and heading of what the command line has; a part of options is taken apart."""
    for declared in options_of(request):
        if declared.option.python:
            continue
        if _is_part(declared):
            yield from _flat(declared.type, declared.option.group)
        else:
            yield declared.name, declared, declared.option.group or group


def _is_part(declared: Declared) -> bool:
    return inspect.isclass(declared.type) and issubclass(declared.type, Options)


def _signature(request: type[Analysis[Any]], drawn: Mapping[str, tuple[Any, Any]]) -> inspect.Signature:
    """Return the options of the analysis, then those by which models are opened, then the files.

    An option that the analysis declares itself, as its own `step`, is given to the model as well.
    """
    own = {name: (declared, group) for name, declared, group in _flat(request)}
    own |= {name: found for name, *found in _flat(Loading, "Model") if name not in own}  # type: ignore[misc]
    parameters = [_parameter("model", ModelName, inspect.Parameter.empty)]
    parameters += [
        _parameter(name, _annotation(declared, group), _default(declared)) for name, (declared, group) in own.items()
    ]
    for options in (drawn, _OUTPUT):
        parameters += [_parameter(name, kind, default) for name, (kind, default) in options.items()]
    return inspect.Signature(sorted(parameters, key=lambda p: p.default is not inspect.Parameter.empty))


def _parameter(name: str, kind: Any, default: Any) -> inspect.Parameter:  # noqa: ANN401
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=default)


def _default(declared: Declared) -> Any:  # noqa: ANN401
    if declared.required:
        return inspect.Parameter.empty
    return None if declared.form is not None else declared.default


def _annotation(declared: Declared, group: str) -> Any:  # noqa: ANN401 - a type for typer
    flag = declared.flag
    if declared.type is bool and declared.default:
        flag = f"{flag}/--no-{flag.removeprefix('--')}"
    form = declared.form
    metavar = declared.option.metavar or (form.metavar if form is not None else None)
    option = typer.Option(flag, help=declared.help, metavar=metavar, rich_help_panel=group or None)
    return Annotated[_typer_type(declared), option]


def _typer_type(declared: Declared) -> Any:  # noqa: ANN401
    if declared.form is not None:
        kind: Any = list[str] if declared.form.repeated else str
    elif declared.option.choices:
        kind = Literal[declared.option.choices]
    else:
        kind = declared.type
    return kind if declared.required or kind is bool else kind | None


# -- values ------------------------------------------------------------------------------------


def _request(request: type[Options], given: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of the kind asked for
    """Make the request from what typer read."""
    values: dict[str, Any] = {}
    for declared in options_of(request):
        if declared.option.python:
            continue
        if _is_part(declared):
            values[declared.name] = _request(declared.type, given)
        elif given[declared.name] is not None:
            values[declared.name] = _read(declared, given[declared.name])
    return request(**values)


def _read(declared: Declared, value: Any) -> Any:  # noqa: ANN401
    if declared.form is None:
        return value
    try:
        return declared.form.read(value if declared.form.repeated else [value])
    except ValueError as error:
        unit = f" [{declared.option.unit}]" if declared.option.unit else ""
        raise InputError(f"{declared.flag}: {error}{unit}") from None


def _help(request: type[Analysis[Any]]) -> str:
    first = inspect.cleandoc(request.__doc__ or "").split("\n\n")[0]
    return f"{first}\n\nExample: `{request.example}`"
