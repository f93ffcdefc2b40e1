"""What a worker process of a study does: run one command after the other."""

from __future__ import annotations

import platform
import time
import traceback
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.core.machine.blas import one_thread
from workbench.core.machine.files import file_to_write
from workbench.core.records.option import asked_in_json, recast, values_of
from workbench.core.records.record import plain
from workbench.errors import WorkbenchError
from workbench.jobs.job import Job as RequestJob
from workbench.jobs.options import InWorker
from workbench.model.described_model import DescribedModel
from workbench.model.loading import Loading
from workbench.requests.call import origin_of_call
from workbench.requests.request import Request, function
from workbench.response.simulate.request import Simulate
from workbench.show.files_written import Written
from workbench.show.result import page_of, write_report
from workbench.study.between_rows import left_out, with_rows_between
from workbench.study.commands import Command, command
from workbench.study.plan import RunResult
from workbench.system.load import open_file

__all__ = ["CommandJob", "perform"]

_NOT_WELL = 1  # exit code of a record that says so
_MOST_OPEN = 4  # models


@dataclass(frozen=True, kw_only=True)
class CommandJob:
    """One analysis.

    Attributes:
        number: of the run, for whoever sent it.
        command: name of its request.
        subject: the models.
        options: of the command, by its keys, as TOML has them; files in place of references.
        command_line: that does the same.
        folder: in which it runs.
        workplace: where its result is written.
        csv: name of the CSV file without suffix, where other analyses take it; empty: none is wanted.
        confine: whether its FMU is confined, whatever its own options say.
        files: that it depends on → SHA-256.
        rows: of a time history, see `PlannedRun`.
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
    files: Mapping[str, str] = field(default_factory=dict)
    rows: str = ""


def perform(_model: None, job: CommandJob) -> Iterator[RunResult]:
    """Do an analysis and yield what it gave, once."""
    if not (job.folder.is_dir() and job.workplace.is_dir()):  # on another machine
        yield RunResult(
            reason=f"{job.folder} or {job.workplace} is not on {platform.node()}: on a cluster the folders of a study "
            "and of its store must lie on a file system that all machines share",
            kind=WorkbenchError.kind,
        )
        return
    known = command(job.command)
    begin = time.monotonic()
    try:
        with chdir(job.folder), one_thread():  # others of this study have the other cores
            outcome = _by_request(known, job)
    except WorkbenchError as error:
        outcome = RunResult(reason=error.args[0], kind=error.kind)
    except Exception as error:  # noqa: BLE001 - one analysis must not end the others, whatever is wrong with it
        outcome = RunResult(reason=_bug(error), kind=WorkbenchError.kind)
    files = _tables(job) if job.csv else {}
    yield replace(outcome, seconds=round(time.monotonic() - begin, 3), files=files)


def _bug(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(last.filename).name}, line {last.lineno}"
    return f"{type(error).__name__}: {error} ({place}); this is a bug of the workbench"


def _by_request(known: Command, job: CommandJob) -> RunResult:
    request, written, loading = known.asked(job.options)
    if job.confine and isinstance(request, InWorker):
        stored = request.isolated and getattr(request, "store", None) is not None
        unwritten = {"store": None} if stored else {}  # it could not write one
        request = recast(type(request), request, confine=True, **unwritten)
    _check_writable(written)
    begin = time.monotonic()
    work = RequestJob()
    given: Any = job.subject or job.options.get(known.subject, ())
    if known.several:
        given = [given] if isinstance(given, str) else list(given)
    elif job.subject:
        given = job.subject[0]
    with _opened(request, given, loading, job) as (subject, model_notes):
        record, more, unknown = _with_rows(request, subject, request.run(subject, work), job.rows)
        page = page_of(record, **written.told(written.drawn))
        seconds = round(time.monotonic() - begin, 3)
        head = {"command": request.command, "version": __version__, "seconds": seconds, "asked": asked_in_json(request)}
        data = {**head, **record.to_dict(), **more}
        data = {key: plain(value) for key, value in data.items()}
        files = _write(record, written, job)
        if files:
            data["files"] = files
        notes = tuple(dict.fromkeys([*model_notes, *work.notes, *page.notes, *unknown]))
        if written.report is not None:
            origin = origin_of_call(function(type(request)), (subject,), values_of(request), seconds=seconds)
            known_of = replace(origin, command=request.command, call=job.command_line, notes=notes, data=data)
            write_report(page, written.report, known_of)
    return RunResult(result=data, code=0 if request.went_well(record) else _NOT_WELL, notes=notes)


def _with_rows(
    request: Request[Any, Any],
    model: object,
    record: Any,  # noqa: ANN401 - of any class
    rows: str,
) -> tuple[Any, Mapping[str, Any], tuple[str, ...]]:
    """Return a record with the rows that are needed, else what its rows leave out; and a note where nothing tells."""
    if not rows or not isinstance(request, Simulate):
        return record, {}, ()
    finer, note = with_rows_between(request, model, record)
    notes = (note,) if note else ()
    return (finer, {}, notes) if rows == "more" else (record, {"between_rows": left_out(record, finer)}, notes)


# Models of analyses before, without any values set: what they were opened as. Nothing is ever run on these themselves.
_open: list[tuple[object, DescribedModel]] = []


@contextmanager
def _opened(
    request: Request[Any, Any],
    given: Any,  # noqa: ANN401 - a path or paths
    loading: Loading,
    job: CommandJob,
) -> Iterator[tuple[Any, tuple[str, ...]]]:
    """Yield as `Request.opened`; where only values of the same model are others, its files stay open and loaded."""
    known = request.subject.opened and isinstance(given, str) and job.files
    model = _again(given, loading, job) if known else None
    if model is None:
        with request.opened(given, loading) as result:
            yield result
        return
    try:
        yield model, model.notes
    finally:
        model.end_sessions()


def _again(given: str, loading: Loading, job: CommandJob) -> DescribedModel | None:
    """Return a model that is open, with the values asked for; None: it is to be opened anew, which tells errors."""
    plain = recast(Loading, loading, start_values={})
    key = (given, job.folder, job.files, values_of(plain))
    try:
        if all(key != known for known, _ in _open):
            _open.append((key, open_file(given, plain)))
        number = next(k for k, (known, _) in enumerate(_open) if known == key)
        _open.append(_open.pop(number))  # the newest is the last
        while len(_open) > _MOST_OPEN:
            _open.pop(0)[1].close()
        return _open[-1][1].reopened(values_of(loading)["start_values"])
    except WorkbenchError:
        return None


def _check_writable(written: Written) -> None:
    for name, path in values_of(written).items():
        if isinstance(path, str | Path) and name not in written.plotted:
            file_to_write(path, option=name)


def _write(record: Any, written: Written, job: CommandJob) -> list[str]:  # noqa: ANN401 - of any class
    """Write the files of a record; return those of the CSV."""
    tables = [job.workplace / f"{job.csv}.csv"] if job.csv else []
    tables += [Path(written.csv)] if written.csv is not None else []
    files = [str(file) for path in tables for file in record.to_csv(path) or ()]
    if written.mat is not None:
        record.to_mat(written.mat)
    if written.plot is not None:
        record.plot(Path(written.plot), **written.told((*written.drawn, *written.plotted)))
    deque(written.write(record), 0)
    return files


def _tables(job: CommandJob) -> dict[str, str]:
    """Return the CSV files by kind: NAME.csv is "csv", NAME_validation.csv is "validation"."""
    first = f"{job.csv}.csv"
    files = {f.name: f.read_text(encoding="utf-8") for f in job.workplace.glob(f"{job.csv}*.csv")}
    return {"csv" if n == first else Path(n).stem.removeprefix(f"{job.csv}_"): text for n, text in files.items()}
