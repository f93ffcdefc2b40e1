"""What a worker process of a study does: run one command after the other."""

from __future__ import annotations

import os
import platform
import time
import traceback
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.analysis.request import function
from workbench.core.blas import one_thread
from workbench.core.files import file_to_write
from workbench.core.job import Job as RequestJob
from workbench.core.option import asked_in_json, recast, values_of
from workbench.core.record import plain
from workbench.core.where import InWorker
from workbench.errors import WorkbenchError
from workbench.origin.call import origin_of_call
from workbench.report.extras import Written
from workbench.report.results import page_of, write_report
from workbench.study.commands import Command, command
from workbench.study.plan import Outcome

__all__ = ["Job", "perform"]

_NOT_WELL = 1  # exit code of a record that says so


@dataclass(frozen=True, kw_only=True)
class Job:
    """One analysis.

    Attributes:
        number: of the run, for whoever sent it.
        command: its name.
        subject: the models.
        options: of the command, by its keys, as TOML has them; files in place of references.
        command_line: that does the same.
        folder: in which it runs.
        workplace: where its result is written.
        csv: name of the CSV file without suffix, where other analyses take it; empty: none is wanted.
        confine: whether its FMU is confined, whatever its own options say.
    """

    number: int
    command: str
    subject: Sequence[str]
    options: Mapping[str, Any]
    command_line: str
    folder: Path
    workplace: Path
    csv: str
    confine: bool = False


def perform(_model: None, job: Job) -> Iterator[Outcome]:
    """Do an analysis and yield what it gave, once."""
    if not (job.folder.is_dir() and job.workplace.is_dir()):  # on another machine
        yield Outcome(
            reason=f"{job.folder} or {job.workplace} is not on {platform.node()}: on a cluster the folders of a study "
            "and of its store must lie on a file system that all machines share",
            kind=WorkbenchError.kind,
        )
        return
    os.chdir(job.folder)
    known = command(job.command)
    begin = time.monotonic()
    try:
        with one_thread():  # others of this study have the other cores
            outcome = _by_request(known, job)
    except WorkbenchError as error:
        outcome = Outcome(reason=error.args[0], kind=error.kind)
    except Exception as error:  # noqa: BLE001 - one analysis must not end the others, whatever is wrong with it
        outcome = Outcome(reason=_bug(error), kind=WorkbenchError.kind)
    files = _tables(job) if job.csv else {}
    yield replace(outcome, seconds=round(time.monotonic() - begin, 3), files=files)


def _bug(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(last.filename).name}, line {last.lineno}"
    return f"{type(error).__name__}: {error} ({place}); this is a bug of the workbench"


def _by_request(known: Command, job: Job) -> Outcome:
    asked, written, loading = known.asked(job.options)
    if job.confine and isinstance(asked, InWorker):
        stored = asked.isolated and getattr(asked, "store", None) is not None
        unwritten = {"store": None} if stored else {}  # it could not write one
        asked = recast(type(asked), asked, confine=True, **unwritten)
    _check_writable(written)
    begin = time.monotonic()
    work = RequestJob()
    given: Any = job.subject or job.options.get(known.subject, ())
    if known.several:
        given = [given] if isinstance(given, str) else list(given)
    elif job.subject:
        given = job.subject[0]
    with asked.opened(given, loading) as (subject, model_notes):
        record = asked.run(subject, work)
        page = page_of(record, **written.told(written.drawn))
        seconds = round(time.monotonic() - begin, 3)
        head = {"command": job.command, "version": __version__, "seconds": seconds, "asked": asked_in_json(asked)}
        data = {**head, **record.to_dict()}
        data = {key: plain(value) for key, value in data.items()}
        files = _write(record, written, job)
        if files:
            data["files"] = files
        notes = tuple(dict.fromkeys([*model_notes, *work.notes, *page.notes]))
        if written.report is not None:
            origin = origin_of_call(function(type(asked)), (subject,), values_of(asked), seconds=seconds)
            known_of = replace(origin, command=job.command, call=job.command_line, notes=notes, data=data)
            write_report(page, written.report, known_of)
    return Outcome(result=data, code=0 if asked.went_well(record) else _NOT_WELL, notes=notes)


def _check_writable(written: Written) -> None:
    for name, path in values_of(written).items():
        if isinstance(path, str | Path) and name not in written.plotted:
            file_to_write(path, option=name)


def _write(record: Any, written: Written, job: Job) -> list[str]:  # noqa: ANN401 - of any class
    """Write the files of a record; return those of the CSV."""
    tables = [job.workplace / f"{job.csv}.csv"] if job.csv else []
    tables += [Path(written.csv)] if written.csv is not None else []
    files = [str(file) for path in tables for file in record.to_csv(path) or ()]
    if written.plot is not None:
        record.plot(Path(written.plot), **written.told((*written.drawn, *written.plotted)))
    deque(written.write(record), 0)
    return files


def _tables(job: Job) -> dict[str, str]:
    """Return the CSV files by kind: NAME.csv is "csv", NAME_validation.csv is "validation"."""
    first = f"{job.csv}.csv"
    files = {f.name: f.read_text(encoding="utf-8") for f in job.workplace.glob(f"{job.csv}*.csv")}
    return {"csv" if n == first else Path(n).stem.removeprefix(f"{job.csv}_"): text for n, text in files.items()}
