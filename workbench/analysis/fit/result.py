"""The result of a fit to a frequency response."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.linear import Complex, Linear
from workbench.core.poles import pole_keys
from workbench.core.record import Record, entry
from workbench.session.base import Floats

__all__ = ["FitResult"]


@dataclass(frozen=True, eq=False, kw_only=True)
class FitResult(Linear, Record):
    """A linear model fitted to a frequency response.

    Attributes:
        model: name of what was measured.
        order: number of states.
        order_reason: in one line.
        order_criterion: shape (k + 1,), of the orders 0 … k; empty: the order was given.
        delay: known delay that was taken out [s]; A, B, C, D are without it.
        amplitude: at which the response was measured [unit of the input]; None: not known, or it is linear.
        frequency_hz: shape (k,) [Hz].
        measured: shape (k,), delay included.
        sigma: shape (k,), standard deviation it was weighted with.
        pole_spread: shape (n,), standard deviation of each pole [1/s], in the order of `poles`; of a sampled model as
            of the continuous one behind it.
        notes: what else should be known, one line each.
    """

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
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "a fit to a frequency response", "fit"

    @property
    def fitted(self) -> Complex:
        """The model's response at the measured frequencies, delay included, shape (k,)."""
        turn = np.exp(-2j * np.pi * self.frequency_hz * self.delay)
        return np.asarray(self.response(self.frequency_hz)[:, 0, 0] * turn)

    @property
    def misfit(self) -> Floats:
        """Distance of the model from the measured response, relative to it, shape (k,)."""
        return np.asarray(np.abs(self.fitted - self.measured) / np.maximum(np.abs(self.measured), 1e-300))

    @property
    def chi_squared(self) -> float:
        """Mean of the squares of the misfits over σ², for each number that is left to chance; 1 is what errors make."""
        free = 2 * len(self.frequency_hz) - 2 * self.order - 1
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
        return (words,)

    def derived(self) -> dict[str, Any]:
        """Return poles and misfits."""
        keys = pole_keys(self.poles, self.dt)
        return {
            "poles": self.poles, **keys, "fitted": self.fitted, "misfit": self.misfit, "chi_squared": self.chi_squared,
            "words": self.words,
        }  # fmt: skip

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each frequency."""
        yield ("frequency [Hz]", "measured gain", "measured phase [deg]", "fitted gain", "fitted phase [deg]", "misfit")
        phases = [np.degrees(np.unwrap(np.angle(v))) for v in (self.measured, self.fitted)]
        table = np.column_stack([
            self.frequency_hz, np.abs(self.measured), phases[0], np.abs(self.fitted), phases[1], self.misfit,
        ])  # fmt: skip
        yield from table.tolist()
