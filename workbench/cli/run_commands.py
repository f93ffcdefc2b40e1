"""The commands as studies see them: what options they have, and how one is run inside a worker process."""

from __future__ import annotations

import io
import traceback
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from workbench.cli import asked, notes
from workbench.cli.program import Lazily, program, said
from workbench.errors import InputError, WorkbenchError
from workbench.study.commands import Command, Commands, Ended, Option

if TYPE_CHECKING:
    from workbench.study.result import StudyResult

__all__ = ["AppCommands", "run_command", "run_study"]

# A study in a study would write into the same store twice.
_NOT_IN_STUDIES = ("run",)
_HIDDEN = ("help",)
_NOTE = "note: "


class AppCommands(Commands):
    """The commands of the program, whatever they are: read from the options that they declare."""

    def __init__(self) -> None:
        self.run = run_command
        self._commands = Lazily()

    def __contains__(self, name: str) -> bool:
        return name not in _NOT_IN_STUDIES and name in self._commands and _takes(self._commands[name], "--json")

    def names(self) -> tuple[str, ...]:
        return tuple(n for n in self._commands if n in self)

    def get(self, name: str) -> Command:
        options: dict[str, Option] = {}
        for parameter in self._commands[name].params:
            option = _option(parameter)
            for spelling in parameter.opts:
                options[spelling.lstrip("-")] = option
        return Command(name, {n: o for n, o in options.items() if n not in _HIDDEN})

    def check(self, name: str, arguments: Sequence[str]) -> None:
        try:
            self._commands[name].make_context(name, list(arguments))
        except typer.TyperException as error:
            raise InputError(f"{name}: {_said(error)}") from None


def _takes(command: Any, name: str) -> bool:  # noqa: ANN401 - typer's own class of a command is not public
    return any(name in p.opts for p in command.params)


def _option(parameter: Any) -> Option:  # noqa: ANN401 - likewise
    return Option(
        name=parameter.opts[0].lstrip("-"),
        argument=parameter.param_type_name == "argument",
        flag=bool(getattr(parameter, "is_flag", False)),
        off=parameter.secondary_opts[0] if parameter.secondary_opts else "",
        multiple=bool(parameter.multiple) or parameter.nargs == -1,
        metavar=parameter.metavar or "",
    )


def _said(error: typer.TyperException) -> str:
    """Return the message with options as the study file spells them."""
    return said(error).replace("'--", "'").removesuffix(".")


def run_command(arguments: Sequence[str]) -> Ended:
    """Run a command in this process, silently.

    Args:
        arguments: the command's name and its arguments.
    """
    said = io.StringIO()
    notes.drop()
    asked.keep(arguments)
    with redirect_stdout(io.StringIO()), redirect_stderr(said):
        code, reason, bad = _run(arguments)
        notes.flush()
    lines = said.getvalue().splitlines()
    return Ended(
        code=code,
        reason=reason,
        bad_input=bad,
        notes=tuple(line.removeprefix(_NOTE) for line in lines if line.startswith(_NOTE)),
    )


def _run(arguments: Sequence[str]) -> tuple[int, str, bool]:
    """Return exit code, reason, and whether the input was bad."""
    command = program(arguments[0] if arguments else None)
    try:
        code = command.main(list(arguments), "workbench", standalone_mode=False)
    except typer.TyperException as error:
        return 2, _said(error), True
    except InputError as error:
        return 2, error.args[0], True
    except WorkbenchError as error:
        return 2, error.args[0], False
    except Exception as error:  # noqa: BLE001 - one analysis must not end the others, whatever is wrong with it
        return 2, _bug(error), False
    return (code if isinstance(code, int) else 0), "", False


def _bug(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(last.filename).name}, line {last.lineno}"
    return f"{type(error).__name__}: {error} ({place}); this is a bug of the workbench"


def run_study(
    study: str | Path,
    *,
    store: str | Path | None = "auto",
    fresh: bool = False,
    jobs: int | None = None,
    timeout: float | None = None,
) -> StudyResult:
    """Run a study: analyses over a grid of parameters, compared with requirements.

    Args:
        study: file (.toml), or a bundled one, `study:NAME`.
        store: folder of finished analyses; "auto": .workbench-store beside the study (of a bundled one in the present
            folder); None: nothing is kept or reused.
        fresh: measure again what the store has.
        jobs: worker processes at a time; None: one per core.
        timeout: longest time for one analysis [s]; None: an hour.

    Returns:
        Values, limits and margins, with `.passed`, `.to_dict()`, `.to_csv()`, `.to_junit()` and `.report()`.

    Raises:
        InputError: the study is wrong: one line with the file, the table and the key.
        FmuError: a model cannot be opened.

    Examples:
        In equilibrium the output of 1/(s + 1) is its input.

        >>> from pathlib import Path
        >>> _ = Path("lag.toml").write_text('''
        ... models.lag = "fmu:FirstOrderLag"
        ... analyses.rest = {command = "trim", model = "lag", u0 = {u = 2.0}}
        ... [[requirements]]
        ... name = "gain"
        ... analysis = "rest"
        ... kind = "value"
        ... path = "y.y"
        ... equal = 2.0
        ... tolerance = 1e-9
        ... ''')
        >>> print(wb.run_study("lag.toml", store=None).passed)
        True
    """
    from workbench.cli.options import workers
    from workbench.study.run import StudyRun, default_store

    folder = default_store(study) if store == "auto" else None if store is None else Path(store)
    prepared = StudyRun(study, AppCommands(), store=folder, fresh=fresh)
    return prepared.run(lambda: workers(jobs=jobs, timeout=timeout))
