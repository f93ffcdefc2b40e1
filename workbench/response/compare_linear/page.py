"""The page of linear models beside a measured response."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from workbench.response.compare_linear.result import LinComparison
from workbench.response.compare_linear.result import MethodAgreement as Agreement
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted, number
from workbench.show.verdicts import Verdict

__all__ = ["comparison_page"]


def comparison_page(result: LinComparison) -> Page:
    """Return the page of all methods beside a measurement: words, picture, verdict at each frequency."""
    counts = Counter((v.method, v.agrees) for v in result.verdicts)
    methods = dict.fromkeys(v.method for v in result.verdicts)
    model = ", ".join(dict.fromkeys(one.model for one in result.results.values()))
    return Page(
        title=f"Linear models of {model} against measurement: {result.input} → {result.output}",
        lead=f"{counted(len(result.results), 'linear model')} of the same operating point, compared with the response "
        "to sines that was measured on the model itself.",
        facts={"agreement": "within 0.5 dB and 5° of the measured response"},
        sections=[
            Section(
                "Frequency responses",
                items=[words for words in result.words if not _is_agreement(words, methods)],
                figures=[(result.plot, "Curves: linear models; circles: measured with sines.")],
            ),
            _verdict_table(result),
            *_inapplicable(result),
        ],
        summary=[_agreement(m, counts, result.words) for m in methods],
        notes=result.notes,
        kind="lin",
    )


def _is_agreement(words: str, methods: Iterable[str]) -> bool:
    return any(words.startswith(f"{m}: within ") for m in methods)


def _agreement(method: str, counts: Mapping[tuple[str, bool | None], int], words: Sequence[str]) -> Verdict:
    yes, no = counts.get((method, True), 0), counts.get((method, False), 0)
    if not yes + no:
        return Verdict("unknown", f"{method}: nothing was measured to compare it with")
    word = "agrees" if not no else "partly" if yes else "differs"
    stated = next((text for text in words if _is_agreement(text, [method])), "")
    usual = f"{method}: agrees with the measurement at {yes} of {counted(yes + no, 'frequency', 'frequencies')}"
    return Verdict(word, stated or usual)


def _verdict_table(result: LinComparison) -> Section:
    headings = ("method", "frequency [Hz]", "gain less measured [dB]", "phase less measured [deg]", "verdict")
    table = PageTable(headings, [_row(v) for v in result.verdicts], verdict=4, right=(1, 2, 3))
    return Section("At each frequency", tables=[table], folded=len(result.verdicts) > 30)


def _row(v: Agreement) -> tuple[str, ...]:
    return (v.method, f"{v.frequency_hz:.5g}", number(v.gain_db, ".3f"), number(v.phase_deg, ".2f"), v.words)


def _inapplicable(result: LinComparison) -> list[Section]:
    if not result.failed:
        return []
    return [Section("Methods that do not apply", items=[f"{name}: {why}" for name, why in result.failed.items()])]
