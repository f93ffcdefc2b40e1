"""The result of a fit to a frequency response."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workbench.core.records.record import entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear
from workbench.core.values.poles import pole_keys
from workbench.show.result import Result

__all__ = ["FitResult"]


def _nothing() -> NDArray[np.int64]:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False, kw_only=True)
class FitResult(Linear, Result):
    """A linear model fitted to a frequency response.

    Attributes:
        model: name of what was measured.
        order: number of states.
        order_reason: in one line.
        order_criterion: shape (k + 1,), of the orders 0 … k; empty: the order was given.
        delay: known delay that was taken out [s]; A, B, C, D are without it.
        amplitude: at which the response was measured [unit of the input]; None: not known, or it is linear.
        frequency_hz: shape (k,) [Hz], of the points; of several channels one after the other.
        measured: shape (k,), delay included.
        sigma: shape (k,), standard deviation it was weighted with.
        pole_spread: shape (n,), standard deviation of each pole [1/s], in the order of `poles`; of a sampled model as
            of the continuous one behind it.
        of_output, of_input: shape (k,), number of the output and input of a point, from 0; empty: the only ones.
        notes: what else should be known, one line each.
    """

    _page = "workbench.identification.fit.page:fit_page"
    _picture = "workbench.identification.fit.picture:plot_fit_response"

    model: str
    order: int
    order_reason: str
    order_criterion: Floats
    delay: float
    amplitude: float | None
    frequency_hz: Floats = field(metadata=entry(unit="Hz"))
    measured: Complex = field(metadata=entry(dims=("frequency_hz",)))
    sigma: Floats = field(metadata=entry(dims=("frequency_hz",)))
    pole_spread: Floats = field(metadata=entry(dims=("pole",)))
    of_output: NDArray[np.int64] = field(default_factory=_nothing, metadata=entry(dims=("frequency_hz",)))
    of_input: NDArray[np.int64] = field(default_factory=_nothing, metadata=entry(dims=("frequency_hz",)))
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a fit to a frequency response", "identify"

    @property
    def fitted(self) -> Complex:
        """The model's response at the measured frequencies, delay included, shape (k,)."""
        turn = np.exp(-2j * np.pi * self.frequency_hz * self.delay)
        frequency, at = np.unique(self.frequency_hz, return_inverse=True)
        row, column = self._channel
        return np.asarray(self.response(frequency)[at, row, column] * turn)

    @property
    def _channel(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        none = np.zeros(len(self.frequency_hz), dtype=np.int64)
        return (self.of_output, self.of_input) if len(self.of_output) else (none, none)

    @property
    def channels(self) -> dict[tuple[int, int], NDArray[np.bool_]]:
        """Numbers of output and input → which points are theirs, shape (k,)."""
        row, column = self._channel
        pairs = dict.fromkeys(zip(row.tolist(), column.tolist(), strict=True))
        return {(i, j): (row == i) & (column == j) for i, j in pairs}

    def channel_name(self, output: int, input: int) -> str:
        """Return "output/input".

        Args:
            output: its number.
            input: its number.
        """
        return f"{self.output_names[output]}/{self.input_names[input]}"

    @property
    def misfit(self) -> Floats:
        """Distance of the model from the measured response, relative to it, shape (k,)."""
        return np.asarray(np.abs(self.fitted - self.measured) / np.maximum(np.abs(self.measured), 1e-300))

    @property
    def chi_squared(self) -> float:
        """Mean of the squares of the misfits over σ², for each number that is left to chance; 1 is what errors make."""
        p, m = self.D.shape
        free = 2 * len(self.frequency_hz) - (p + m) * self.order - p * m
        each = np.abs(self.fitted - self.measured) ** 2 / self.sigma**2
        return float(2.0 * np.sum(each) / max(free, 1))

    @property
    def words(self) -> tuple[str, ...]:
        """How well it follows, in sentences."""
        at = int(np.argmax(self.misfit))
        words = (
            f"misfit {100.0 * float(np.sqrt(np.mean(self.misfit**2))):.3g} % (root mean square), largest "
            f"{100.0 * self.misfit[at]:.3g} % at {self.frequency_hz[at]:.4g} Hz"
        )
        if len(self.channels) > 1:
            words += f" of {self.channel_name(*(int(numbers[at]) for numbers in self._channel))}"
        return (words,)

    def derived(self) -> dict[str, Any]:
        """Return poles and misfits.

        Keys:
            poles, natural_frequency_hz, damping, damped_frequency_hz: poles, and the standard
                deviation of each [1/s].
            fitted, misfit, chi_squared: measured and fitted response (pairs), relative distance,
                standard deviations that weighted it; mean of their squares.
            words: how well it follows; remarks.
        """
        keys = pole_keys(self.poles, self.dt)
        return {
            "poles": self.poles, **keys, "fitted": self.fitted, "misfit": self.misfit, "chi_squared": self.chi_squared,
            "words": self.words,
        }  # fmt: skip

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency."""
        several = len(self.channels) > 1
        head = (
            "frequency [Hz]",
            "measured gain",
            "measured phase [deg]",
            "fitted gain",
            "fitted phase [deg]",
            "misfit",
        )
        yield ("channel", *head) if several else head
        for (i, j), at in self.channels.items():
            measured, fitted = self.measured[at], self.fitted[at]
            phases = [np.degrees(np.unwrap(np.angle(v))) for v in (measured, fitted)]
            table = np.column_stack([
                self.frequency_hz[at], np.abs(measured), phases[0], np.abs(fitted), phases[1], self.misfit[at],
            ])  # fmt: skip
            name = (self.channel_name(i, j),) if several else ()
            yield from ((*name, *row) for row in table.tolist())
