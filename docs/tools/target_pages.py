"""The page of the published figures, generated from the file that tests and `dev.py reproduce` read."""

from __future__ import annotations

from collections.abc import Iterator

from scripts.reproduce.targets import PublishedTarget, read_targets

__all__ = ["targets_page"]

_INTRODUCTION = """# Published figures

Every figure of the source report that the bundled FMUs are compared with, with its tolerance, from the one file that
tests, scripts and [`dev.py reproduce`](../methods/reproduction.md) read. *Printed*: a number of the source report;
*described*: its words, the limits are our reading; *asked*: a bound of our own where the source report gives no number.
*Predicted*: it could have come out otherwise; *fitted*: data of a bundled model were chosen to give it; *structural*:
it follows from how the model is made, or is a printed number that the model was given. Where digits are printed, the
tolerance is half of the last one, or the note says why not. What is measured today is not on this page, but for targets
that are not met: run `dev.py reproduce`.
"""


def targets_page() -> str:
    """Return the Markdown of the page."""
    parts = [_INTRODUCTION]
    chapters = dict.fromkeys(t.chapter.partition(".")[0] for t in read_targets().values())
    for chapter in chapters:
        found = [t for t in read_targets().values() if t.chapter.partition(".")[0] == chapter]
        parts += [f"## Chapter {chapter}", "", *_table(found), ""]
    return "\n".join(parts)


def _table(targets: list[PublishedTarget]) -> Iterator[str]:
    yield "| target | chapter | what | published | tolerance | origin | basis |"
    yield "|---|---|---|---|---|---|---|"
    for t in targets:
        chosen = f"{t.fmu}, {t.fitted_by}" if t.fitted_by else None
        instead = f"{t.instead.text}: {t.instead.why}" if t.instead else None
        said = {"note": t.note, "chosen for it": chosen, "cannot be met": t.reason, "falls short": t.shortfall}
        why = "".join(f"<br>{word}: {_cell(text)}" for word, text in {**said, "here": instead}.items() if text)
        what = f"{_cell(t.what)}{why}"
        yield f"| `{t.name}` | {t.chapter} | {what} | {_cell(t.text)} | {t.tolerance} | {t.origin} | {t.basis} |"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "&#124;").replace("*", r"\*").replace("_", r"\_").replace("<", "&lt;")
