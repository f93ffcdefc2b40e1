"""The public function: the describing function of a block, over amplitude and frequency."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from workbench.core.records.record import complex_of, entry
from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError, suggest
from workbench.jobs.options import Workers
from workbench.loops.describing.base import HARMONICS, DescribedBlock
from workbench.loops.describing.formulas import cubic, dead_band, preload, quadratic, quantiser, relay, saturation
from workbench.loops.describing.measured import MeasuredBlock
from workbench.loops.describing.memory import BacklashDescribingFunction, RelayWithHysteresis
from workbench.loops.describing.rate_limiter import RateLimiterDescribingFunction
from workbench.loops.describing.static import StaticBlock
from workbench.model import Model
from workbench.requests.decorator import with_origin
from workbench.response.nfr.request import nfr
from workbench.response.nfr.result import NfrResult
from workbench.show.result import Result

__all__ = ["STANDARD", "DescribingFunction", "describing_function", "standard_block"]

# Name of a standard block → how it is made.
STANDARD: Mapping[str, Callable[..., DescribedBlock]] = {
    "saturation": saturation,
    "dead_band": dead_band,
    "quantiser": quantiser,
    "relay": relay,
    "relay_with_hysteresis": RelayWithHysteresis,
    "backlash": BacklashDescribingFunction,
    "preload": preload,
    "quadratic": quadratic,
    "cubic": cubic,
    "rate_limiter": RateLimiterDescribingFunction,
}


@dataclass(frozen=True, eq=False)
class DescribingFunction(Result):
    """N(A, f) of one block.

    Attributes:
        block: name of the block.
        method: "closed form", "quadrature", "measured".
        amplitude: shape (n,), of the sine at the input.
        frequency_hz: shape (m,) [Hz]; one value that means nothing where the block does not depend on it.
        gain: N, shape (n, m), complex.
        harmonics: size of harmonics 0 … 7 of the output over that of its fundamental, shape (n, m, 8); NaN: unknown.
        frequency_dependent: whether the frequency matters.
    """

    _page = "workbench.loops.describing.page:describing_page"
    _picture = "workbench.loops.describing.picture:plot_describing"

    block: str
    method: str
    amplitude: Floats = field(metadata=entry(dims=("amplitude",)))
    frequency_hz: Floats = field(metadata=entry(dims=("frequency_hz",), unit="Hz"))
    gain: Complex = field(metadata=entry(dims=("amplitude", "frequency_hz"), kept=False))
    harmonics: Floats = field(metadata=entry(dims=("amplitude", "frequency_hz", "harmonic")))
    frequency_dependent: bool

    @property
    def minus_inverse(self) -> Complex:
        """−1/N, shape (n, m); infinite where N is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.gain == 0.0, complex(-np.inf), -1.0 / self.gain).astype(np.complex128)

    def derived(self) -> dict[str, Any]:
        """Return the gain by its parts."""
        return {
            "gain": np.abs(self.gain),
            "phase_deg": np.degrees(np.angle(self.gain)),
            "real": self.gain.real,
            "imag": self.gain.imag,
        }

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the complex gain."""
        return {**data, "gain": complex_of(data)}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each amplitude and frequency."""
        yield ("amplitude", "frequency_hz", "real", "imag", "minus_inverse_real", "minus_inverse_imag")
        for i, a in enumerate(self.amplitude):
            for j, f in enumerate(self.frequency_hz):
                n, inverse = self.gain[i, j], self.minus_inverse[i, j]
                yield (a, f, n.real, n.imag, inverse.real, inverse.imag)


def standard_block(kind: str, parameters: Mapping[str, float] | None = None) -> DescribedBlock:
    """Return a standard block with a closed-form describing function.

    Args:
        kind: a name in `STANDARD`.
        parameters: parameters of that block, by name.

    Raises:
        InputError: unknown kind or parameter, value out of range.

    Examples:
        Within its limits a saturation has the gain 1.

        >>> block = wb.standard_block("saturation")
        >>> print(wb.describing_function(block, [0.5]).gain[0, 0].real)
        1.0
    """
    if kind not in STANDARD:
        raise InputError(f"block '{kind}' is unknown; {suggest(kind, STANDARD)}")
    given, taken = dict(parameters or {}), inspect.signature(STANDARD[kind]).parameters
    for name in given:
        if name not in taken:
            raise InputError(f"block {kind}: no parameter '{name}'; {suggest(name, taken)}")
    if missing := [n for n, p in taken.items() if p.default is p.empty and n not in given]:
        raise InputError(f"block {kind}: parameter {missing[0]} is missing")
    return STANDARD[kind](**given)


