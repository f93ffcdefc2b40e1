"""A rational model from a measured frequency response: what can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Annotated, Literal

from workbench.core.records.forms import FILES, word_or_number
from workbench.core.records.named import named
from workbench.core.records.option import option
from workbench.requests.request import Request, Subject, function

if TYPE_CHECKING:  # the types of the subject and of the record, below
    from pathlib import Path

    from control import FrequencyResponseData

    from workbench.core.values.response import Response
    from workbench.data.bla.result import BlaResult
    from workbench.identification.fit.result import FitResult  # noqa: F401
    from workbench.response.nfr.result import NfrResult

__all__ = ["Fit", "fit"]


_ORDER = word_or_number("auto", what="a number of states")

if TYPE_CHECKING:
    _Order = int | Literal["auto"]
    _Several = Sequence[Response | NfrResult | BlaResult | FrequencyResponseData | str | Path]
else:
    _Order = Annotated[object, _ORDER]
    _Several = Annotated[object, FILES]


class Fit(Request["Response | NfrResult | BlaResult | FrequencyResponseData | str | Path", "FitResult"]):
    """Fit a linear model to measured frequency responses: nfr, bla, or a table of frequency, gain and phase.

    Vector fitting finds poles near the right ones, then the squares of the misfits over their measured errors are made
    least (maximum likelihood where errors are normal). So a linear model at an amplitude comes from sines as well.

    Responses of several inputs and outputs give one model of all of them (`also`, or files that hold them all): a state
    space of the order, whose poles they have in common. Each channel may have frequencies of its own; the errors of
    channels are taken as independent.

    Errors are those of the measurement, and `accuracy` besides, which says how well a rational model has to follow what
    may not be one. The response of a sampled model (bla) gives a sampled model, that of sines a continuous one.

    Not for: delays that are not given, which take states instead.

    Returns:
        The model, how well it follows, and the errors of its poles.

    Raises:
        InputError: no such file, no response in it, channels that are missing or come twice, or too few points for the
            order.

    Source: B. Gustavsen and A. Semlyen, IEEE Trans. Power Delivery 14 (1999); R. Pintelon and J. Schoukens, System
    Identification: A Frequency Domain Approach, 2nd ed., chapter 9.

    Examples:
        >>> import numpy as np
        >>> f = np.geomspace(0.01, 10.0, 30)
        >>> value = 1.0 / (2j * np.pi * f + 1.0)
        >>> print(wb.fit(wb.Response(f, value), order=1).poles.real.round(6))
        [-1.]

        Two outputs with a pole in common make a model of one state.

        >>> both = [wb.Response(f, k * value, input="u", output=f"y{k}") for k in (1, 2)]
        >>> found = wb.fit(both[0], also=both[1:], order=1)
        >>> print(found.poles.real.round(6), (found.C @ found.B).ravel().round(6))
        [-1.] [1. 2.]
    """

    command = "identify"
    called = "fit"
    case = "measured frequency responses"
    algorithm = "workbench.identification.fit.run:run"
    example = "workbench identify nfr.json --amplitude 1 --order 4 --json model.json"
    counts = "steps"
    subject = Subject(
        name="response",
        type="Response | NfrResult | BlaResult | FrequencyResponseData | str | Path",
        help="A response, of python-control, too, or a file.",
        metavar="RESPONSE",
        words="JSON of nfr or bla; CSV with frequency [Hz], gain (or gain_db) and phase [deg], or real and imag, and "
        "error (relative, 95 %) if known, of several channels gain OUTPUT/INPUT and so on; .mat with data of an frd.",
    )

    _: KW_ONLY
    also: _Several | None = option(
        "Responses of other inputs and outputs of the same system, for one model of all.",
        metavar="RESPONSE,..",
        default=None,
    )
    order: _Order = option("Number of states; auto takes the smallest Bayesian criterion.", default="auto")
    amplitude: float | None = option(
        "Amplitude (of bla: root mean square) of the response to fit, where there are several.",
        metavar="A",
        default=None,
    )
    max_order: int = option("Largest order that auto considers.", metavar="N", least=1, default=10)
    accuracy: float = option(
        "Relative error of the response that does not matter, besides the measured one.",
        least=0.0,
        default=0.003,
    )
    delay: float = option("Known delay, which is taken out of the response.", unit="s", least=0.0, default=0.0)
    feedthrough: bool = option("Fit the direct feedthrough D; otherwise it is zero.", default=True)
    stable: bool = option("Keep the poles stable.", default=True)

    @classmethod
    def takes(cls, given: Sequence[str]) -> bool:
        """Return whether a measured response is given, and not a record of time.

        Args:
            given: as the command line names it.
        """
        return bool(given) and bool(named("workbench.identification.fit.reading:is_response")(given[0]))


fit = function(Fit)
