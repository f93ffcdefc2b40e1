"""Frequency responses: gain and phase, what lies between their frequencies, crossings; one place for all analyses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.decibels import decibels, difference, follow_phase, known, unwrapped
from workbench.core.values.margins import SUPPOSED, GainCrossover, Margins, PhaseCrossover, disk_of
from workbench.errors import InputError

if TYPE_CHECKING:
    from control import FrequencyResponseData

__all__ = ["Response", "ResponseDifference"]

_SAME = 1e-12  # log frequencies that differ by less are one
_COMMON = 1e-9  # relative: frequencies of two responses that are one, also after a file of 10 digits
_FINE = 24  # looked at between two neighbouring frequencies


@dataclass(frozen=True, eq=False)
class Response:
    """A frequency response from one input to one output.

    Between its frequencies the logarithm of the gain and the phase are interpolated over the logarithm of the
    frequency, monotone between two points (no overshoot of its own).

    Attributes:
        frequency_hz: rising, shape (k,) [Hz].
        value: output over input, shape (k,) [output_unit / input_unit]; NaN where there is none, 0 where the input
            does not move the output.
        error: of the value, relative to the true one, as a complex number's magnitude, with 95 % confidence, shape
            (k,), NaN where it is not known; None: of a linear model, which is taken as exact.
        input, output: names; "": not known.
        input_unit, output_unit: units; None: not known.
        amplitude: of the sine at which it was measured [input_unit]; None: it is linear.

    Example:
    >>> import numpy as np
    >>> import workbench as wb
    >>> integrator = wb.Linear(A=[[0.0]], B=[[1.0]], C=[[1.0]], D=[[0.0]])
    >>> curve = integrator.curve(0, 0, np.array([0.5, 5.0]) / np.pi)
    >>> curve.gain_db.round(3).tolist(), curve.phase_deg.round(3).tolist()
    ([0.0, -20.0], [-90.0, -90.0])
    >>> f"{curve.margins().phase_margin_deg:.1f}"
    '90.0'
    """

    frequency_hz: Floats
    value: Complex
    error: Floats | None = None
    _: KW_ONLY
    input: str = ""
    output: str = ""
    input_unit: str | None = None
    output_unit: str | None = None
    amplitude: float | None = None

    @property
    def gain(self) -> Floats:
        """Magnitude, shape (k,) [output_unit / input_unit]."""
        return np.abs(self.value)

    @property
    def gain_db(self) -> Floats:
        """Gain, shape (k,) [dB]; −inf where it is 0."""
        return decibels(self.value)

    @property
    def phase_deg(self) -> Floats:
        """Phase followed along the frequency, shape (k,) [deg]; it begins in (−260°, 100°], and NaN is where none is.

        An upward jump of more than 100° between two frequencies is taken for a turn down.
        """
        return follow_phase(self.value)

    @cached_property
    def _log(self) -> tuple[Floats, Complex]:
        """Log of the frequency, and of the values with their phase unwrapped, where they have any."""
        has = known(self.value) & (self.frequency_hz > 0.0)
        if np.any(np.diff(self.frequency_hz[has]) <= 0.0):
            raise InputError("the frequencies of a response rise, each stands once")
        phase = np.radians(unwrapped(self.value[has]))
        return np.log(self.frequency_hz[has]), np.asarray(np.log(np.abs(self.value[has])) + 1j * phase)

    def between(self, frequency_hz: ArrayLike) -> Complex:
        """Return the interpolated response, shape of the frequencies; NaN outside of the first and the last value.

        Args:
            frequency_hz: of any shape [Hz].
        """
        with np.errstate(divide="ignore"):
            x = np.log(np.asarray(frequency_hz, dtype=np.float64))
        if len(self._log[0]) < 2:
            return np.full(x.shape, np.nan + 0j)
        inside = np.clip(x, *self._log[0][[0, -1]])
        x = np.where(np.abs(x - inside) < _SAME, inside, x)
        return np.asarray(np.exp(self._shape(self._log[1].real)(x) + 1j * self._shape(self._log[1].imag)(x)))

    def _shape(self, y: Floats) -> Callable[[ArrayLike], Floats]:
        from scipy.interpolate import PchipInterpolator  # noqa: PLC0415  slow to import

        made: Callable[[ArrayLike], Floats] = PchipInterpolator(self._log[0], y, extrapolate=False)
        return made

    def finer(self, times: int) -> Response:
        """Return the interpolated response at further frequencies between neighbours, without errors.

        Args:
            times: into so many parts each interval is divided.
        """
        x, log = self._log
        if len(x) < 2:
            return self._with(np.exp(x), np.exp(log))
        fine = np.append((x[:-1, None] + np.diff(x)[:, None] * np.arange(times) / times).ravel(), x[-1])
        return self._with(np.exp(fine), self.between(np.exp(fine)))

    def _with(self, frequency_hz: Floats, value: Complex) -> Response:
        return replace(self, frequency_hz=frequency_hz, value=value, error=None)

    def gain_crossings(self) -> list[float]:
        """Return the frequencies at which the interpolated gain is 1, rising [Hz]."""
        return self._roots(self._log[1].real, 0.0)

    def phase_crossings(self) -> list[tuple[float, bool]]:
        """Return the frequencies at which the interpolated response is real and negative, rising [Hz].

        Each with whether it crosses the axis upwards as the frequency rises.
        """
        phase = self._log[1].imag
        low, high = phase.min(initial=0.0), phase.max(initial=0.0)
        turns = [k for k in range(int(np.floor(low / np.pi)) - 1, int(np.ceil(high / np.pi)) + 1) if k % 2]
        result = []
        for f in (f for k in turns for f in self._roots(phase, np.pi * k)):
            ends = np.clip(np.log(f) + np.array([-1e-6, 1e-6]), *self._log[0][[0, -1]])
            before, after = self._shape(phase)(ends)
            result.append((f, bool(after < before)))  # seen from −180° a rising angle leads below the axis
        return sorted(result)

    def margins(self) -> Margins:
        """Return the margins of this loop transfer L, closed by negative feedback: 1/(1 + L).

        Gain and phase are interpolated between the frequencies; only what lies between the lowest and the highest is
        seen. Whether the closed loop is stable cannot be read off a curve: the verdict is "not judged", and the margins
        suppose that it is.
        """
        grid, L = (finer := self.finer(_FINE)).frequency_hz, finer.value
        s, difference, t = (np.abs(x) for x in (1.0 / (1.0 + L), (1.0 - L) / (1.0 + L), L / (1.0 + L)))
        at = {name: _top(grid, x) for name, x in (("s", s), ("d", difference), ("t", t))}
        return Margins(
            verdict=SUPPOSED,
            words="whether the closed loop is stable is not known from a curve alone; the margins suppose it",
            phase_crossovers=tuple(
                PhaseCrossover(f, 1.0 / abs(complex(self.between(f))), up) for f, up in self.phase_crossings()
            ),
            gain_crossovers=tuple(GainCrossover.of(f, complex(self.between(f))) for f in self.gain_crossings()),
            disk=disk_of(*at["d"]) if len(grid) else None,
            peak_sensitivity=at["s"][0],
            peak_sensitivity_hz=at["s"][1],
            peak_complementary=at["t"][0],
            peak_complementary_hz=at["t"][1],
            everywhere=False,
        )

    def difference(self, other: Response) -> ResponseDifference:
        """Return by how much this response differs from another, at the frequencies that both have.

        Args:
            other: what is taken off.

        Raises:
            InputError: they have no frequency in common.

        Example:
        >>> import numpy as np
        >>> import workbench as wb
        >>> plant = wb.Linear(A=[[-1.0]], B=[[1.0]], C=[[1.0]], D=[[0.0]])
        >>> found = wb.Response(np.array([0.1, 1.0]), 2.0 * plant.curve(0, 0, [0.1, 1.0]).value)
        >>> found.difference(plant.curve(0, 0, [0.01, 0.1, 1.0])).gain_db.round(2).tolist()
        [6.02, 6.02]
        """
        near = np.isclose(self.frequency_hz[:, None], other.frequency_hz, rtol=_COMMON, atol=0.0)
        mine, its = np.nonzero(near)
        if not len(mine):
            raise InputError(
                "the responses have no frequency in common; compute or measure one at the `frequency_hz` of the other"
            )
        gain, phase = difference(self.value[mine], other.value[its])
        error = np.hypot(_error(self)[mine], _error(other)[its])
        return ResponseDifference(self.frequency_hz[mine], gain, phase, error)

    def to_frd(self, *, name: str | None = None) -> FrequencyResponseData:
        """Return the response for python-control; points without a value are left out.

        Args:
            name: name of the system.

        Raises:
            InputError: no point has a value.
        """
        import control  # noqa: PLC0415 - slow to import, and needed here only

        good = np.isfinite(self.value)
        if not np.any(good):
            measured = "" if self.amplitude is None else f" at amplitude {self.amplitude:g}"
            why = "; the result's `failed` says why" if measured else ""
            raise InputError(f"no point of the response{measured} has a value{why}")
        omega_rad_s = 2.0 * np.pi * self.frequency_hz[good]
        named = {"inputs": self.input, "outputs": self.output, "name": name}
        given = {key: value for key, value in named.items() if value}
        frd: FrequencyResponseData = control.frd(self.value[good], omega_rad_s, **given)
        return frd

    def _roots(self, y: Floats, level: float) -> list[float]:
        x, v = self._log[0], y - level
        if len(x) < 2:
            return []
        from scipy.optimize import brentq  # noqa: PLC0415  slow to import

        between = self._shape(v)
        crossed = np.flatnonzero(v[:-1] * v[1:] < 0.0)
        inside = [brentq(lambda x: float(between(x)), x[i], x[i + 1], xtol=1e-12) for i in crossed]
        still = np.pad(v == 0.0, 1, constant_values=True)  # at a stretch of zeros nothing crosses
        touched = (v == 0.0) & ~(still[:-2] & still[2:])
        return sorted(np.exp([*inside, *x[touched]]).tolist())


def _top(grid: Floats, values: Floats) -> tuple[float, float]:
    if not len(grid):
        return np.nan, np.nan
    k = int(np.argmax(values))
    return float(values[k]), float(grid[k])


def _error(response: Response) -> Floats:
    return np.zeros(len(response.value)) if response.error is None else response.error


@dataclass(frozen=True, eq=False)
class ResponseDifference:
    """One frequency response less another.

    Attributes:
        frequency_hz: frequencies that both have, shape (k,) [Hz].
        gain_db: difference of the gains, shape (k,) [dB]; NaN where one of both has none.
        phase_deg: difference of the phases, within ±180, shape (k,) [deg]; NaN where one of both has none.
        error: of the quotient of both responses, relative, shape (k,): both errors, which are independent, as the
            root of the sum of their squares; NaN where one is not known.
    """

    frequency_hz: Floats
    gain_db: Floats
    phase_deg: Floats
    error: Floats

    @property
    def gain_error_db(self) -> Floats:
        """How far the difference of the gains may be off, shape (k,) [dB]; infinite for errors of 1 and more."""
        return -decibels(np.maximum(1.0 - self.error, 0.0))

    @property
    def phase_error_deg(self) -> Floats:
        """How far the difference of the phases may be off, shape (k,) [deg]; 180 for errors of 1 and more."""
        inside = np.degrees(np.arcsin(np.minimum(self.error, 1.0)))
        return np.where(self.error >= 1.0, 180.0, inside)
