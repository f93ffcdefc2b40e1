"""What a command says to GitHub where it runs in one of its jobs: the job's summary, and errors at files.

The variables and the form of the lines are those of GitHub's "Workflow commands".
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.errors import InputError, one_line

if TYPE_CHECKING:
    from workbench.show.cases import Judged
    from workbench.show.page import Page

__all__ = ["summarise", "tell_error", "tell_github"]

_NOTHING = "nothing is required: there is no verdict"

_IN_A_MESSAGE = {"%": "%25", "\r": "%0D", "\n": "%0A"}
_IN_A_PROPERTY = {**_IN_A_MESSAGE, ":": "%3A", ",": "%2C"}


def summarise(page: Callable[[], Page]) -> None:
    """Add a page to the summary of the job; elsewhere nothing is done.

    Args:
        page: makes its page.

    Raises:
        InputError: the summary cannot be written.
    """
    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    if not (_on_github() and summary):
        return
    from workbench.show.markdown import markdown_of

    text = markdown_of(page())
    try:
        with Path(summary).open("a", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise InputError(f"GITHUB_STEP_SUMMARY: {summary} cannot be written: {error.strerror or error}") from None


def tell_github(record: Judged, page: Callable[[], Page], ended: BaseException | None = None) -> None:
    """Add a page to the summary of the job, and show what is not met as errors; elsewhere nothing is done.

    Args:
        record: whose verdicts these are.
        page: makes its page.
        ended: what ended the command early, and is shown when it is told.

    Raises:
        InputError: the summary cannot be written.
    """
    summarise(page)
    if _on_github() and not record.cases() and ended is None:
        sys.stderr.write(f"::warning::{_escaped(one_line(f'{record.suite}: {_NOTHING}'), _IN_A_MESSAGE)}\n")
    later = [m.message for m in ended.mistakes] if isinstance(ended, InputError) else []
    for case in record.cases() if _on_github() else ():
        if case.bad and not any(case.message.startswith(text) for text in later):
            tell_error(f"{case.group} {case.name}: {case.message}", case.file, case.mark, case.line)


def tell_error(message: str, file: str = "", mark: str = "", line: int | None = None) -> None:
    """Let GitHub show an error, by a line on standard error: standard output may belong to JSON. Elsewhere do nothing.

    Args:
        message: what is wrong.
        file: that it is about; it is named if it belongs to the folder of the job.
        mark: text in it, at whose line the error is shown.
        line: its number, where there is no such text.
    """
    if _on_github():
        place = _place(Path(file), mark, line) if file else {}
        properties = ",".join(f"{name}={_escaped(value, _IN_A_PROPERTY)}" for name, value in place.items())
        command = f"::error {properties}" if properties else "::error"
        sys.stderr.write(f"{command}::{_escaped(one_line(message), _IN_A_MESSAGE)}\n")


def _on_github() -> bool:
    return os.environ.get("GITHUB_ACTIONS") == "true"


def _place(path: Path, mark: str, line: int | None) -> dict[str, str]:
    root = Path(os.environ.get("GITHUB_WORKSPACE") or Path.cwd()).resolve()
    full = path.resolve()
    if not full.exists() or not full.is_relative_to(root):
        return {}
    result = {"file": full.relative_to(root).as_posix()}
    if mark and full.is_file():
        lines = full.read_text(encoding="utf-8", errors="replace").splitlines()
        line = next((k for k, row in enumerate(lines, start=1) if mark in row), None)
    result |= {} if line is None else {"line": str(line)}
    return result


def _escaped(text: str, table: Mapping[str, str]) -> str:
    return "".join(table.get(character, character) for character in text)
