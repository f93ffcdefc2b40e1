"""The result of a best linear approximation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.names_in_text import unit_of_ratio
from workbench.core.records.record import entry
from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.operating_point import OperatingPoint
from workbench.core.values.response import Response
from workbench.show.result import Result

__all__ = ["BlaResult"]


WORTH = 0.1  # of the output: a linear model that leaves less is worth having
_GRID = ("rms", "frequency_hz")


@dataclass(frozen=True, eq=False, kw_only=True)
class BlaResult(Result):
    """Best linear approximations at one or several powers.

    Attributes:
        model: its name.
        input, output: names.
        input_unit, output_unit: None where there is none.
        rms: shape (a,), root mean squares of the input [unit of the input].
        frequency_hz: shape (k,), excited lines [Hz].
        response: shape (a, k), of the sampled model with a held input.
        error: shape (a, k), radius of the 95 % circle around it.
        integration: shape (a, k), part of it that the integration makes, which no average over realisations removes; 0
            where it is not known.
        noise: shape (a, k), standard deviation of the response of one realisation by noise.
        distortion: shape (a, k), by nonlinear distortion.
        output_rms, linear_rms: shape (a,), of the output, and of the part that the approximation gives.
        noise_rms, distortion_rms: shape (a,), of what changes from period to period, and of what the approximation
            leaves at excited lines.
        removed_rms, unsettled_rms: shape (a,), of the transient that was estimated and taken off, and of what may be
            left of it.
        odd_rms, even_rms: shape (a,), at odd and even lines that are not excited.
        offset: shape (a,), of the output's mean from that at rest.
        dt: sampling interval [s].
        samples: of a period.
        periods, realisations, transient: how many; periods before those recorded.
        lines: "random-odd", "odd" or "all".
        notes: what else should be known, one line each.
        operating_point: where it was measured.
    """

    _page = "workbench.data.bla.page:bla_page"
    _picture = "workbench.data.bla.picture:plot_bla"

    model: str
    input: str = field(metadata=entry(kept=False))
    output: str = field(metadata=entry(kept=False))
    input_unit: str | None = field(metadata=entry(kept=False))
    output_unit: str | None = field(metadata=entry(kept=False))
    rms: Floats
    frequency_hz: Floats = field(metadata=entry(unit="Hz"))
    response: Complex = field(metadata=entry(dims=_GRID))
    error: Floats = field(metadata=entry(dims=_GRID))
    integration: Floats = field(metadata=entry(dims=_GRID))
    noise: Floats = field(metadata=entry(dims=_GRID))
    distortion: Floats = field(metadata=entry(dims=_GRID))
    output_rms: Floats = field(metadata=entry(dims=("rms",)))
    linear_rms: Floats = field(metadata=entry(dims=("rms",)))
    noise_rms: Floats = field(metadata=entry(dims=("rms",)))
    distortion_rms: Floats = field(metadata=entry(dims=("rms",)))
    removed_rms: Floats = field(metadata=entry(dims=("rms",)))
    unsettled_rms: Floats = field(metadata=entry(dims=("rms",)))
    odd_rms: Floats = field(metadata=entry(dims=("rms",)))
    even_rms: Floats = field(metadata=entry(dims=("rms",)))
    offset: Floats = field(metadata=entry(dims=("rms",)))
    dt: float
    samples: int
    periods: int
    realisations: int
    transient: int
    lines: str
    notes: tuple[str, ...] = ()
    operating_point: OperatingPoint | None = None

    _WHAT, _COMMAND = "a best linear approximation", "bla"

    @property
    def left(self) -> Floats:
        """Part of the output that the approximation leaves by distortion, shape (a,)."""
        every = np.sqrt(self.distortion_rms**2 + self.odd_rms**2 + self.even_rms**2)
        return np.asarray(every / np.maximum(self.output_rms, 1e-300))

    @property
    def worth(self) -> tuple[bool | None, ...]:
        """Whether a linear model leaves less than a tenth of the output, at each power; None: a transient hides it.

        What was taken off is the transient of a linear model. Of another one it is wrong by some part of itself, which
        looks like distortion.
        """
        size = np.maximum(self.output_rms, 1e-300)
        left, unsettled, removed = self.left, self.unsettled_rms / size, self.removed_rms / size
        good = left + unsettled < WORTH
        bad = left - unsettled - np.minimum(left, removed) >= WORTH
        return tuple(None if not (g or b) else bool(g) for g, b in zip(good, bad, strict=True))

    @property
    def _behind(self) -> str:
        """The unit of the input as it stands behind a number."""
        return f" {self.input_unit}" if self.input_unit not in {None, "", "1"} else ""

    @property
    def words(self) -> tuple[str, ...]:
        """What was found, one line for each power, and up to which a linear model is worth having."""
        lines, unit = [], self._behind
        for a, rms in enumerate(self.rms):
            size = max(float(self.output_rms[a]), 1e-300)
            excited, even, odd, noise = (
                f"{100.0 * level[a] / size:.3g} %"
                for level in (self.distortion_rms, self.even_rms, self.odd_rms, self.noise_rms)
            )
            lines.append(
                f"{self.input} {rms:.4g}{unit} rms: "
                f"a linear model leaves {100.0 * self.left[a]:.3g} % of {self.output} "
                f"by distortion ({excited} at excited lines, even {even} and odd {odd} at others), {noise} by noise"
            )
        return (*lines, self.verdict)

    @property
    def verdict(self) -> str:
        """Up to which power a linear model is worth having."""
        worth, unit = self.worth, self._behind
        good, bad, hidden = (
            ", ".join(f"{rms:.4g}" for rms, fine in zip(self.rms, worth, strict=True) if fine is which)
            for which in (True, False, None)
        )
        if hidden:
            others = [f"; {what} at {where}{unit}" for what, where in (("it is", good), ("it is not", bad)) if where]
            return (
                f"whether a linear model is worth having at {hidden}{unit} rms cannot be said: the periods have not "
                f"settled{''.join(others)}"
            )
        if not bad:
            return f"a linear model leaves less than {100.0 * WORTH:g} % of the output at all powers measured"
        if not good:
            return f"no linear model leaves less than {100.0 * WORTH:g} % of the output at any power measured"
        return (
            f"a linear model is worth having at {good}{unit} rms (leaves less than {100.0 * WORTH:g} % of "
            f"the output), not at {bad}{unit}"
        )

    def curve(self, power: int = 0) -> Response:
        """Return the response at one power with names and units.

        Args:
            power: number of the root mean square.
        """
        size = np.maximum(np.abs(self.response[power]), 1e-300)
        return Response(
            self.frequency_hz, self.response[power], self.error[power] / size, amplitude=float(self.rms[power]),
            input=self.input, output=self.output, input_unit=self.input_unit, output_unit=self.output_unit,
        )  # fmt: skip

    def derived(self) -> dict[str, Any]:
        """Return gains, phases and the verdict.

        Keys:
            input, output: `name` and `unit`.
            gain, gain_db, phase_deg: `[rms][frequency]`: best linear approximation of the sampled
                model.
            left, worth, words: `[rms]`: part of the output that distortion leaves, whether that is
                less than a tenth (`null`: a transient hides it); in words.
        """
        gain = np.abs(self.response)
        return {
            "input": {"name": self.input, "unit": self.input_unit},
            "output": {"name": self.output, "unit": self.output_unit},
            "gain": gain,
            "gain_db": 20.0 * np.log10(np.maximum(gain, 1e-300)),
            "phase_deg": np.degrees(np.unwrap(np.angle(self.response), axis=1)),
            "left": self.left,
            "worth": self.worth,
            "words": self.words,
        }

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return names and units of input and output."""
        sides = {side: data[side] for side in ("input", "output")}
        names = {side: held["name"] for side, held in sides.items()}
        return {**data, **names, **{f"{side}_unit": held["unit"] for side, held in sides.items()}}

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {"rms": self.input_unit, "gain": unit_of_ratio(self.output_unit, self.input_unit)}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each power and frequency."""
        yield ("rms", "frequency [Hz]", "gain", "phase [deg]", "error", "integration", "noise", "distortion")
        phase = np.degrees(np.unwrap(np.angle(self.response), axis=1))
        for a, rms in enumerate(self.rms.tolist()):
            table = np.column_stack([
                self.frequency_hz, np.abs(self.response[a]), phase[a], self.error[a], self.integration[a],
                self.noise[a], self.distortion[a],
            ])  # fmt: skip
            yield from ((rms, *row) for row in table.tolist())
