"""Parameters of a system that meet requirements: what can be asked."""

from __future__ import annotations

from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.core.records.forms import File, Names
from workbench.core.records.option import EACH, option
from workbench.errors import InputError
from workbench.identification.calibrate.request import Free
from workbench.jobs.options import Workers
from workbench.requests.request import Request, Subject, function

if TYPE_CHECKING:
    from workbench.study.tune.result import TuneResult

__all__ = ["Tune", "tune"]

_WRITTEN = (".toml", ".ssp")
_CONTROLLER = (".mo", ".fmu")


class Tune(Request["str | Path", "TuneResult"]):
    """Find parameters of a system's blocks and FMUs with which it meets the requirements of a study.

    Every requirement at every point of the study is brought to a number that is at most 0 where it is met: the
    distance from its limit, over that limit, over 6 dB or over 45 deg. The largest of the soft ones is made as small
    as can be, with no hard one above 0. So what is met is met with the largest least reserve.

    Poles, margins, disk margins, gains, masks, bandwidths, H∞ and H2 norms of `lin` and `loop` are functions of a
    linear model M = P₁₁ + P₁₂K(1 − P₂₂K)⁻¹P₂₁: the blocks K with the parameters are taken out of the system once, so
    that other values need no other linearisation, and derivatives are exact: of a pole dλ = yᴴ dA x, of a singular
    value dσ = Re uᴴ dG v. A trust region with quadratic programmes over all active poles and peaks finds a local
    minimum, from several starts; what is unstable at a start is made stable first. The study is then run at the
    values found; where the operating point has moved, the system is linearised and designed anew.

    All other requirements (steps with limits, responses at an amplitude, limit cycles, onset, any number of a result)
    are measured by the study's own analyses; where the linear design violates one, the search goes on with all of
    them, with derivatives by differences. Each run is in the study's store. With a table [envelope] the worst case of
    its requirement is searched at the values found and added to the points until none is worse.

    What cannot be met is told: which requirements exclude each other, and what one costs the other. The minimum is a
    local one: another start may find a better. Sampled parts and delays are not taken apart: such analyses are run for
    each value. A linear model must be stable, integrators left out.

    Returns:
        Parameters, each requirement before and after, the requirements that hold the result, conflicts.

    Raises:
        InputError: the study is wrong or does not use the system, no such parameter, no such requirement.
        FmuError: a model cannot be opened.
        SimulationError: no start at which the requirements can be evaluated; none is measured at the end, where a file
            is wanted.

    Source: P. Apkarian, D. Noll, Nonsmooth H∞ synthesis, IEEE Trans. Automatic Control 51 (2006) 71-86; J. V. Burke,
    A. S. Lewis, M. L. Overton, A robust gradient sampling algorithm, SIAM J. Optimization 15 (2005) 751-779.

    Examples:
        The gain of a loop with L = k/(s (s + 1)²) for which the peak of |S| is 2.

        >>> from pathlib import Path
        >>> _ = Path("loop.toml").write_text('''
        ... components.error = {sum = "+-"}
        ... components.gain = 0.1
        ... components.plant = {block = "transfer_function", numerator = [1.0], denominator = [1.0, 2.0, 1.0, 0.0]}
        ... connections = {"gain.u" = "error.y", "plant.u" = "gain.y", "error.u2" = "plant.y"}
        ... inputs.r = "error.u1"
        ... outputs.y = "plant.y"
        ... ''')
        >>> _ = Path("wanted.toml").write_text('''
        ... analyses.loop = {command = "loop", model = "loop.toml", open = "plant.y"}
        ... [[requirements]]
        ... name = "robust"
        ... analysis = "loop"
        ... kind = "peak sensitivity"
        ... equal = 2.0
        ... tolerance = 0.0
        ... ''')
        >>> found = wb.tune("loop.toml", free={"gain.gain": (0.01, 10.0)}, study="wanted.toml", keep=False)
        >>> print(f"{found.requirements[0].after:.3f}")
        2.000
    """

    command = "tune"
    algorithm = "workbench.study.tune.run:run"
    example = "workbench tune system:rudder_loop --free controller.gain=0.1:10 --study wanted.toml --out tuned.toml"
    subject = Subject(
        name="system",
        type="str | Path",
        help="System file (.toml, .ssp), or a bundled one, system:NAME.",
        metavar="SYSTEM",
        words="System file (.toml, .ssp), or a bundled one: system:NAME.",
    )
    counts = "steps"
    isolated = False  # its analyses and linearisations are made in worker processes

    writes = ("out",)

    _: KW_ONLY
    free: Free = option(
        "Parameter of a block or an FMU to find, with its limits where they are known.", of=EACH, first=True
    )
    study: File = option("Study with the requirements; its analyses are of the same system.", first=True)
    hard: Names = option(
        "Requirement that must be met, whatever it costs the others; by default all count alike.",
        metavar="REQUIREMENT",
        default=(),
        first=True,
    )
    starts: int = option(
        "Number of further searches, from a Sobol' sequence within the limits.",
        metavar="N",
        least=0,
        default=4,
        first=True,
    )
    max_steps: int = option("Largest number of steps of a search.", metavar="N", least=1, default=300)
    max_measured: int = option(
        "Largest number of steps with requirements that are measured; each takes a run of their analyses for each "
        "parameter, and one more.",
        metavar="N",
        least=0,
        default=25,
    )
    out: File | None = option(
        "Write the system with the values found, .toml (comments stay) or .ssp; or the tuned blocks alone, sampled, as "
        "Modelica (.mo) or FMU.",
        default=None,
        first=True,
    )
    sample: float | None = option(
        "Sample period of the controller in a file .mo or .fmu.", unit="s", metavar="S", positive=True, default=None
    )
    fmi: int | None = option("FMI version of the controller in a file .fmu; 2 by default.", metavar="2|3", default=None)
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

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.free:
            raise InputError("free: name a parameter to find")
        suffix = "" if self.out is None else Path(self.out).suffix.lower()
        if self.out is not None and suffix not in (*_WRITTEN, *_CONTROLLER):
            raise InputError(f"out: {self.out} is none of .toml, .ssp, .mo, .fmu")
        if (suffix in _CONTROLLER) != (self.sample is not None):
            raise InputError("sample: a controller in a file .mo or .fmu needs a sample period, and nothing else does")
        if self.fmi is not None and suffix != ".fmu":
            raise InputError("fmi: only a controller in a file .fmu has a version; give out=… with that ending")
        if self.fmi not in (None, 2, 3):
            raise InputError(f"fmi: {self.fmi} is not 2 or 3")

    @property
    def place(self) -> Workers:
        """Where the analyses run."""
        return self.workers or Workers()

    def went_well(self, record: TuneResult) -> bool:
        """Return whether every requirement is met at every point.

        Args:
            record: of this request.
        """
        return record.passed


tune = function(Tune)
