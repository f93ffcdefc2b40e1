"""The calibration's cost: one method for each kind of row, residual and slopes together.

Equations are weighed by `data`, which grows from stage to stage; inequalities (hinges) count only where
they are violated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from scripts.aircraft.data import Aircraft
from scripts.aircraft.harmonics import limit_cycle
from scripts.aircraft.problem import INNER, OUTER, Free, changed
from scripts.aircraft.response import Response, Spectrum, spectrum_of
from workbench.core.values.arrays import Complex, Floats

# Z = 1/H at the crossings: f [Hz], Z [N·m·s/rad]
CROSSINGS = ((2.64, -1290.3), (2.74, -71.43), (3.31, -400.0))
OPEN_GROWTH, OPEN_HERTZ = 0.09, 3.435  # the free aileron's pole
EDGES = (-1.3126, -0.3185)  # of the stable position gains
CYCLE = (np.log(0.2142), np.log(0.766), 2.64)  # peak rate [rad/s] and position [deg], frequency [Hz]
# Unstable poles for an equivalent damper [N·m·s/rad]
COUNTS = {2: (0, 10, 25, 45, 60, 480, 620, 800, 1000, 1150), 4: (85, 120, 180, 250, 330), 0: (1500, 2200, 4000, 1e4)}
NEAR_SWITCH = {60, 85, 330, 480, 1150, 1500}
# Signs of Im Z between the crossings: from, to [Hz], points, sign
SIGNS = (
    (0.1, 2.58, 14, -1), (2.66, 2.72, 3, 1), (2.77, 3.28, 7, -1), (3.33, 3.7, 26, 1), (3.72, 6.0, 22, 1)
)  # fmt: skip
# and of the imaginary part from the inner aileron to the outer one's rate: five crossings of the negative axis
RATE_SIGNS = (
    (0.01, 2.68, 16, -1), (2.78, 3.1, 6, 1), (3.12, 3.31, 5, -1), (3.36, 3.41, 4, 1), (3.45, 5.1, 14, -1),
    (5.5, 11.0, 30, 1), (11.0, 14.2, 110, 1), (15.4, 24.0, 40, -1), (24.0, 33.0, 120, -1), (33.0, 70.0, 25, -1),
)  # fmt: skip
# Decay asked for along the position gain [1/s]; elsewhere DECAY. It makes −1.12 the quickest.
DECAYS = {-0.7: 0.10, -0.85: 0.17, -1.0: 0.24, -1.12: 0.28, -1.2: 0.15}
EARLY_DECAYS = {-0.85: 0.12, -1.0: 0.12, -1.12: 0.12}
GAINS = (-0.36, -0.42, -0.5, -0.6, -0.7, -0.85, -1.0, -1.12, -1.2, -1.27)
PAIRS = [(g, k) for g in (-0.345, -0.4, -0.46, -0.55, -0.7, -1.0, -1.12, -1.28) for k in (30, 80, 200, 450, 900, 2000)]
FRONT, TIP = 0, 6  # rows of the points


@dataclass(frozen=True, slots=True)
class Stage:
    """Weights of one stage.

    Attributes:
        data: of the equations.
        stability: of the hinges on eigenvalues.
        signs: of the hinges on signs.
        prior: of the distance from the prior.
        tip: |wing tip / aileron| at 2.64 Hz [m/rad].
        front: |front fuselage / aileron| at 2.64 Hz [m/rad].
        late: with harmonic balance, five crossings of the rate loop, a stable limit cycle and structural damping.
    """

    data: float
    stability: float
    signs: float
    prior: float
    tip: float = 9.4
    front: float = 1.57
    late: bool = True


@dataclass(slots=True)
class _Rows:
    values: list[float] = field(default_factory=list)
    slopes: list[Floats] = field(default_factory=list)

    def add(self, value: float, slope: Floats, weight: float) -> None:
        self.values.append(value * weight)
        self.slopes.append(slope * weight)


@dataclass(slots=True)
class Cost:
    """p ↦ residuals and Jacobian."""

    aircraft: Aircraft
    free: Free
    stage: Stage

    def __call__(self, p: Floats) -> tuple[Floats, Floats]:
        rows, stage = _Rows(), self.stage
        aircraft = changed(self.aircraft, self.free, p)
        response = Response(aircraft, self.free)
        self._impedance(response, rows)
        self._ratios(response, rows)
        self._signs(response, rows)
        self._open_loop(response, rows)
        self._counts(response, rows)
        self._gains(response, rows)
        self._nominal(response, rows)
        if stage.late:
            self._cycle(response, rows)
            self._rate_signs(response, rows)
            self._sidebands(response, rows)
            self._structural(response, rows)
        r = np.r_[rows.values, stage.prior * p]
        return r, np.vstack([np.array(rows.slopes).reshape(-1, len(p)), stage.prior * np.eye(len(p))])

    # Equations

    def _impedance(self, response: Response, rows: _Rows) -> None:
        for hertz, target in CROSSINGS:
            value, slope = _impedance(response, hertz)
            rows.add(value.real - target, slope.real, self.stage.data / 40.0)
            rows.add(value.imag, slope.imag, self.stage.data / 40.0)

    def _ratios(self, response: Response, rows: _Rows) -> None:
        s, receptance = response.receptance(CROSSINGS[0][0])
        unit = np.eye(33)[OUTER].astype(complex)
        own = response.slope(s, receptance, unit, OUTER) / receptance[OUTER, OUTER]
        for point, target in ((TIP, self.stage.tip), (FRONT, self.stage.front)):
            shape = response.aircraft.shape[point].astype(complex)
            moved = complex(shape @ receptance[:, OUTER])
            slope = (response.slope(s, receptance, shape, OUTER) / moved - own).real
            ratio = abs(moved / receptance[OUTER, OUTER])
            rows.add(float(np.log(ratio / target)), slope, self.stage.data / 0.03)

    def _open_loop(self, response: Response, rows: _Rows) -> None:
        spectrum = spectrum_of(response.loop(0.0))
        first = _oscillating(spectrum)[0]
        slope, value = response.eigenvalue_slopes(spectrum, first), spectrum.values[first]
        rows.add(float(value.real) - OPEN_GROWTH, slope.real, self.stage.data / 0.02)
        turn = 2.0 * np.pi
        rows.add(float(value.imag) / turn - OPEN_HERTZ, slope.imag / turn, self.stage.data / 0.01)

    def _cycle(self, response: Response, rows: _Rows) -> None:
        cycle = limit_cycle(response)
        if cycle is None:
            rows.add(5.0, np.zeros(len(self.free.scale)), self.stage.data)
            return
        for value, target, slope, width in zip(cycle.figures, CYCLE, cycle.slopes, (0.01, 0.01, 0.005), strict=True):
            rows.add(float(value) - target, slope, min(self.stage.data, 3.0) / width)

    # Inequalities

    def _signs(self, response: Response, rows: _Rows) -> None:
        for low, high, number, sign in SIGNS:
            for hertz in np.linspace(low, high, number):
                margin = 20.0 if hertz < 2.6 or hertz > 3.36 else 4.0 if hertz in {2.66, 2.72} else 8.0
                value, slope = _impedance(response, float(hertz))
                above, right = margin - sign * value.imag, margin - value.real
                if min(above, right) > 0.0:
                    chosen = -sign * slope.imag if above < right else -slope.real
                    rows.add(min(above, right), chosen, self.stage.signs / 60.0)

    def _rate_signs(self, response: Response, rows: _Rows) -> None:
        unit = np.eye(33)[OUTER].astype(complex)
        for low, high, number, sign in RATE_SIGNS:
            for hertz in np.geomspace(low, high, number):
                s, receptance = response.receptance(float(hertz))
                value = s * receptance[OUTER, INNER]
                place = value / abs(value)
                above, right = 0.04 - sign * place.imag, 0.04 - place.real
                if min(above, right) > 0.0:
                    turn = (response.slope(s, receptance, unit, INNER) / receptance[OUTER, INNER]).imag
                    chosen = -sign * place.real * turn if above < right else place.imag * turn
                    rows.add(min(above, right), chosen, self.stage.signs / 0.15)

    def _counts(self, response: Response, rows: _Rows) -> None:
        for count, dampers in COUNTS.items():
            for damper in dampers:
                margin = 0.004 if damper in NEAR_SWITCH else 0.03
                self._unstable(response, rows, spectrum_of(response.loop(damper)), count, margin)

    def _gains(self, response: Response, rows: _Rows) -> None:
        decays = DECAYS if self.stage.late else EARLY_DECAYS
        for gain in GAINS:
            self._unstable(response, rows, spectrum_of(response.loop(0.0, gain)), 0, decays.get(gain, 0.008))
        for gain, damper in PAIRS:
            self._unstable(response, rows, spectrum_of(response.loop(damper, gain)), 0, 0.012)
        for gain in EDGES:
            self._edge(response, rows, spectrum_of(response.loop(0.0, gain)))

    def _edge(self, response: Response, rows: _Rows, spectrum: Spectrum) -> None:
        """The first mode is undamped there, no other is near."""
        self._unstable(response, rows, spectrum, 0, 0.0)
        first, *others = _oscillating(spectrum)[:3]
        slope = response.eigenvalue_slopes(spectrum, first).real
        rows.add(float(spectrum.values[first].real), slope, self.stage.data / 0.01)
        self._below(response, rows, spectrum, others, [0.01] * len(others), 0.03)

    def _nominal(self, response: Response, rows: _Rows) -> None:
        self._unstable(response, rows, spectrum_of(response.aircraft.system(failed=False)), 0, 0.15)

    def _sidebands(self, response: Response, rows: _Rows) -> None:
        """Other modes see the cycling damper as one of 1.5 times its equivalent, and couple by twice its frequency."""
        for damper in (1290.0, 1700.0, 1934.0, 2200.0, 2600.0):
            spectrum = spectrum_of(response.loop(damper))
            others = [i for i in _oscillating(spectrum, 3.0) if not 2.5 < spectrum.values[i].imag / 2 / np.pi < 2.8]
            self._below(response, rows, spectrum, others, [0.22] * len(others), 0.05)

    def _structural(self, response: Response, rows: _Rows) -> None:
        """Modes above 4.5 Hz keep 0.9 % of damping."""
        nominal = response.aircraft.system(failed=False)
        for A in (response.open, nominal, response.loop(1290.0), response.loop(0.0, -1.0)):
            spectrum = spectrum_of(A)
            fast = _oscillating(spectrum, 28.0)
            self._below(response, rows, spectrum, fast, [0.009 * float(abs(spectrum.values[i])) for i in fast], 0.1)

    def _unstable(self, response: Response, rows: _Rows, spectrum: Spectrum, count: int, margin: float) -> None:
        """`count` poles (in pairs) are unstable by `margin` [1/s], the others stable by it."""
        pairs = _oscillating(spectrum)
        for i in pairs[: count // 2]:
            short = margin - float(spectrum.values[i].real)
            if short > 0.0:
                rows.add(short, -response.eigenvalue_slopes(spectrum, i).real, self.stage.stability / 0.03)
        stable = pairs[count // 2 :]
        self._below(response, rows, spectrum, stable, [margin] * len(stable), 0.03)
        real = [int(i) for i in np.flatnonzero(abs(spectrum.values.imag) <= 0.5) if spectrum.values[i].imag >= 0.0]
        self._below(response, rows, spectrum, real, [0.1] * len(real), 0.02)

    def _below(  # noqa: PLR0917 - private, always called with all of them
        self,
        response: Response,
        rows: _Rows,
        spectrum: Spectrum,
        which: Sequence[int],
        margins: Sequence[float],
        width: float,
    ) -> None:
        for i, margin in zip(which, margins, strict=True):
            over = float(spectrum.values[i].real) + margin
            if over > 0.0:
                rows.add(over, response.eigenvalue_slopes(spectrum, i).real, self.stage.stability / width)


def _impedance(response: Response, hertz: float) -> tuple[complex, Complex]:
    s, receptance = response.receptance(hertz)
    value = 1.0 / (s * receptance[OUTER, OUTER])
    unit = np.eye(33)[OUTER].astype(complex)
    return complex(value), -(value**2) * s * response.slope(s, receptance, unit, OUTER)


def _oscillating(spectrum: Spectrum, above: float = 0.5) -> list[int]:
    """Return the numbers of the eigenvalues with Im > `above` [rad/s], least damped first."""
    found = np.flatnonzero(spectrum.values.imag > above)
    return [int(i) for i in found[np.argsort(-spectrum.values[found].real)]]
