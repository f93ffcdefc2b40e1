"""The reproduction page: every figure of the source report, target and measured, with the pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import IO, TYPE_CHECKING, cast

from scripts.reproduce.targets import MISSED, NOT_REACHABLE, VERDICTS, PublishedTarget
from workbench.fmi.bundled import bundled_names, bundled_path
from workbench.model.content_hash import content_hash
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted, sentence
from workbench.show.verdicts import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from scripts.reproduce.result import Drawing, ReproduceResult, TargetList, TargetResult

__all__ = ["TITLES", "reproduce_page", "targets_page"]

# Chapters of the source report.
TITLES: Mapping[str, str] = {
    "3": "Linearisation of single blocks",
    "4": "Frequency response",
    "6": "Elevator flight control law",
    "7": "Rudder actuator",
    "8": "Aeroelastic aircraft with a failed outer aileron",
}
_HEADINGS = ("target", "verdict", "basis", "published", "tolerance", "measured", "figures", "what")
_ORIGINS: Mapping[str, str] = {
    "printed": "a printed number", "described": "words of the source report", "asked": "a bound of our own"
}  # fmt: skip
_HASH = 16  # characters of a file's hash that are shown


def reproduce_page(result: ReproduceResult) -> Page:
    """Return the page.

    Args:
        result: what to report.
    """
    chapters = sorted({_chapter(o.target.chapter) for o in result.outcomes})
    return Page(
        title="The source report, measured now",
        lead=sentence(result.words),
        facts={"asked for": ", ".join(result.selection) or "everything"},
        summary=[Verdict(o.verdict, _line(o)) for o in result.outcomes if not o.passed],
        sections=[
            _counts(result),
            *_not_met(result),
            *(_section(c, result) for c in chapters),
            *_of_data([o.target for o in result.outcomes]),
            _of_fmus(),
            _of_time(result),
        ],
    )


def targets_page(result: TargetList) -> Page:
    """Return the page of targets that are to be measured.

    Args:
        result: what to list.
    """
    headings = ("target", "basis", "figures", "what", "published", "tolerance")
    chapters = dict.fromkeys(_title(t.chapter) for t in result.targets)
    return Page(
        title="Targets of the source report",
        lead=f"{counted(len(result.targets), 'target')}.",
        facts={},
        sections=[
            Section(c, tables=[PageTable(headings, [_asked(t) for t in result.targets if _title(t.chapter) == c])])
            for c in chapters
        ],
        kind="reproduce",
    )


def _asked(target: PublishedTarget) -> tuple[str, ...]:
    figures = ", ".join(map(str, target.figures))
    return (target.name, target.basis, figures, target.what, target.text, target.tolerance)


def _title(chapter: str) -> str:
    number = _chapter(chapter)
    return f"{number} {TITLES.get(number, '')}".strip()


def _chapter(text: str) -> str:
    return text.split(".", maxsplit=1)[0]


def _line(outcome: TargetResult) -> str:
    return f"{outcome.target.name}: {outcome.target.text} published, {outcome.text} measured"


def _counts(result: ReproduceResult) -> Section:
    """Say what the verdicts are worth: a prediction could have come out otherwise, what was fitted could hardly."""
    headings = ("basis", *VERDICTS, *_ORIGINS.values())
    rows = []
    for basis, found in result.counts.items():
        origins: Counter[str] = Counter(o.target.origin for o in result.outcomes if o.target.basis == basis)
        if any(found.values()):
            rows.append((basis, *(str(n) for n in found.values()), *(str(origins[name]) for name in _ORIGINS)))
    words = (
        "Predicted: the figure could have come out otherwise. Fitted: data of a bundled model, or of the experiment, "
        "were chosen to give it; that it is met says that the fit still holds. Structural: it follows from how the "
        "model is made, or is a printed number that the model was given."
    )
    return Section("What the verdicts are worth", paragraphs=[words], tables=[PageTable(headings, rows)])


def _of_data(targets: Sequence[PublishedTarget]) -> Iterator[Section]:
    """List what was fitted, and which data were chosen for it."""
    rows = [(t.name, f"fmu:{t.fmu}", t.fitted_by) for t in targets if t.fitted_by is not None]
    if rows:
        yield Section(
            "What was fitted", tables=[PageTable(("target", "FMU", "what was chosen to give it"), rows)], folded=True
        )


def _not_met(result: ReproduceResult) -> Iterator[Section]:
    """Say of each target that is not met why."""
    for verdict, title in ((MISSED, "Missed"), (NOT_REACHABLE, "Not reachable, and why")):
        lines = [
            f"{o.target.name}: {o.target.text} asked for; {o.reason}." for o in result.outcomes if o.verdict == verdict
        ]
        if lines:
            yield Section(title, items=lines)


def _section(chapter: str, result: ReproduceResult) -> Section:
    outcomes = [o for o in result.outcomes if _chapter(o.target.chapter) == chapter]
    return Section(
        _title(chapter),
        tables=[PageTable(_HEADINGS, [_row(o) for o in outcomes], verdict=1, right=())],
        figures=[
            (partial(_figure, d), _caption(d)) for d in result.drawings if d.svg and _chapter(d.chapter) == chapter
        ],
        parts=list(_remarks(outcomes)),
    )


def _row(outcome: TargetResult) -> tuple[str, ...]:
    t = outcome.target
    origin = "" if t.origin == "printed" else f" ({t.origin})"
    figures = ", ".join(str(n) for n in t.figures)
    place = f"{t.chapter}: {t.what}"
    return (t.name, outcome.verdict, t.basis, f"{t.text}{origin}", t.tolerance, outcome.text, figures, place)


def _remarks(outcomes: Sequence[TargetResult]) -> Iterator[Section]:
    """Yield how targets are read, and what else was seen."""
    lines = []
    for o in outcomes:
        said = [text for text in (o.target.note, o.remark if o.passed else "") if text]
        if said:
            lines.append(f"{o.target.name}: {'. '.join(said)}.")
    if lines:
        yield Section("How the targets are read, and what else was seen", items=lines, folded=True, explains=True)


def _caption(drawing: Drawing) -> str:
    plural = "s" if len(drawing.figures) > 1 else ""
    numbers = ", ".join(str(n) for n in drawing.figures)
    place = f"Figure{plural} {numbers}" if numbers else f"Chapter {drawing.chapter}"
    return f"{place} of the source report. {drawing.words}"


def _of_fmus() -> Section:
    """Say on which files all this was measured."""
    rows = [(f"fmu:{name}", content_hash(bundled_path(f"fmu:{name}"))[:_HASH]) for name in bundled_names()]
    return Section("The bundled FMUs", tables=[PageTable(("FMU", "sha256"), rows)], folded=True, explains=True)


def _of_time(result: ReproduceResult) -> Section:
    longest = sorted(result.processor_seconds.items(), key=lambda item: -item[1])
    table = PageTable(("experiment", "processor time [s]"), [(name, f"{s:.2f}") for name, s in longest])
    total = sum(result.processor_seconds.values())
    words = f"{result.seconds:.1f} s with {result.jobs} processes at a time, {total:.1f} s of processor time."
    return Section("How long it took", paragraphs=[words], tables=[table], folded=True, explains=True)


class _Picture:
    """A picture that was drawn in another process, as a page takes it."""

    def __init__(self, svg: str) -> None:
        self._svg = svg

    def savefig(self, target: IO[str], *, format: str, metadata: object = None) -> None:  # noqa: A002 - matplotlib's name
        """Write it, whatever the metadata; it was drawn as SVG."""
        target.write(self._svg)


def _figure(drawing: Drawing) -> Figure:
    return cast("Figure", _Picture(drawing.svg))
