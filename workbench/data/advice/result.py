"""What the judgement of recorded data returns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from workbench.core.records.record import RecordPart
from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, suggest
from workbench.show.result import Result

__all__ = ["VERDICTS", "Advice", "Finding"]

# From harmless to serious.
VERDICTS = ("good", "unknown", "watch", "poor")


@dataclass(frozen=True)
class Finding(RecordPart):
    """The answer to one question about the data.

    Attributes:
        topic: name of the question, a key of `advise.TOPICS`.
        verdict: "good", "unknown" (these data cannot tell), "watch" (may harm) or "poor" (will harm).
        evidence: what was found, with numbers, in one line.
        advice: what to do, in one line; empty where there is nothing to do.
        values: the numbers by name, for programs.
        marks: column → samples that the finding is about.
    """

    topic: str
    verdict: str
    evidence: str
    advice: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    marks: dict[str, tuple[int, ...]] = field(default_factory=dict)

    def __str__(self) -> str:
        tail = f" → {self.advice}" if self.advice else ""
        return f"{self.topic}: {self.verdict}: {self.evidence}{tail}"


@dataclass(frozen=True, eq=False)
class Advice(Result):
    """Findings about one experiment, one for each topic.

    Attributes:
        experiment: the data.
        findings: in the order of `advise.TOPICS`.
        excited_orders: order of persistent excitation of all inputs jointly; None: at least as high as was tested.
        single_sine: an input whose excitation is one sine, or constant.
        order: order of the model these data are meant for, None where none was given.
    """

    _page = "workbench.data.advice.page:advice_page"
    _picture = "workbench.data.advice.picture:plot_advice"

    experiment: Experiment
    findings: tuple[Finding, ...]
    excited_orders: int | None
    single_sine: bool
    order: int | None = None

    @property
    def worst(self) -> str:
        """The most serious verdict."""
        return max((f.verdict for f in self.findings), key=VERDICTS.index, default=VERDICTS[0])

    @property
    def concerns(self) -> tuple[Finding, ...]:
        """What is "watch" or "poor", the serious ones first."""
        chosen = [f for f in self.findings if f.verdict in VERDICTS[2:]]
        return tuple(sorted(chosen, key=lambda f: -VERDICTS.index(f.verdict)))

    def finding(self, topic: str) -> Finding:
        """Return the finding about a topic.

        Args:
            topic: name of the topic.

        Raises:
            InputError: no such topic.
        """
        for finding in self.findings:
            if finding.topic == topic:
                return finding
        raise InputError(f"advice has no topic '{topic}'; {suggest(topic, [f.topic for f in self.findings])}")

    def refuse(self, order: int) -> None:
        """Raise where the inputs excite too little for a model of this order.

        A sine of one frequency excites two orders: it shows gain and phase at that frequency, which fix two
        parameters; whatever else a model of higher order says is made up.

        Args:
            order: order of the model.

        Raises:
            InputError: the model needs more orders than the inputs excite.
        """
        excited = self.excited_orders
        if excited is None or order <= excited:
            return
        names = ", ".join(self.experiment.input_names)
        what = "are constant" if self.experiment.n_inputs > 1 else "is constant"
        if excited:
            what = "is a single sine: it" if self.single_sine else "together" if "," in names else "has few lines: it"
            what = f"{what} excites {excited} order{'s' if excited > 1 else ''}"
        raise InputError(
            f"{self.experiment.name}: {names} {what}, too few for a model of order {order}; "
            "use a PRBS or a multisine with more lines, or a lower order"
        )

    def derived(self) -> dict[str, Any]:
        """Return the verdict."""
        return {"name": self.experiment.name, "worst": self.worst}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each finding."""
        yield ("topic", "verdict", "evidence", "advice")
        yield from ((f.topic, f.verdict, f.evidence, f.advice) for f in self.findings)
