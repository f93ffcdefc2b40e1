"""The public function: open a system's loop at a connection and tell its margins."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from workbench.analysis.frequency_grid import frequency_grid, positive_values
from workbench.analysis.lin.task import Width
from workbench.analysis.loop.cut import CutLoop, cut_loop
from workbench.analysis.loop.linear import LinearLoop, linear_loop
from workbench.analysis.loop.measure import choose_measurement, measure
from workbench.analysis.loop.measured import LoopCurve, LoopPoint
from workbench.analysis.loop.place import Open
from workbench.analysis.loop.request import Request
from workbench.analysis.loop.result import LoopResult
from workbench.core.operating_point import At
from workbench.errors import InputError, SimulationError
from workbench.model import Model
from workbench.model.placing import find_point, named, standing
from workbench.origin import with_origin
from workbench.session.base import Floats
from workbench.workers import Workers

__all__ = ["loop"]

_BESIDE = 3.0  # a band that is not given reaches so far beyond the linear crossovers
_SAMPLED = 0.5  # and to this part of the Nyquist frequency: near it periods do not repeat
_MOST_ROUNDS = 10


@with_origin()
def loop(
    system: Model,
    open: Open | None = None,  # noqa: A002 - the word of the command line
    amplitudes: Sequence[float] | Floats | float | None = None,
    frequencies: Sequence[float] | Floats | None = None,
    *,
    at: At | Open | None = None,
    band: tuple[float, float] | None = None,
    ratio: float = 1.2,
    how: str = "auto",
    point: At | None = None,
    method: str = "auto",
    dx: Width = None,
    du: float | None = None,
    refine: int = 2,
    errcrit: float = 0.1,
    max_periods: int = 20,
    workers: Workers | None = None,
    progress: Callable[[LoopPoint, int, int], None] | None = None,
    stopped: Callable[[], bool] | None = None,
) -> LoopResult:
    """Open a loop at a connection: loop transfer L, sensitivities S and T, gain, phase, delay and disk margins.

    ```python
    with wb.load("drive.toml") as system:
        result = wb.loop(system, "plant.w", at=wb.trim(system))
        print(result.margins.words, result.margins.gain_margin_db, result.margins.phase_margin_deg)
        saturated = wb.loop(system, "plant.w", [1.0, 4.0], band=(0.5, 20.0))
    ```

    Convention: negative feedback. The connection is cut; z is passed on in place of the source, y comes back in the
    source, all other loops stay closed. L = -Y/Z, wherever the minus sign lies, and the closed loop is
    S = 1/(1 + L), T = L/(1 + L). A loop with positive feedback thus has L < 0 at low frequency.

    The linear L is that of `lin` for the opened system: exact, a state space, for sampled loops in z at their basic
    period. Its crossovers are found over all frequencies, not on a grid. Stability of the closed loop is told from all
    its poles; where it is not stable, margins mean nothing and are NaN.

    With amplitudes, L is measured too, by sines (as by `nfr`), at an amplitude of the signal z that is passed on, once
    or both ways: "break" opens the loop at the operating point, z biased at its value there, and measures the
    describing function of the open loop; "inject" leaves the loop closed, adds a sine, and compares the signals on
    both sides, the sine adjusted until z has the amplitude. Between the frequencies points are added at the crossovers.
    Where a nonlinearity is not symmetric at the operating point, the sine moves the mean of z in closed loop, while the
    broken loop holds it: the two differ. The distortion of z and y stands beside each point: margins of a loop whose z
    is far from a sine are not to be trusted. Stability at an amplitude is counted by Nyquist's criterion from the
    linear loop.

    Not for co-simulation parts (their communication steps are a part of the loop). Measured values of a sampled loop
    are those of its continuous signals, of which z-domain margins take the values at the samples only.

    Args:
        system: what `connect` or `load` of a system gave; it stays open.
        open: a source "plant.y": all connections that leave it; an input "controller.u": the one that ends there; one
            connection ("plant.y", "controller.u") or "plant.y -> controller.u"; or a system output.
        amplitudes: of the signal passed on, one or several [unit of the source]; None: the linear loop only.
        frequencies: [Hz].
        at: operating point of the closed system: a point, a result that has one, or the file of either; None: where it
            starts. Without `open` it is `open`, as before there was a word for each.
        band: (lowest, highest) frequency [Hz] in place of `frequencies`; neither: around the linear crossovers.
        ratio: of neighbouring frequencies in a band.
        how: "break", "inject", "both", or "auto": break where the open loop is stable.
        point: another word for `at`.
        method: of `lin`.
        dx: widths of `lin` for the states.
        du: width of `lin` for the signal passed on.
        refine: rounds of more points at the crossovers.
        errcrit: see `nfr`.
        max_periods: see `nfr`.
        workers: see `nfr`.
        progress: called with each measured point, the number done and the number in all that is known of.
        stopped: asked every few points; true ends the measurement, and what was measured is returned.

    Returns:
        The loop: `margins`, `loop`, `sensitivity` and `complementary` (python-control), `curves`, `plot()`.

    Raises:
        InputError: no system, no such connection, a connection that is in no loop, co-simulation parts, a value out of
            its range.
        SimulationError: the system cannot be evaluated at the point.
    """
    wanted = None if amplitudes is None else _amplitudes(amplitudes)
    _check(wanted, frequencies, band, refine, max_periods)
    where, begin = _asked(open, at, point)
    found, remarks = find_point(system, begin)
    cut = cut_loop(system, where, point=found)
    linear, notes = _linear(cut, method, dx, du, needed=wanted is None)
    curves: list[LoopCurve] = []
    why = ""
    if wanted is not None:
        names, why = choose_measurement(how, linear)
        grid = _grid(frequencies, band, ratio, linear)
        request = Request(
            errcrit=errcrit, max_periods=max_periods, value=cut.value, loop=None if linear is None else linear.transfer
        )
        for name in names:
            curves += measure(
                cut,
                name,
                request,
                frequencies=grid,
                amplitudes=wanted,
                refine=refine,
                workers=workers or Workers(),
                linear=linear,
                progress=progress,
                stopped=stopped or _never,
            )
    if wanted is not None and linear is not None and linear.transfer.dt > 0.0:
        notes.append("the loop is sampled: what is measured holds the fundamentals of continuous signals, L(z) samples")
    return LoopResult(
        system=system.name,
        place=cut.place,
        value=cut.value,
        linear=linear,
        curves=tuple(curves),
        why=why,
        notes=(*remarks, *notes),
        operating_point=named(system, cut.point) if cut.point is not None else standing(system),
    )


def _asked(open: Open | None, at: At | Open | None, point: At | None) -> tuple[Open, At | None]:  # noqa: A002
    """Return where to open the loop, and the operating point; once `at` was the former and `point` the latter."""
    if open is None:
        if not isinstance(at, str | tuple):
            raise InputError("open: at which connection? Name its source, as in open='plant.y'")
        open, at = at, None  # noqa: A001
    if at is not None and point is not None:
        raise InputError("at and point are two words for the operating point; give at alone")
    if isinstance(at, tuple):
        raise InputError("at: the operating point is needed here; open names the connection")
    return open, point if at is None else at


def _never() -> bool:
    return False


def _amplitudes(amplitudes: Sequence[float] | Floats | float) -> tuple[float, ...]:
    values = [amplitudes] if isinstance(amplitudes, int | float) else amplitudes
    return tuple(sorted(positive_values("amplitude", values, unit="unit of the signal")))


def _check(
    amplitudes: tuple[float, ...] | None,
    frequencies: Sequence[float] | Floats | None,
    band: tuple[float, float] | None,
    refine: int,
    max_periods: int,
) -> None:
    if amplitudes is None and (frequencies is not None or band is not None):
        raise InputError("frequencies are for measuring at amplitudes; give amplitudes, or leave the frequencies out")
    if not 0 <= refine <= _MOST_ROUNDS:
        raise InputError(f"refine must be 0 … {_MOST_ROUNDS}, not {refine}")
    if max_periods < 2:
        raise InputError(f"max_periods must be at least 2, not {max_periods}")


def _linear(
    cut: CutLoop, method: str, dx: Width, du: float | None, *, needed: bool
) -> tuple[LinearLoop | None, list[str]]:
    try:
        found = linear_loop(cut, method=method, dx=dx, du=du)
    except (InputError, SimulationError) as error:
        if needed:
            raise
        return None, [*cut.notes, f"there is no linear loop: {error}"]
    return found, list(found.notes)


def _grid(
    frequencies: Sequence[float] | Floats | None,
    band: tuple[float, float] | None,
    ratio: float,
    linear: LinearLoop | None,
) -> tuple[float, ...]:
    if frequencies is None and band is None:
        band = _own_band(linear)
    return frequency_grid(frequencies, band, ratio, falling=False)


def _own_band(linear: LinearLoop | None) -> tuple[float, float]:
    inner = () if linear is None else linear.margins.crossovers_hz
    if not inner:
        raise InputError("band: none given, and the linear loop has no crossover to lay one around; give LO:HI [Hz]")
    top = max(inner) * _BESIDE if linear is None else min(max(inner) * _BESIDE, _SAMPLED * linear.transfer.highest_hz)
    return min(min(inner) / _BESIDE, top), top