@with_origin()
def describing_function(
    block: DescribedBlock | Callable[[Floats], Floats] | Model,
    amplitudes: Sequence[float] | Floats,
    frequencies: Sequence[float] | Floats | None = None,
    *,
    input: str | None = None,
    output: str | None = None,
    errcrit: float = 0.01,
    workers: Workers | None = None,
) -> DescribingFunction:
    """Return N(A), −1/N(A) and the harmonics of a nonlinear block; of a whole model `nfr` also tells errors.

    Args:
        block: a standard block (`standard_block`), a static function of an array of inputs, or a model, which is
            measured (it may have dynamics of its own).
        amplitudes: amplitudes of the sine, positive.
        frequencies: [Hz]; needed for a model, and for blocks that depend on it.
        input: input of a model; None: its only one.
        output: output of a model; None: its only one.
        errcrit: error criterion of the measurement, see `workbench.nfr`.
        workers: where a model is measured.

    Raises:
        InputError: amplitudes or frequencies that are not positive, or missing; a point that could not be measured.

    Source: Slotine & Li, Applied Nonlinear Control, chapter 5; Gelb & Vander Velde, Multiple-Input Describing
    Functions, chapter 2 and appendix B.

    Examples:
        An ideal relay has N(A) = 4/(πA).

        >>> function = wb.describing_function(wb.standard_block("relay"), [1.0, 2.0])
        >>> print(function.gain[:, 0].real.round(4))
        [1.2732 0.6366]
    """
    a = _rising("amplitudes", amplitudes)
    if isinstance(block, Model):
        if frequencies is None:
            raise InputError(f"{block.name}: a model is measured; give frequencies")
        model, f = block, _rising("frequencies", frequencies)
        block = _measured(lambda u, y: nfr(model, u, y, f, a, errcrit=errcrit, workers=workers), model, (input, output))
    elif not isinstance(block, DescribedBlock):
        block = StaticBlock(block, name=getattr(block, "__name__", "block"))
    if block.frequency_dependent and frequencies is None:
        raise InputError(f"block {block.name}: it depends on the frequency; give frequencies")
    f = (
        _rising("frequencies", frequencies)
        if block.frequency_dependent and frequencies is not None
        else np.array([1.0])
    )
    gain = np.array([[block.gain(x, y) for y in f.tolist()] for x in a.tolist()], dtype=np.complex128)
    return DescribingFunction(
        block.name, _method(block), a, f, gain, _harmonics(block, a, f), block.frequency_dependent
    )


def _method(block: DescribedBlock) -> str:
    if isinstance(block, MeasuredBlock):
        return "measured"
    return "quadrature" if type(block) is StaticBlock else "closed form"


def _rising(what: str, values: Sequence[float] | Floats) -> Floats:
    result = np.unique(np.asarray(values, dtype=np.float64))
    if not len(result) or not (np.isfinite(result).all() and result[0] > 0.0):
        raise InputError(f"{what}: give one or more positive numbers")
    return result


def _harmonics(block: DescribedBlock, a: Floats, f: Floats) -> Floats:
    shape = (len(a), len(f), HARMONICS + 1)
    if isinstance(block, MeasuredBlock):
        return np.array([[block.harmonic_sizes(x, y) for y in f.tolist()] for x in a.tolist()]).reshape(shape)
    result = np.array([[np.abs(block.harmonics(x, y)) for y in f.tolist()] for x in a.tolist()]).reshape(shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(result / result[:, :, 1:2], dtype=np.float64)


def _measured(
    response: Callable[[str, str], NfrResult], model: Model, ports: tuple[str | None, str | None]
) -> DescribedBlock:
    u = ports[0] or _only(model, "input", [v.name for v in model.inputs])
    y = ports[1] or _only(model, "output", [v.name for v in model.outputs])
    return MeasuredBlock(response(u, y), name=model.name)


def _only(model: Model, what: str, names: Sequence[str]) -> str:
    if len(names) != 1:
        raise InputError(f"{model.name}: it has {len(names)} {what}s; name one of: {', '.join(names) or 'none'}")
    return names[0]
