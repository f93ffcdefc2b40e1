"""Verdicts one by one, as a CI shows them: JUnit XML, which every CI reads."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from workbench.core.machine.files import replacing
from workbench.core.records.forms import File
from workbench.core.records.option import option
from workbench.errors import InputError, Mistake, WorkbenchError
from workbench.show.files_written import Written
from workbench.show.page import Page
from workbench.show.verdicts import Verdict

__all__ = [
    "ERROR",
    "FAILURE",
    "PASSED",
    "SKIPPED",
    "Case",
    "Judged",
    "JudgedFiles",
    "WithoutVerdicts",
    "check_junit",
    "mistakes_of",
]

PASSED, FAILURE, ERROR, SKIPPED = "passed", "failure", "error", "skipped"

# XML 1.0 has no way to write these.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One verdict.

    Attributes:
        group: what it belongs to, such as the analysis.
        name: of the requirement or the check.
        outcome: "passed", "failure", "error" (nothing was measured) or "skipped" (it does not apply).
        message: what was found, in one line.
        kind: of the requirement or the check.
        seconds: that it took [s].
        file: that it is about, as it was named.
        mark: text by whose first place in this file the line is found; empty: by `line`.
        line: its number; None: the file as a whole.
        suite: what the verdict is about where a result is about several things; empty: the result's.
    """

    group: str
    name: str
    outcome: str
    message: str
    kind: str = ""
    seconds: float = 0.0
    file: str = ""
    mark: str = ""
    line: int | None = None
    suite: str = ""

    @property
    def bad(self) -> bool:
        """Whether it is a failure or an error."""
        return self.outcome in {FAILURE, ERROR}


class Judged(ABC):
    """A result of verdicts, which a CI shows one by one."""

    @property
    @abstractmethod
    def suite(self) -> str:
        """What the verdicts are about."""

    @abstractmethod
    def cases(self) -> list[Case]:
        """Return the verdicts as a CI shows them."""

    def to_junit(self, path: str | Path) -> None:
        """Write the verdicts as JUnit XML, each as a test case.

        Args:
            path: path of the file.

        Raises:
            InputError: the file cannot be written.
        """
        _write_junit(self.suite, self.cases(), path)


class WithoutVerdicts(Judged):
    """What ended a command before it had verdicts, as a CI shows it: each mistake is an error.

    Args:
        command: its name.
        error: that ended it.
    """

    def __init__(self, command: str, error: WorkbenchError) -> None:
        self._command, self._kind, self._mistakes = command, error.kind, mistakes_of(error)

    @property
    def suite(self) -> str:
        return Path(self._mistakes[0].file).stem or self._command

    def cases(self) -> list[Case]:
        return [
            Case(
                group=self._command,
                name=f"mistake {number}",
                outcome=ERROR,
                message=said,
                kind=self._kind,
                file=mistake.file,
                line=mistake.line,
            )
            for number, (mistake, said) in enumerate(zip(self._mistakes, self._said, strict=True), start=1)
        ]

    def page(self) -> Page:
        """Return what a summary says."""
        summary = [Verdict("broken", said) for said in self._said]
        return Page(self._mistakes[0].file or self.suite, "There is no result.", {}, [], summary=summary)

    @property
    def _said(self) -> list[str]:
        return [m.message if m.line is None else f"line {m.line}: {m.message}" for m in self._mistakes]


def mistakes_of(error: WorkbenchError) -> Sequence[Mistake]:
    """Return what is wrong, one by one; the file of an error that says no more is the one that it begins with.

    Args:
        error: that ended a command.
    """
    if isinstance(error, InputError) and error.mistakes:
        return error.mistakes
    begins = str(error).partition(": ")[0]
    return [Mistake(str(error), begins if Path(begins).exists() else "")]


def _write_junit(suite: str, cases: Sequence[Case], path: str | Path) -> None:
    root = ET.Element("testsuites", {"name": "workbench", **_counts(cases)})
    for name in dict.fromkeys([*(c.suite or suite for c in cases)] or [suite]):
        _add_suite(root, name, [c for c in cases if (c.suite or suite) == name])
    ET.indent(root)
    with replacing(path) as part:
        ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _add_suite(root: ET.Element, suite: str, cases: Sequence[Case]) -> None:
    inner = ET.SubElement(root, "testsuite", {"name": _clean(suite), **_counts(cases)})
    for case in cases:
        names = {"name": _clean(case.name), "classname": _clean(f"{suite}.{case.group}")}
        told, message = ET.SubElement(inner, "testcase", {**names, "time": f"{case.seconds:.3f}"}), _clean(case.message)
        if case.outcome == PASSED:
            ET.SubElement(told, "system-out").text = message
        else:
            kind = {} if case.outcome == SKIPPED else {"type": case.kind}
            ET.SubElement(told, case.outcome, {"message": message, **kind}).text = message


def _counts(cases: Sequence[Case]) -> dict[str, str]:
    keys = {"failures": FAILURE, "errors": ERROR, "skipped": SKIPPED}
    numbers = {key: str(sum(c.outcome == outcome for c in cases)) for key, outcome in keys.items()}
    return {"tests": str(len(cases)), **numbers, "time": f"{sum(c.seconds for c in cases):.3f}"}


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("�", text)


def check_junit(path: str | Path | None) -> None:
    """Refuse another suffix than that of XML, before anything is run: .toml may overwrite the study.

    Args:
        path: to be written; None: nothing.

    Raises:
        InputError: the suffix.
    """
    if path is not None and Path(path).suffix.lower() not in {".xml", ""}:
        raise InputError(f"--junit: '{path}' must end in .xml")


class JudgedFiles(Written):
    """The files of a record that is `Judged`."""

    _: KW_ONLY
    junit: File | None = option("Write the verdicts as JUnit XML, for CI.", default=None, first=True)

    def check(self, request: Any) -> None:  # noqa: ANN401 - see `Written`
        check_junit(self.junit)

    def write(self, record: Judged) -> Iterator[str | Path]:
        if self.junit is not None:
            record.to_junit(self.junit)
            yield self.junit
