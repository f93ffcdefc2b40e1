"""Where poles and frequency response of a refined model may be, by the covariance of its parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from workbench.core.records.record import entry
from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.validate.regions import ON_AXIS, Parameters, PoleRegion, compatible_regions
from workbench.show.result import Result

__all__ = ["ModelSpread", "around_both", "enclosing", "model_spread"]


_POINTS = 60
_DECADES = 3.0
_AT_ONCE = 64  # frequencies: how they move by each of the parameters takes a hundred times the room of what is returned


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelSpread(Result):
    """95 % regions of the poles and of the frequency response, each for itself.

    Attributes:
        regions: of each pole, in the order of the model's poles (without those of delays).
        confidence: of each region.
        frequency_hz: shape (k,) [Hz].
        response: shape (k, p, m), of the model [unit of output/unit of input].
        shape: (k, p, m, 2, 2): at each frequency the region is all G with dᵀ shape⁻¹ d ≤ 1, d = (real, imaginary part
            of G − response).
        input_names: m names.
        output_names: p names.
        dt: sampling interval [s].
        name: of the model.
        rival_order: of a model that explains significantly more, whose regions of the response are held, too; None:
            there is none. The regions of the poles are those of the order that was chosen.
    """

    _page = "workbench.identification.validate.page:spread_page"
    _picture = "workbench.identification.validate.picture:plot_spread"

    regions: tuple[PoleRegion, ...]
    confidence: float
    frequency_hz: Floats = field(metadata=entry(unit="Hz"))
    response: Complex = field(metadata=entry(dims=("frequency_hz", "output_names", "input_names")))
    shape: Floats = field(metadata=entry(dims=("frequency_hz", "output_names", "input_names", 2, 2)))
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    dt: float
    name: str
    rival_order: int | None = None

    @property
    def determined(self) -> int:
        """How many poles the data determine."""
        return sum(r.determined for r in self.regions)

    @property
    def gain_error(self) -> Floats:
        """Longer half axis of each region over the gain, shape (k, p, m)."""
        longest = np.sqrt(np.linalg.eigvalsh(self.shape)[..., -1])
        return np.asarray(longest / np.maximum(np.abs(self.response), 1e-300))

    @property
    def words(self) -> tuple[str, ...]:
        """Regions of poles and gains, one line each."""
        lines = [_words(r, self.confidence) for r in self.regions if r.pole.imag >= -ON_AXIS]
        if self.rival_order is not None:
            lines.append(
                f"order {self.rival_order} explains significantly more: the regions of the response hold that model's, "
                f"too; those of the poles are of order {len(self.regions)}"
            )
        for i, j in np.ndindex(self.response.shape[1:]):
            gain = self.gain_error[:, i, j]
            at = int(np.argmin(gain))
            lines.append(
                f"response {self.input_names[j]} → {self.output_names[i]}: known to {100.0 * gain[at]:.2g} % at "
                f"{self.frequency_hz[at]:.3g} Hz, to {100.0 * gain[0]:.2g} % at {self.frequency_hz[0]:.3g} Hz"
            )
        return tuple(lines)

    def holds(self, pole: complex, z: complex) -> bool:
        """Return whether z lies in the region of the estimate nearest to `pole`.

        Args:
            pole: pole of the model.
            z: on the plane of discrete poles.
        """
        return min(self.regions, key=lambda r: abs(r.pole - pole)).contains(z)

    def holds_response(self, response: Complex) -> NDArray[np.bool_]:
        """Return where a frequency response lies in the regions, shape (k, p, m).

        Args:
            response: shape (k, p, m), at `frequency_hz`.
        """
        away = np.stack([(response - self.response).real, (response - self.response).imag], axis=-1)
        solved = np.linalg.solve(self.shape, away[..., None])[..., 0]
        return np.asarray(np.sum(away * solved, axis=-1) <= 1.0)

    def derived(self) -> dict[str, Any]:
        """Return the regions' sizes in words."""
        return {"gain_error": self.gain_error, "words": self.words}


