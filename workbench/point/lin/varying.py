"""Find the grid of a parameter-varying linear model, and how far the model is from the truth beside it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from scipy.linalg import eig

from workbench.core.records.option import recast
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.jobs.job import Job
from workbench.model import Model
from workbench.point.lin.interpolation import KINDS, Axis, coefficients, products
from workbench.point.lin.request import Lin, LinVarying
from workbench.point.lin.result import LinResult
from workbench.point.lin.sweep import check_varied, points_at
from workbench.point.lin.task import NOT_AT_REST, point_in_full
from workbench.point.lin.varying_error import SLOW, FoundModel, VaryingErrors
from workbench.point.lin.varying_result import MATRICES, HeldOut, SchedulingParameter, VaryingModel

__all__ = ["run"]

Place = tuple[Fraction, ...]  # of each parameter, 0 … 1: its value is low + (high − low) (1 − cos πθ)/2

_START = (Fraction(0), Fraction(1, 2), Fraction(1))
_WHOLE = 17  # nodes of a parameter up to which all intervals are halved; then those of a spline only where it is worst
_MOST_NODES = 65  # of one parameter
_MOST = 1500  # points of the grid
_PROBES = 6  # points for each parameter at which a model is tried before it is tried everywhere
_CHECKED = 400  # points between all neighbours of the grid that are looked at; where there are more, so many of them
_SEARCHES = 6  # times that the worst point is moved on by ever smaller steps
_TRIED, _MEETINGS, _NARROW = 128, 6, 1e-7  # where poles meet: points for each parameter, places, how well located
_STILL = 1e-6  # of a variable's size or motion: what moves less over the box, does not move
_MARGIN = 1.25  # the largest error found, and a quarter more for peaks between the points: what is stated
# Errors as small as this are what the entries are known to, by method of linearisation.
_ROUNDING = {"difference": 1e-6, "kalman-bertram": 1e-6}


def run(model: Model, request: LinVarying, job: Job) -> VaryingModel:
    """Find a parameter-varying model; see `LinVarying`."""
    family = _Linearised(model, request, job)
    grid = [list(_START) for _ in family.parameters]
    tried = _probes(len(grid))
    while True:
        found = _best(family, grid, tried)
        asked = request.error / _MARGIN
        if _worst(family.errors(found, tried)) <= asked:
            checked = _check(family, found, grid)
            if _worst(checked.values()) <= asked:
                return _stated(family, found, checked)
            tried += sorted(checked, key=lambda place: -checked[place].largest)[:_PROBES]
        finer = _refined(family, found, grid)
        if math.prod(map(len, finer)) > _MOST or finer == grid or max(map(len, finer)) > _MOST_NODES:
            return _stated(family, found, _check(family, found, grid))
        grid = finer


# -- linear models -----------------------------------------------------------------------------


class _Linearised:
    """Linear models at places of the box, each made once."""

    def __init__(self, model: Model, request: LinVarying, job: Job) -> None:
        self.model, self.request, self._job = model, request, job
        check_varied(model, request.over, what="over")
        units = {v.name: v.unit for v in (*model.parameters, *model.inputs, *model.states)}
        self.parameters = tuple(
            SchedulingParameter(name, low, high, units.get(name)) for name, (low, high) in request.over.items()
        )
        self._common = recast(Lin, request, at=None, progress=None, workers=None, **point_in_full(model, request)[0])
        if request.inputs is None:
            free = tuple(v.name for v in model.inputs if v.is_number and v.name not in request.over)
            self._common = replace(self._common, inputs=free)
        self.check_inputs(self._common.inputs or ())
        self._known: dict[Place, FoundModel] = {}
        self.first: LinResult | None = None
        self.notes = dict[str, None]()
        self.trimmed = False
        corners = list(itertools.product(_START, repeat=len(self.parameters)))
        self.at(corners)
        if any(note.startswith(NOT_AT_REST) for note in self.notes):
            self.trimmed, self.first = True, None
            self._known, self.notes = {}, {}
            self.at(corners)

    def check_inputs(self, inputs: Sequence[str]) -> None:
        twice = [name for name in inputs if name in self.request.over]
        if twice:
            raise InputError(f"inputs: {twice[0]} is a scheduling parameter; it cannot be an input of the linear model")

    @property
    def count(self) -> int:
        """Number of linear models that were made."""
        return len(self._known)

    @property
    def linear(self) -> LinResult:
        """The first one, for what all have in common."""
        if self.first is None:
            raise SimulationError("over: there is no linear model")
        return self.first

    @property
    def motion(self) -> Floats:
        """Largest motions of states, inputs and outputs in unit steps at the first place, shape (k,)."""
        return next(iter(self._known.values())).motion

    def value(self, place: Place) -> list[float]:
        """Return the values of the parameters at a place."""
        parts = (0.5 + 0.5 * math.sin(math.pi * (float(t) - 0.5)) for t in place)
        return [p.low * (1.0 - part) + p.high * part for p, part in zip(self.parameters, parts, strict=True)]

    def named(self, place: Place) -> dict[str, float]:
        """Return parameter → value at a place."""
        return dict(zip(self.request.over, self.value(place), strict=True))

    def at(self, places: Iterable[Place]) -> list[FoundModel]:
        """Return the linear models at places."""
        wanted = list(places)
        fresh = [p for p in dict.fromkeys(wanted) if p not in self._known]
        where = {tuple(self.named(p).items()): p for p in fresh}
        made = points_at(
            self.model, [dict(items) for items in where], self._common, self.request.place.apart, self._job,
            explained=False, trimmed=self.trimmed,
        )  # fmt: skip
        for point in made if fresh else ():
            result = point.result
            if result is None:
                raise SimulationError(
                    f"over: there is no linear model at {point}: {point.reason}; choose ranges in which there is one"
                )
            self._take(where[tuple(point.values.items())], result, str(point))
            self._job.done(str(point), self.count, self.count + 1)
        return [self._known[p] for p in wanted]

    def _take(self, place: Place, result: LinResult, words: str) -> None:
        first = self.first = self.first or result
        if result.dt > 0.0:
            raise InputError(f"over: {result.model} is sampled; parameter-varying models are continuous: give values")
        if result.state_names != first.state_names or result.refused:
            raise InputError(f"over: the linear model at {words} has other states or inputs than that of another point")
        point = result.operating_point
        rest = [point.x.get(n, 0.0) for n in result.state_names]
        rest += [point.u.get(n, 0.0) for n in result.input_names]
        rest += [{**point.x, **point.y}.get(n, 0.0) for n in result.output_names]
        self._known[place] = FoundModel(result, np.array(rest))
        self.notes |= dict.fromkeys(result.notes)

    def table(self, grid: Sequence[Sequence[Fraction]]) -> Floats:
        """Return all entries and operating points over a grid, shape (n₁ n₂ …, number of entries)."""
        return np.array([
            np.concatenate([*(getattr(r.linear, name).ravel() for name in MATRICES), r.rest])
            for r in self.at(itertools.product(*grid))
        ])  # fmt: skip

    def errors(self, found: VaryingModel, places: Iterable[Place]) -> list[VaryingErrors]:
        """Return the errors of a model at places."""
        rest = np.concatenate([found.x0, found.u0, found.y0], axis=1)
        size = np.maximum(np.abs(rest).max(axis=0), self.motion)
        scale = np.maximum(np.ptp(rest, axis=0), _STILL * size)
        result = []
        listed = list(places)
        for place, reference in zip(listed, self.at(listed), strict=True):
            other = found.at(self.named(place))
            point = other.operating_point
            values = [*point.x.values(), *point.u.values(), *point.y.values()] if point else []
            result.append(reference.errors(other, np.array(values), scale))
        return result


def _worst(errors: Iterable[VaryingErrors]) -> float:
    return max(e.largest for e in errors)


def _probes(count: int) -> list[Place]:
    random = np.random.default_rng(count)
    return [tuple(map(Fraction, row)) for row in random.random((_PROBES * count, count)).tolist()]


# -- a model over a grid -----------------------------------------------------------------------


def _best(family: _Linearised, grid: Sequence[Sequence[Fraction]], tried: Sequence[Place]) -> VaryingModel:
    """Return the model over a grid by the interpolation that is better at the points that are tried."""
    whole = all(len({b - a for a, b in itertools.pairwise(thetas)}) == 1 for thetas in grid)
    models = [_model(family, grid, kind) for kind in KINDS if whole or kind == "spline"]
    return min(models, key=lambda found: _worst(family.errors(found, tried)))


def _model(family: _Linearised, grid: Sequence[Sequence[Fraction]], kind: str) -> VaryingModel:
    references = family.at(itertools.product(*grid))
    linear = family.linear
    rest = np.array([r.rest for r in references])
    n, m = len(linear.state_names), len(linear.input_names)
    a, b, c, d = (np.array([getattr(r.linear, name) for r in references]) for name in MATRICES)
    return VaryingModel(
        model=linear.model, interface=linear.interface, method=linear.method, scheduling=family.parameters,
        grid={
            p.name: tuple(family.value((t,) * len(grid))[i] for t in thetas)
            for i, (p, thetas) in enumerate(zip(family.parameters, grid, strict=True))
        },
        interpolation=kind, asked_error=family.request.error, errors=VaryingErrors(*(math.inf,) * 4), held_out=(),
        linear_models=family.count, trimmed=family.trimmed, state_names=linear.state_names,
        input_names=linear.input_names, output_names=linear.output_names, units=linear.units,
        A=a, B=b, C=c, D=d, x0=rest[:, :n], u0=rest[:, n : n + m], y0=rest[:, n + m :],
    )  # fmt: skip


def _refined(family: _Linearised, found: VaryingModel, grid: Sequence[Sequence[Fraction]]) -> list[list[Fraction]]:
    """Return a finer grid: the parameter is refined whose nodes are foretold worst by every second one of them."""
    table = family.table(grid)
    size = np.abs(table).max(axis=0)
    size[-len(family.motion) :] = np.maximum(size[-len(family.motion) :], family.motion)
    table = table[:, size > 0.0] / size[size > 0.0]
    shape = [len(thetas) for thetas in grid]
    apart = [_left_out(table.reshape(*shape, -1), found, i) for i in range(len(grid))]
    i = int(np.argmax([a.max(initial=0.0) for a in apart]))
    thetas, finer = grid[i], [list(t) for t in grid]
    every = len(thetas) < _WHOLE or found.interpolation == "chebyshev"
    worst = apart[i] >= 0.25 * apart[i].max(initial=0.0)
    near = {k for j in np.flatnonzero(worst).tolist() for k in (2 * j, 2 * j + 1)}
    added = [(a + b) / 2 for k, (a, b) in enumerate(itertools.pairwise(thetas)) if every or k in near]
    finer[i] = sorted([*thetas, *added])
    return finer


def _left_out(table: Floats, found: VaryingModel, i: int) -> Floats:
    """Return how far each second node of a parameter is from what the others foretell, shape (number of those,)."""
    nodes, values = found.axes[i].nodes, np.moveaxis(table, i, 0)
    kept = np.unique([*range(0, len(nodes), 2), len(nodes) - 1])
    axis, out = Axis(nodes[kept], "spline"), np.arange(1, len(nodes) - 1, 2)
    flat = values.reshape(len(nodes), -1)
    foretold = products([axis], nodes[out, None]) @ coefficients([axis], flat[kept])
    return np.asarray(np.abs(foretold - flat[out]).max(axis=1))


# -- what it is worth --------------------------------------------------------------------------


def _check(family: _Linearised, found: VaryingModel, grid: Sequence[Sequence[Fraction]]) -> dict[Place, VaryingErrors]:
    """Return the errors between all neighbours of the grid, and on the way from the worst of them to worse ones."""
    doubled = [sorted([*t, *((a + b) / 2 for a, b in itertools.pairwise(t))]) for t in grid]
    inside = set(itertools.product(*grid))
    places = [p for p in itertools.product(*doubled) if p not in inside]
    if len(places) > _CHECKED:
        some = np.random.default_rng(0).choice(len(places), _CHECKED, replace=False)
        places = [places[j] for j in sorted(some.tolist())]
    places = list(dict.fromkeys([*places, *_probes(len(grid)), *_meetings(family, found)]))
    checked = dict(zip(places, family.errors(found, places), strict=True))
    for kind in range(4):
        best, step = max(checked, key=lambda p: checked[p].values[kind]), _first_step(grid)
        for _ in range(_SEARCHES):
            beside = [p for p in _beside(best, step) if p not in checked]
            checked |= dict(zip(beside, family.errors(found, beside), strict=True))
            better = max([best, *beside], key=lambda p: checked[p].values[kind])
            step = step if better != best else [s / 2 for s in step]
            best = better
    return checked


def _first_step(grid: Sequence[Sequence[Fraction]]) -> list[Fraction]:
    return [Fraction(1, 4 * (len(thetas) - 1)) for thetas in grid]


def _meetings(family: _Linearised, found: VaryingModel) -> list[Place]:
    """Return places at which poles are most sensitive to the entries of A, as where two of them meet.

    There their errors have narrow peaks, which points beside them miss. The model itself tells where.
    """
    count = len(found.grid)
    some = [tuple(map(Fraction, row)) for row in np.random.default_rng(7).random((_TRIED * count, count)).tolist()]
    known = {p: _sensitivity(found, family.named(p)) for p in some} if found.state_names else {}
    result = list[Place]()
    for start in sorted(known, key=lambda p: -known[p]):
        if len(result) == _MEETINGS:
            break
        if all(max(abs(float(a - b)) for a, b in zip(start, other, strict=True)) > 0.05 for other in result):
            result.append(_climbed(family, found, start, known[start]))
    return result


def _climbed(family: _Linearised, found: VaryingModel, best: Place, height: float) -> Place:
    """Return a place beside one where poles are most sensitive."""
    step = [Fraction(1, 2 * _TRIED)] * len(best)
    while step[0] > _NARROW:
        higher = [(_sensitivity(found, family.named(p)), p) for p in _beside(best, step)]
        top, place = max(higher)
        if top > height:
            best, height = place, top
        else:
            step = [s / 4 for s in step]
    return best


def _sensitivity(found: VaryingModel, values: dict[str, float]) -> float:
    """Return the largest relative change of a pole over that of the entries of A: |y|ᵀ |A| |x| / (|yᴴx| |λ|).

    Source: N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., chapter 7 (componentwise); J. H.
    Wilkinson, The Algebraic Eigenvalue Problem, chapter 2 (condition of an eigenvalue).
    """
    A = found.at(values).A
    poles, left, right = eig(A, left=True, right=True)
    part = np.sum(np.abs(left) * (np.abs(A) @ np.abs(right)), axis=0)
    size = np.maximum(np.abs(poles), SLOW * np.abs(poles).max())
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = part / (np.abs(np.sum(left.conj() * right, axis=0)) * size)
    return float(np.max(np.nan_to_num(ratio, nan=0.0, posinf=1e300), initial=0.0))


def _beside(place: Place, step: Sequence[Fraction]) -> list[Place]:
    moved = ((i, place[i] + sign * width) for i, width in enumerate(step) for sign in (-1, 1))
    return [(*place[:i], min(max(at, Fraction(0)), Fraction(1)), *place[i + 1 :]) for i, at in moved]


def _stated(family: _Linearised, found: VaryingModel, checked: dict[Place, VaryingErrors]) -> VaryingModel:
    """Return the model with the errors that it promises."""
    least = _ROUNDING.get(found.method, 1e-9)
    largest = np.max([e.values for e in checked.values()], axis=0)
    errors = VaryingErrors(*(_rounded_up(max(_MARGIN * e, least)) for e in largest.tolist()))
    held_out = tuple(HeldOut(family.named(place), e) for place, e in checked.items())
    notes = (*_notes(found, family.motion), *family.notes)
    return replace(found, errors=errors, held_out=held_out, linear_models=family.count, notes=notes)


def _rounded_up(value: float) -> float:
    """Return a number with two digits that is no less."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / step * (1.0 - 1e-12)) * step:.2g}")


def _notes(found: VaryingModel, motion: Floats) -> Iterable[str]:
    """Yield what is not in a set of linear models: the motion of the parameters."""
    names = ", ".join(found.grid)
    span, size = np.ptp(found.x0, axis=0), np.maximum(np.abs(found.x0).max(axis=0), motion[: len(found.state_names)])
    moving = [n for n, s, whole in zip(found.state_names, span, size, strict=True) if s > _STILL * whole]
    if moving:
        more = f" and {len(moving) - 4} more" if len(moving) > 4 else ""
        yield (
            f"hidden coupling: the equilibrium of {', '.join(moving[:4])}{more} moves with {names}; in deviations from "
            "it, -dx0/dp dp/dt is a further input, which the model in x itself, and its FMU, have"
        )
    states = [n for n in found.grid if n in found.state_names]
    if states:
        yield (
            f"hidden coupling: {', '.join(states)} is a state of the model: scheduled by itself, it has no deviation "
            "from its operating point, and its column of A no effect"
        )
