"""The envelope of a study: what can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Literal, get_args

from workbench.core.records.forms import File
from workbench.core.records.named import named
from workbench.core.records.option import option
from workbench.jobs.options import Workers
from workbench.requests.request import Request, Subject, function

if TYPE_CHECKING:
    from pathlib import Path  # noqa: F401 - the subject's type, below

    from workbench.study.envelope.result import EnvelopeResult

__all__ = ["PLANS", "EnvelopeOf", "PlanName", "envelope"]

PlanName = Literal["grid", "random", "latin", "sobol"]
PLANS: tuple[str, ...] = get_args(PlanName)


class EnvelopeOf(Request["str | Path", "EnvelopeResult"]):
    """Map a requirement over parameters and failures, search its worst case, and give its probability.

    The study's table [envelope] names parameters with their ranges or distributions, a plan of points, and the
    requirement whose value is mapped. Its configurations are the failures. Every point is measured as `run` would, on
    worker processes that stay warm, and kept: the same command continues. The worst case is the smallest margin of the
    requirement; the search by differential evolution, then by Nelder and Mead's method, begins at the worst points of
    the plan. The probability has Wilson's interval, which is for independent points (plan "random").

    Use it where parameters are uncertain or failures are to be covered. A map shows what lies between the points only
    as far as they are close enough; the search finds a bad case, and does not prove that no other one is worse.

    Returns:
        Points with values, the worst case, probabilities, borders.

    Raises:
        InputError: the study is wrong: one line with the file, the table and the key; it has no [envelope].
        FmuError: a model cannot be opened.

    Source: E. B. Wilson, J. American Statistical Association 22 (1927) 209-212; R. Storn, K. Price, J. Global
    Optimization 11 (1997) 341-359; sampling as in `scipy.stats.qmc`.

    Examples:
        The output of 1/(tau s + 1) in rest is its input, whatever tau is.

        >>> from pathlib import Path
        >>> _ = Path("lags.toml").write_text('''
        ... models.lag = "fmu:FirstOrderLag"
        ... analyses.rest = {command = "trim", model = "lag", u0 = {u = 2.0}}
        ... envelope.parameters = {"lag.tau" = {range = [0.5, 2.0], steps = 3}}
        ... requirements = [{name = "gain", analysis = "rest", kind = "value", path = "y.y", max = 2.5}]
        ... ''')
        >>> found = wb.envelope("lags.toml", keep=False)
        >>> [round(p.margin, 9) for p in found.points]
        [0.5, 0.5, 0.5]
    """

    command = "run"
    called = "envelope"
    case = "a study with an [envelope]"
    written = "workbench.study.envelope.written:EnvelopeFiles"
    algorithm = "workbench.study.envelope.run:run"
    example = "workbench run study:aileron_envelope --report envelope.html"
    subject = Subject(
        name="study",
        type="str | Path",
        help="Study file (.toml) with a table [envelope], or a bundled one, study:NAME.",
        metavar="STUDY",
        words="Study file (.toml) with a table [envelope], or a bundled one: study:NAME.",
    )
    counts = "analyses"

    _: KW_ONLY
    plan: str | None = option(
        "Where the points lie; by default as the study says.",
        choices=PLANS,
        default=None,
    )
    points: int | None = option(
        "Number of points for each failure, with all plans but a grid.", metavar="N", least=1, default=None
    )
    seed: int | None = option("Seed of the random numbers.", metavar="N", least=0, default=None)
    search: int | None = option(
        "Evaluations of the search for the worst case, for each failure; 0: none.", metavar="N", least=0, default=None
    )
    width: float | None = option(
        "Wanted width of the interval of the probability: how many more points it takes is told.",
        metavar="W",
        positive=True,
        default=None,
    )
    store: File | None = option(
        "Folder in which finished analyses are kept; by default .workbench-store beside the study.",
        metavar="DIR",
        default=None,
    )
    keep: bool = option("Keep finished analyses, and reuse them.", default=True)
    workers: Workers | None = option(
        "Where the analyses run and under which limits; by default in one worker process per core.",
        default=None,
        group="Where it runs",
    )

    @classmethod
    def takes(cls, given: Sequence[str]) -> bool:
        """Return whether a study with a table [envelope] is given.

        Args:
            given: as the command line names it.
        """
        return bool(named("workbench.study.read:has_envelope")(given[0]))

    @property
    def place(self) -> Workers:
        """Where the analyses run."""
        return self.workers or Workers()

    def went_well(self, record: EnvelopeResult) -> bool:
        """Return whether every point was measured and meets the requirement, the worst case of the search, too."""
        return record.passed


envelope = function(EnvelopeOf)
