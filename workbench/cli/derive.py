"""A command derived from a request: its options, its help, and what happens when it is called."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from workbench.analysis.request import Analysis
from workbench.cli.options import (
    Bias,
    Csv,
    Interface,
    Json,
    ModelName,
    Plot,
    Report,
    Set,
    Solver,
    Start,
    Step,
    Tolerance,
    open_model,
)  # fmt: skip
from workbench.core.option import Declared, Options, options_of
from workbench.endings import INTERRUPTED
from workbench.errors import InputError, WorkbenchError

if TYPE_CHECKING:
    from workbench.cli.output import Output

__all__ = ["Show", "command"]

Show = Callable[[Any, "Output", Mapping[str, Any]], int]
"""Shows a record in the terminal and writes its files, given the options that only the command has; the exit code."""

# How every command opens its model, and where it writes.
_LOADING = {
    "interface": (Interface, "auto"),
    "solver": (Solver, "auto"),
    "step": (Step, None),
    "tolerance": (Tolerance, None),
    "start": (Start, None),
    "set_": (Set, None),
    "bias": (Bias, None),
}
_OUTPUT = {"json_path": (Json, None), "csv_path": (Csv, None), "plot": (Plot, None), "report": (Report, None)}

_OPENING, _PLACE, _WRITING = "Model", "Where it runs", "Output"


def command(
    request: type[Analysis[Any]], show: Show, *, extra: Mapping[str, tuple[Any, Any]] | None = None
) -> Callable[..., int]:
    """Return the command of a request, as typer takes it.

    Args:
        request: the analysis.
        show: what is done with its record.
        extra: options that only the command has, for pictures and pages: name → (type, default).
    """
    own = extra or {}

    def run(model: str, **given: Any) -> int:  # noqa: ANN401 - what typer read
        from workbench.cli.output import Output

        out = Output(request.command, **{name: given[name] for name in _OUTPUT})
        asked = _request(request, given)
        loading = {name: given[name] for name in _LOADING}
        if loading["tolerance"] is None:
            loading["tolerance"] = getattr(request, "tolerance", None)
        with open_model(model, **loading) as loaded:
            return _run(loaded, asked, lambda record: show(record, out, {name: given[name] for name in own}))

    run.__doc__ = _help(request)
    run.__name__ = request.command.replace("-", "_")
    run.__signature__ = _signature(request, own)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in _signature(request, own).parameters.values()}
    return run


def _run(model: Any, asked: Analysis[Any], show: Callable[[Any], int]) -> int:  # noqa: ANN401
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
        code = show(record)
        if stopped is None:
            return code
    if isinstance(stopped, KeyboardInterrupt):
        note(f"{interrupted()} after {reached[0]} of {reached[1]} points")
        return INTERRUPTED
    assert stopped is not None  # noqa: S101
    raise stopped


# -- options -----------------------------------------------------------------------------------


def _flat(request: type[Options], group: str = "") -> Iterator[tuple[str, Declared, str]]:
    """Yield name, option and heading of what the command line has; a part of options is taken apart."""
    for declared in options_of(request):
        if declared.option.python:
            continue
        if inspect.isclass(declared.type) and issubclass(declared.type, Options):
            yield from _flat(declared.type, _PLACE)
        else:
            yield declared.name, declared, declared.option.group or group


def _signature(request: type[Analysis[Any]], extra: Mapping[str, tuple[Any, Any]]) -> inspect.Signature:
    parameters = [_parameter("model", ModelName, inspect.Parameter.empty)]
    own = {name: (declared, group) for name, declared, group in _flat(request)}
    parameters += [
        _parameter(name, _annotation(declared, group), _default(declared)) for name, (declared, group) in own.items()
    ]
    for options in (extra, _LOADING, _OUTPUT):
        parameters += [_parameter(name, kind, default) for name, (kind, default) in options.items() if name not in own]
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
        if inspect.isclass(declared.type) and issubclass(declared.type, Options):
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
