"""What a worker process does: one experiment after the other, with its pictures."""

from __future__ import annotations

import io
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from scripts.reproduce.measurement import Picture
from scripts.reproduce.registry import experiments
from scripts.reproduce.result import Drawing, plain
from workbench.errors import WorkbenchError, one_line

__all__ = ["ExperimentJob", "Found", "perform"]


@dataclass(frozen=True, kw_only=True)
class ExperimentJob:
    """One experiment.

    Attributes:
        experiment: its name.
        targets: that are wanted of it.
        figures: pictures of these are wanted; None: of all.
        chapter: of its first target.
        svg: draw them for a page.
        folder: write them as files into it; None: no files.
    """

    experiment: str
    targets: tuple[str, ...]
    figures: frozenset[int] | None
    chapter: str
    svg: bool
    folder: Path | None


@dataclass(frozen=True, kw_only=True)
class Found:
    """What came of a job.

    Attributes:
        values: target → one number or several.
        remarks: target → in words.
        drawings: its pictures.
        problem: why there is nothing, or what is missing; "": all is there.
        processor_seconds: that it took.
    """

    values: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)
    remarks: Mapping[str, str] = field(default_factory=dict)
    drawings: tuple[Drawing, ...] = ()
    problem: str = ""
    processor_seconds: float = 0.0


def perform(_model: None, job: ExperimentJob) -> Iterator[Found]:
    """Run an experiment and yield what it found, once; whatever goes wrong there is its own affair."""
    begin = time.process_time()
    try:
        found = _measured(job)
    except WorkbenchError as error:
        found = Found(problem=str(error))
    except Exception as error:  # noqa: BLE001 - a bug in one experiment must not cost the others
        found = Found(problem=f"{type(error).__name__}: {one_line(str(error))}")
    yield Found(**{**vars(found), "processor_seconds": time.process_time() - begin})


def _measured(job: ExperimentJob) -> Found:
    done = experiments()[job.experiment].measure()
    wanted = [p for p in done.pictures if job.figures is None or not p.figures or job.figures & set(p.figures)]
    shown = job.svg or job.folder is not None
    return Found(
        values={name: plain(done.values[name]) for name in job.targets if name in done.values},
        remarks={name: text for name, text in done.remarks.items() if name in job.targets},
        drawings=tuple(_drawn(p, job, number) for number, p in enumerate(wanted)) if shown else (),
    )


def _drawn(picture: Picture, job: ExperimentJob, number: int) -> Drawing:
    from workbench.show.figure import save  # noqa: PLC0415 - matplotlib is slow to import

    figure = picture.draw()
    files: tuple[str, ...] = ()
    if job.folder is not None:
        path = job.folder / _file_name(picture, job, number)
        save(figure, path)
        files = (str(path),)
    buffer = io.StringIO()
    if job.svg:
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return Drawing(picture.figures, picture.words, job.chapter, buffer.getvalue(), files)


def _file_name(picture: Picture, job: ExperimentJob, number: int) -> str:
    """Return a name that tells the figures and differs between the pictures of all experiments."""
    numbers = "_".join(str(n) for n in picture.figures)
    place = f"figure_{numbers}" if numbers else f"chapter_{job.chapter.replace('.', '_')}"
    experiment = re.sub(r"[^a-z0-9]+", "_", job.experiment.lower()).strip("_")
    return f"{place}_{experiment}_{number + 1}.png"