def model_spread(
    model: IdentifiedModel,
    *,
    frequencies: Floats | None = None,
    confidence: float = 0.95,
    rival: IdentifiedModel | None = None,
) -> ModelSpread:
    """Return regions of the poles and of the frequency response of a model that knows its parameters' covariance.

    The response is taken as linear in the parameters. Poles are not: a number is in a pole's region where the
    characteristic polynomial may vanish there by the covariance of its coefficients (`compatible_regions`).

    The regions are those of the model's order. Where a higher one explains significantly more, `identify` has them hold
    the regions of the response of that model, too.

    Not for: models whose prediction errors are not white, as the residual tests tell: their covariance is another.

    Args:
        model: refined (`identify` does it).
        frequencies: rising, below half the sampling rate [Hz]; None: three decades up to there.
        confidence: of each region.
        rival: refined model of another order, with the same channels, which may be the right one; None: there is none.

    Raises:
        InputError: the model knows no covariance; confidence out of range.

    Examples:
        >>> import numpy as np
        >>> u, noise = np.random.default_rng(0).standard_normal((2, 500))
        >>> y = np.zeros(500)
        >>> for k in range(499):
        ...     y[k + 1] = 0.5 * y[k] + u[k] + 0.1 * noise[k]
        >>> found = wb.identify(wb.make_experiment(0.1, u, y), order=1)
        >>> spread = wb.model_spread(found.model)
        >>> print(spread.holds(0.5, 0.5))
        True
    """
    if model.spread is None:
        raise InputError("the model knows no covariance of its parameters: it was not refined")
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence must lie between 0 and 1, not {confidence:g}")
    core, f = model.undelayed(), _frequencies(model.dt) if frequencies is None else frequencies
    parameters = _parameters(core, model.spread)
    at = model.at_frequency(f)
    late = at[:, None] ** -np.array(model.delay or (0,) * len(model.input_names))  # shape (k, m)
    response, covariance = _in_parts(parameters, at, late)
    shape = float(special.chdtri(2, 1.0 - confidence)) * covariance
    if rival is not None and rival.spread is not None:
        other = model_spread(rival, frequencies=f, confidence=confidence)
        shape = around_both(shape, enclosing(other.response - response, other.shape))
    return ModelSpread(
        rival_order=None if rival is None or rival.spread is None else rival.undelayed().order,
        regions=compatible_regions(parameters, core.poles, confidence=confidence),
        confidence=confidence,
        frequency_hz=f,
        response=response,
        shape=shape,
        input_names=model.input_names,
        output_names=model.output_names,
        dt=model.dt,
        name=model.name,
    )


def _in_parts(parameters: Parameters, at: Complex, late: Complex) -> tuple[Complex, Floats]:
    """Return the response, shape (k, p, m), and the covariance of its parts, shape (k, p, m, 2, 2), few at a time."""
    result = []
    for first in range(0, len(at), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        G, dG = parameters.response(at[part])
        result.append((G * late[part, None], _response_shapes(dG * late[part, None, :, None])))
    responses, shapes = zip(*result, strict=True)
    return np.concatenate(responses), np.concatenate(shapes)


def enclosing(away: Complex, shape: Floats) -> Floats:
    """Return ellipses about 0 that hold other ones, shape (k, p, m, 2, 2).

    The sum of dᵀ S⁻¹ d ≤ 1 and the segment from −a to a lies in dᵀ ((1 + t) S + (1 + 1/t) a aᵀ)⁻¹ d ≤ 1, any t > 0;
    with t² = aᵀ S⁻¹ a both have the same end (A. B. Kurzhanski, I. Vályi, Ellipsoidal Calculus, 1997, section 2.2).

    Args:
        away: shape (k, p, m), their centres.
        shape: S of each.
    """
    a = np.stack([away.real, away.imag], axis=-1)
    t = np.sqrt(np.maximum(np.einsum("...i,...i->...", a, np.linalg.solve(shape, a[..., None])[..., 0]), 1e-12))
    return np.asarray(
        (1.0 + t)[..., None, None] * shape + (1.0 + 1.0 / t)[..., None, None] * a[..., None] * a[..., None, :]
    )


def around_both(one: Floats, other: Floats) -> Floats:
    """Return the smallest ellipses about 0 that hold two others about 0, shape (..., 2, 2).

    Where one + other is a circle both have the same axes, of which the longer ones are the result's.

    Args:
        one: S of dᵀ S⁻¹ d ≤ 1, shape (..., 2, 2).
        other: likewise.
    """
    root = np.linalg.cholesky(one + other)
    half = np.linalg.solve(root, one)
    part, turn = np.linalg.eigh(np.linalg.solve(root, np.swapaxes(half, -1, -2)))
    axes = root @ turn * np.sqrt(np.maximum(part, 1.0 - part))[..., None, :]
    return np.asarray(axes @ np.swapaxes(axes, -1, -2))


def _frequencies(dt: float) -> Floats:
    return np.asarray(np.geomspace(0.5 / dt * 10.0**-_DECADES, 0.499 / dt, _POINTS))


def _parameters(model: IdentifiedModel, spread: Floats) -> Parameters:
    parts, first = list[Floats](), 0
    for matrix in (model.A, model.B, model.C, model.D):
        parts.append(spread[first : first + matrix.size].reshape(*matrix.shape, spread.shape[1]))
        first += matrix.size
    return Parameters(model.A, model.B, model.C, model.D, *parts)


def _response_shapes(moves: Complex) -> Floats:
    """Return the covariance of real and imaginary parts, shape (k, p, m, 2, 2)."""
    parts = np.stack([moves.real, moves.imag], axis=-2)
    out = parts @ np.swapaxes(parts, -1, -2)
    traces = np.trace(out, axis1=-2, axis2=-1)
    return np.asarray(out + (1e-9 * traces + 1e-300)[..., None, None] * np.eye(2))


def _words(region: PoleRegion, confidence: float) -> str:
    z = region.pole
    name = f"{z.real:.4g}" if abs(z.imag) < ON_AXIS else f"{z.real:.4g} ± {abs(z.imag):.4g}i"
    if not region.determined:
        return f"pole {name}: not determined by the data"
    long, short = region.half_axes
    size = f"± {long:.2g}" if region.on_axis else f"half axes {long:.2g} and {short:.2g}"
    return f"pole {name}: {100.0 * confidence:g} % region {size}"
