"""Where a command's result goes: terminal, JSON, CSV, picture, report."""

from __future__ import annotations

import json
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from workbench import __version__
from workbench.cli.command_line import command_line, spoken, was_given
from workbench.cli.notes import note, said
from workbench.core.machine.files import file_to_write, replacing
from workbench.core.records.record import plain
from workbench.errors import UNSEEN, InputError, WorkbenchError, visible
from workbench.requests.kept import origin_of
from workbench.requests.origin import Origin

if TYPE_CHECKING:
    from workbench.show.page import Page

__all__ = ["Output", "check_kind"]

_PICTURES = (".png", ".svg", ".pdf")
_PAGES = (".html", ".htm")
_JSON, _CSV, _MAT, _XML = ".json", ".csv", ".mat", ".xml"
_FOREIGN = (*_PICTURES, *_PAGES, _JSON, _CSV, _MAT, _XML, ".fmu", ".toml")  # what names another kind of file


class Output:
    """The files a command was asked to write, checked before the work begins.

    With `--json -` or `--csv -` nothing else goes to standard output.

    Args:
        command: its name.
        json: path of the JSON, "-" for standard output, None for none.
        csv: of the CSV, likewise.
        mat: of the MATLAB file, or None.
        plot: of the picture, or None.
        report: of the page, or None.
        junit: of the verdicts, or None.
        judged: whether the command has verdicts.

    Raises:
        InputError: a folder that does not exist, an unknown suffix, both on standard output.
    """

    def __init__(
        self,
        command: str,
        *,
        json: str | None = None,
        csv: str | None = None,
        mat: str | None = None,
        plot: str | None = None,
        report: str | None = None,
        junit: str | Path | None = None,
        judged: bool = False,
    ) -> None:
        self.command = command
        self.json_path, self.csv_path, self.mat_path = json, csv, mat
        self.plot, self.report = (None if path is None else Path(path) for path in (plot, report))
        self._quiet = "-" in {json, csv}
        self._begin = time.monotonic()
        self._has_result = False
        self._junit, self._judged = junit, judged
        self._unwritten: dict[str, InputError] = {}
        if json == csv == "-":
            raise InputError("--json and --csv cannot both go to standard output; give one of them a file")
        files = {"--json": json, "--csv": csv, "--mat": mat, "--plot": plot, "--report": report, "--junit": junit}
        for option, path in files.items():
            if path is not None and path != "-":
                file_to_write(path, option=option)
        check_kind("--json", json, _JSON)
        check_kind("--csv", csv, _CSV)
        check_kind("--mat", mat, _MAT)
        check_kind("--junit", None if junit is None else str(junit), _XML)
        if self.plot is not None and self.plot.suffix.lower() not in _PICTURES:
            raise InputError(f"--plot: '{plot}' must end in one of {', '.join(_PICTURES)}")
        if self.report is not None and self.report.suffix.lower() not in _PAGES:
            raise InputError(f"--report: '{report}' must end in {_PAGES[0]}")

    @contextmanager
    def failing(self) -> Iterator[None]:
        """Write what goes wrong in here, see `tell_failure`."""
        try:
            yield
        except (WorkbenchError, KeyboardInterrupt) as error:
            self.tell_failure(error)
            raise

    def tell_failure(self, error: BaseException) -> None:
        """Write what went wrong, where there is no result: as JSON, and of a command with verdicts as one of them.

        JSON that is there may be a good result: no slip in a command's options shall cost it. Verdicts that are there
        are not those of this command.

        Args:
            error: that ended the command.
        """
        if self._has_result:
            return
        if self.json_path is not None and not Path(self.json_path).exists():
            self._write_json(self._full(failure_in_json(error)))
        if self._judged and isinstance(error, WorkbenchError):
            from workbench.cli.github import summarise
            from workbench.show.cases import WithoutVerdicts

            ended = WithoutVerdicts(self.command, error)
            if self._junit is not None:
                ended.to_junit(self._junit)
            summarise(ended.page)

    def say(self, text: Callable[[int | None], str]) -> None:
        """Print a text, unless standard output belongs to JSON or CSV.

        Args:
            text: returns it for the width of a terminal [characters], None: of a pipe.
        """
        if not self._quiet:
            sys.stdout.write(visible(text(shutil.get_terminal_size().columns if sys.stdout.isatty() else None)))
            sys.stdout.flush()  # see `cli.streams` for what may go wrong

    def unsaid(self, record: object) -> list[str]:
        """Return what has to be told on standard error, where standard output belongs to JSON or CSV.

        Args:
            record: that is written; its `warnings` stand on its page, its `not_in_stream` only files hold.
        """
        missing = getattr(record, "not_in_stream", "") if self.csv_path == "-" else ""
        notes = getattr(record, "warnings", ()) if self._quiet else ()
        return [*notes, *([f"--csv -: {missing}"] if missing else [])]

    def write(
        self,
        result: Callable[[], Mapping[str, Any]],
        *,
        csv: Callable[[str | TextIO], Iterable[Path] | None] | None = None,
        mat: Callable[[Path], object] | None = None,
        plot: Callable[[Path], object] | None = None,
        report: object = None,
        page: Callable[[], Page] | None = None,
        origin: Origin | None = None,
    ) -> None:
        """Write what was asked for; a signal that asks to end meanwhile is obeyed when all of it is written.

        Args:
            result: makes what stands in JSON, where that is wanted; command, version and seconds are added.
            csv: writes the CSV to a path or stream; it may return the files that it wrote.
            mat: writes the MATLAB file.
            plot: writes the picture.
            report: the result itself, whose class names its page.
            page: makes the page in place of that one, where the command knows more than the result.
            origin: on what the result was made; None: what the result remembers.

        Raises:
            InputError: a file cannot be written.
            KeyboardInterrupt: after such a signal.
        """
        from workbench.cli.interrupt import OnInterrupt, interrupted

        self._has_result = True
        with OnInterrupt(lambda: None) as wish:
            point = getattr(report, "operating_point", None)
            if point is not None and was_given("--at"):
                self.say(lambda _: f"at {point.words()}\n")
            wanted = self.json_path is not None or self.report is not None
            full = self._full(result()) if wanted else {}
            written: list[Path] = []
            if self.csv_path is not None and csv is not None:
                with self._writing(self.csv_path):
                    written += csv(sys.stdout if self.csv_path == "-" else self.csv_path) or ()
            if written:
                full["files"] = [str(path) for path in written]
            known = origin or origin_of(report)
            for path, make in (
                (self.json_path, lambda _: self._write_json(full)),
                (self.mat_path, mat),
                (self.plot, plot),
                (self.report, lambda _: self._write_report(page() if page is not None else report, known, full)),
            ):
                if path is not None and make is not None:
                    with self._writing(path):
                        make(Path(path))
            files = (self.json_path, self.csv_path, self.mat_path, self.plot, self.report, *written)
            for path in dict.fromkeys(str(p) for p in files if p is not None and p != "-"):
                if path not in self._unwritten:
                    self.wrote(path)
            if self._unwritten:
                raise InputError("; ".join(map(str, self._unwritten.values())))
        if wish.came:
            note(f"{interrupted()}: the result is written")
            raise KeyboardInterrupt

    @contextmanager
    def _writing(self, path: object) -> Iterator[None]:
        """Note that a file cannot be written: that is not a reason to lose the others."""
        try:
            yield
        except InputError as error:
            self._unwritten[str(path)] = error

    def wrote(self, path: object) -> None:
        """Tell that a file was written.

        Args:
            path: of it.
        """
        self.say(lambda _: f"wrote {path}\n")

    def _full(self, result: Mapping[str, Any]) -> dict[str, Any]:
        seconds = round(time.monotonic() - self._begin, 3)
        full = {"command": self.command, "version": __version__, "seconds": seconds, **result}
        return {key: plain(value) for key, value in full.items()}

    def _write_report(self, result: object, origin: Origin | None, full: Mapping[str, Any]) -> None:
        from workbench.show.result import write_report

        known = replace(
            origin or Origin(),
            command=self.command,
            call=command_line(),
            seconds=full["seconds"],
            notes=tuple(map(spoken, said())),
            data=full,
        )
        write_report(result, str(self.report), known)

    def _write_json(self, full: Mapping[str, Any]) -> None:
        text = json.dumps(full, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        text = re.sub(UNSEEN, lambda match: f"\\u{ord(match[0]):04x}", text)  # the same data
        if self.json_path == "-":
            sys.stdout.write(text)
            return
        with replacing(str(self.json_path)) as part:
            part.write_text(text, encoding="utf-8")


def failure_in_json(error: BaseException | None) -> dict[str, Any]:
    """Return what went wrong as JSON has it, with its kind, by which a program can tell it: see `WorkbenchError.kind`.

    Args:
        error: that ended a command; None: none.
    """
    if isinstance(error, WorkbenchError):
        return {"failure": {"kind": error.kind, "message": str(error)}}
    return {"failure": {"kind": "cancelled", "message": "interrupted"}} if error is not None else {}


def check_kind(option: str, path: str | None, suffix: str) -> None:
    """Refuse a suffix of another kind of file: a CSV named .png is a slip, and .toml may overwrite a model.

    Args:
        option: that was given.
        path: to be written; "-" and None are not files.
        suffix: that belongs to it; none at all, or one that nothing here has, is taken, too.

    Raises:
        InputError: another one.
    """
    result = Path(path or "").suffix.lower()
    if result in _FOREIGN and result != suffix:
        raise InputError(f"{option}: '{path}' must end in {suffix}")
