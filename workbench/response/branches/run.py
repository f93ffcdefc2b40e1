"""Branches of periodic responses: where they begin, and what is found on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from workbench.core.records.forms import several
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.jobs.job import Job
from workbench.model import Model
from workbench.model.described_model import LoadRecipe
from workbench.model.loading import DEFAULT_TOLERANCE
from workbench.model.names import check_variables
from workbench.model.operating_point import centre_of, standing, start_at
from workbench.model.sample_rates import sampled
from workbench.response.branches.family import ForcedPeriodMaps, near
from workbench.response.branches.request import Branches
from workbench.response.branches.result import BranchesResult, Fold, Onset, ResponseBranch
from workbench.response.periodic.continuation import ContinuedBranch, Manner, both_ways, follow
from workbench.response.periodic.fourier import fundamental
from workbench.response.periodic.place import Place, arrive, depart
from workbench.response.periodic.special import Special

__all__ = ["explore", "run"]

# Where along the bounds a response is looked for from the model's start, and from random states.
_STARTS = (0.0, 1.0, 0.5)

# Periods run before Newton's method, so that random states come near to where the model goes.
_WARM = 6

# Two responses that are this near to each other, in units of their motion, are one.
_SAME = 1e-3
_MAY_BE_SAME = 0.2

# How far from a period doubling the doubled branch is stepped on, in units of the motion.
_ASIDE = 0.02

# Why a branch may end without anything having gone wrong.
_EXPECTED = {"the parameter's bound", "it closes", "it leaves another branch"}

# The amplitude at which it begins to jump: found to this, relative.
_ONSET = 0.002
_LOWER = 0.7

_RANDOM = 1

# Multipliers and folds are derivatives of what is integrated: a relative tolerance above this loses branches.
_COARSE = 2e-8


@dataclass
class _BranchSearch:
    """The branches of one family.

    Attributes:
        family: period maps of order 1.
        told: called for each place.
        most: places on a branch.
        marks: parameters at which there is to be a place.
        tracks: what was found, with the family of each.
        unfinished: returns what is being followed, as far as it goes; None: nothing is.
        families: all of them, to be closed.
    """

    family: ForcedPeriodMaps
    told: Callable[[Place], None]
    most: int
    marks: Sequence[float] = ()
    tracks: list[tuple[ForcedPeriodMaps, ContinuedBranch]] = field(default_factory=list)
    unfinished: tuple[ForcedPeriodMaps, Callable[[], ContinuedBranch]] | None = None
    families: list[ForcedPeriodMaps] = field(default_factory=list)
    _left: int = 0

    def from_starts(self) -> None:
        """Follow the branches on which the model's start leads."""
        why = ""
        for p in _STARTS:
            try:
                self._follow(self.family, self._reach(self.family, None, p))
            except SimulationError as error:
                why = str(error)
            if self.tracks and p == _STARTS[1]:
                return
        if not self.tracks:
            raise SimulationError(f"no periodic response was found: {why}")

    def from_seeds(self, count: int, order: int) -> None:
        """Follow further branches that random states lead to.

        Args:
            count: number of starts.
            order: after so many periods at most the responses repeat.
        """
        random = np.random.default_rng(_RANDOM)
        places = [place for _, track in self.tracks for place in track.places]
        reach = np.max([p.lap.unit + np.abs(p.x) for p in places], axis=0)
        for k in range(count):
            p = (k + 0.5) / count
            x = random.standard_normal(len(reach)) * reach
            for m in range(1, order + 1):
                family = self.family if m == 1 else self._again(self.family, m)
                try:
                    place = self._reach(family, x, p)
                except SimulationError:
                    continue
                if m > 1 and self._repeats_earlier(place, m):
                    continue
                self._follow(family, place)

    def _repeats_earlier(self, place: Place, order: int) -> bool:
        """Whether a motion repeats after fewer periods than its family's."""
        x = place.x
        for _ in range(1, order):
            x = self.family.run(x, place.p).x1
            if near(x, place.x, place.lap.unit) < _SAME:
                return True
        return False

    def branching(self, order: int) -> None:
        """Follow what leaves the branches at period doublings, up to an order, and where branches cross."""
        while self._left < len(self.tracks):
            family, track = self.tracks[self._left]
            self._left += 1
            for special in track.special:
                if special.kind == "branch point":
                    self._leave(family, special.place, 1.0, _ASIDE)
                    self._leave(family, special.place, 1.0, -_ASIDE)
                elif special.kind == "period doubling" and 2 * family.order <= order:
                    self._leave(self._again(family, 2 * family.order), special.place, -1.0, _ASIDE)

    def _again(self, family: ForcedPeriodMaps, order: int) -> ForcedPeriodMaps:
        """Return the family of another order."""
        self.families.append(family.again(order=order))
        return self.families[-1]

    def _leave(self, family: ForcedPeriodMaps, crossing: Place, multiplier: float, aside: float) -> None:
        """Follow what leaves a branch, away from it."""
        try:
            place = depart(family, crossing, multiplier, aside)
        except SimulationError:
            return
        if near(place.x, crossing.x, crossing.lap.unit) > 0.1 * abs(aside) and not self._is_known(family, place):
            track = follow(family, place, self._manner(family), way=0.0)
            self.unfinished = None
            track.ends = ("it leaves another branch", track.ends[1])
            if not self._is_known(family, track.places[len(track.places) // 2]):
                self.tracks.append((family, track))

    def _reach(self, family: ForcedPeriodMaps, x: Floats | None, p: float) -> Place:
        """Return a periodic response that a few periods and Newton's method lead to."""
        lap = family.run(family.start(p) if x is None else x, p)
        for _ in range(_WARM - 1):
            lap = family.run(lap.x1, p)
        family.refuse_timed(lap, p)
        try:
            return arrive(family, lap.x1, p)
        except SimulationError:
            if not family.may_differ:
                raise
        family.by_differences = True
        try:
            return arrive(family, lap.x1, p)
        except SimulationError:
            family.by_differences = False
            raise

    def _is_known(self, family: ForcedPeriodMaps, place: Place) -> bool:
        """Whether a branch that was found passes here; a subharmonic counts from each of its periods."""
        x, seen = place.x, [place.x]
        for _ in range(1, family.order):
            x = self.family.run(x, place.p).x1
            seen.append(x)
        return any(self._passes(family, place, x) for x in seen)

    def _passes(self, family: ForcedPeriodMaps, place: Place, x: Floats) -> bool:
        unit = place.lap.unit
        for other, track in self.tracks:
            if other.order != family.order:
                continue
            for a, b in pairwise(track.places):
                if (a.p - place.p) * (b.p - place.p) > 0.0 or a.p == b.p:
                    continue
                guess = a.x + (place.p - a.p) / (b.p - a.p) * (b.x - a.x)
                if near(guess, x, unit) > _MAY_BE_SAME:
                    continue
                with suppress(SimulationError):
                    if near(arrive(family, guess, place.p).x, x, unit) < _SAME:
                        return True
        return False

    def _follow(self, family: ForcedPeriodMaps, place: Place) -> None:
        if self._is_known(family, place):
            return
        track = both_ways(family, place, self._manner(family))
        self.unfinished = None
        # Where it meets the branch of half its period it crosses itself: that is told there, as a period doubling.
        own = [s for s in track.special if family.order == 1 or not self._repeats_earlier(s.place, family.order)]
        self.tracks.append((family, replace(track, special=own)))

    def _manner(self, family: ForcedPeriodMaps) -> Manner:
        """Return how a branch is followed, so that what is there is kept if it is stopped."""

        def begun(so_far: Callable[[], ContinuedBranch]) -> None:
            self.unfinished = family, so_far

        return Manner(told=self.told, begun=begun, most=self.most, marks=self.marks)

    def so_far(self) -> list[tuple[ForcedPeriodMaps, ContinuedBranch]]:
        """Return the branches that were followed, the last one as far as it goes."""
        if self.unfinished is None:
            return self.tracks
        family, track = self.unfinished
        return [*self.tracks, (family, track())]


def explore(
    family: ForcedPeriodMaps,
    request: Branches,
    report: Callable[[Place], None] = lambda _: None,
    begun: Callable[[_BranchSearch], None] = lambda _: None,
) -> list[tuple[ForcedPeriodMaps, ContinuedBranch]]:
    """Return all branches of a family that can be found.

    Args:
        family: period maps of order 1.
        request: how far to look.
        report: called for each place.
        begun: called with what holds the branches while they are found.

    Raises:
        SimulationError: no periodic response was found.
    """
    marks = [] if request.vary else [family.parameter(f) for f in several(request.frequencies or ())]
    search = _BranchSearch(family, report, request.places, marks)
    begun(search)
    try:
        search.from_starts()
        search.branching(request.order)
        search.from_seeds(request.seeds, request.order)
        search.branching(request.order)
    finally:
        for one in (family, *search.families):
            one.close()
    return search.tracks


def run(model: Model, request: Branches, job: Job) -> BranchesResult:
    """Follow the periodic responses."""
    recipe = model.recipe
    if not isinstance(recipe, LoadRecipe) or recipe.tolerance is not None or model.rtol <= _COARSE:
        return _follow(model, request, job)
    with recipe.tighter(Branches.usual_tolerance / DEFAULT_TOLERANCE).open() as exact:  # nobody asked for another
        return _follow(exact, request, job)


def _follow(model: Model, request: Branches, job: Job) -> BranchesResult:
    model, remarks = start_at(model, request.at)
    about = _check(model, request)
    vary, (low, high) = next(iter(request.vary.items()), ("frequency", request.band or (0.0, 0.0)))
    centre = centre_of(model, request.input)
    with model.open_session() as session:
        point = standing(model, session)
    solution: list[tuple[float | None, ForcedPeriodMaps, ContinuedBranch]] = []
    notes = [*remarks, *about]
    if model.rtol > _COARSE:
        notes.append(f"a tolerance of {model.rtol:g} is coarse for following branches; load with tolerance=1e-9")
    onset: Onset | None = None
    amplitudes = [1.0] if vary == "amplitude" else sorted(several(request.amplitudes or ()))
    progress, at_work = _BranchProgress(job, len(amplitudes)), list[_BranchSearch]()
    units = {v.name: v.unit for v in (*model.parameters, *model.inputs, *model.outputs, *model.states)}

    def result() -> BranchesResult:
        now = [t for search in at_work for t in search.so_far()]
        every = [*solution, *((None if vary == "amplitude" else f.amplitude, f, t) for f, t in now)]
        branches = tuple(_branch(family, track, amplitude) for amplitude, family, track in every)
        return BranchesResult(
            model=model.name,
            interface=model.interface,
            solver=model.solver,
            input=request.input,
            output=request.output,
            input_unit=units.get(request.input),
            output_unit=units.get(request.output),
            vary=vary,
            branches=branches,
            folds=tuple(_fold(f, s, i) for i, (_, f, track) in enumerate(every) for s in track.special),
            onset=onset,
            asked_hz=() if request.vary else several(request.frequencies or ()),
            vary_unit={"frequency": "Hz", "amplitude": units.get(request.input)}.get(vary, units.get(vary)),
            periods=sum({id(f): f.count for _, f, _ in every}.values()),
            warnings=(*notes, *_cut_short(branches), *_not_located(every)),
            operating_point=point,
        )

    job.partial = lambda: result() if solution or any(s.so_far() for s in at_work) else None
    notes[:0], job.notes = job.notes, notes
    frequency = several(request.frequencies or (1.0,))[0]
    with job.ended_by(lambda: None):  # it ends before the next period
        for amplitude in amplitudes:
            family = ForcedPeriodMaps(
                model, request.input, request.output, vary, low, high, frequency, amplitude, centre,
                stopped=lambda: job.stopped,
            )  # fmt: skip
            tracks = explore(family, request, progress.at, at_work.append)
            at_work.clear()
            solution += [(None if vary == "amplitude" else amplitude, f, t) for f, t in tracks]
            if request.onset and amplitude == amplitudes[-1]:
                onset = _onset(tracks, progress.at)
                if onset is None:
                    notes.append(
                        f"onset: at amplitude {amplitude:g} no fold was found, so from which one on the response jumps "
                        "is not known; give larger `amplitudes`"
                    )
            progress.next()
    return result()


@dataclass
class _BranchProgress:
    """How far the branches have come: the part of the bounds that was seen, for each amplitude."""

    job: Job
    amplitudes: int
    finished: int = 0
    seen: float = 0.0

    def at(self, place: Place) -> None:
        """Tell of a place."""
        self.seen = max(self.seen, min(0.99, abs(place.p)))
        self.job.done(
            f"{self.finished + 1} of {self.amplitudes}", round(100 * (self.finished + self.seen)), self._total
        )

    def next(self) -> None:
        """Begin with the next amplitude."""
        self.finished, self.seen = self.finished + 1, 0.0
        self.job.done("branches", 100 * self.finished, self._total)

    @property
    def _total(self) -> int:
        return 100 * self.amplitudes


def _check(model: Model, request: Branches) -> tuple[str, ...]:
    """Refuse what cannot be followed; return what is to be said of the model's events."""
    check_variables(model, [request.input], "input", what="input")
    check_variables(model, [request.output], "output", "state", what="output")
    check_variables(
        model, [name for name in request.vary if name != "amplitude"], "parameter", what="vary", number=True
    )
    if model.interface != "me":
        raise InputError(
            f"interface: {model.name} runs as co-simulation, whose states cannot be set while it runs; "
            f"{model.way_out('use nfr, which follows stable responses alone')}"
        )
    rates = sampled(model)
    if rates.periods:
        listed = ", ".join(f"{p:g}" for p in rates.periods)
        raise InputError(f"branches: {model.name} samples every {listed} s; use nfr with the method settle")
    if not model.states:
        raise InputError(f"branches: {model.name} has no continuous states that could be followed; use nfr")
    return rates.notes


# -- the result -------------------------------------------------------------------------------------------------------


def _cut_short(branches: tuple[ResponseBranch, ...]) -> Iterator[str]:
    """Return a line for each branch that could not be followed further."""
    for number, branch in enumerate(branches, 1):
        for place, why in zip((0, -1), branch.ends, strict=False):
            if why and why not in _EXPECTED:
                yield f"branch {number} ends at {branch.varied[place]:.6g}: {why}"


def _not_located(every: Sequence[tuple[float | None, ForcedPeriodMaps, ContinuedBranch]]) -> Iterator[str]:
    """Return a line for each fold that was passed and not found."""
    for number, (_, family, track) in enumerate(every, 1):
        for missed in track.missed:
            low, high = sorted(map(family.value, missed.p))
            where = f"between the places at {low:.6g} and {high:.6g}"
            yield f"branch {number}: a {missed.kind} {where} could not be located"


def _response(place: Place) -> complex:
    period = place.lap.period
    return fundamental(period.harmonics) / period.drive if period.drive else 0.0j


def _branch(family: ForcedPeriodMaps, track: ContinuedBranch, amplitude: float | None) -> ResponseBranch:
    response = np.array([_response(p) for p in track.places])
    return ResponseBranch(
        amplitude=amplitude,
        frequency_hz=np.array([family.forcing(p.p)[0] for p in track.places]),
        varied=np.array([family.value(p.p) for p in track.places]),
        gain=np.abs(response),
        phase_deg=np.degrees(np.unwrap(np.angle(response))),
        offset=np.array([p.lap.period.harmonics[0] for p in track.places]),
        stable=np.array([p.stable for p in track.places], dtype=bool),
        multipliers=tuple(p.at.kept for p in track.places),
        order=family.order,
        closed=track.closed,
        ends=track.ends,
    )


def _fold(family: ForcedPeriodMaps, special: Special, number: int) -> Fold:
    frequency, amplitude = family.forcing(special.place.p)
    response = _response(special.place)
    return Fold(
        frequency_hz=frequency,
        amplitude=amplitude,
        varied=family.value(special.place.p),
        gain=abs(response),
        phase_deg=float(np.degrees(np.angle(response))),
        kind=special.kind,
        branch=number,
    )


# -- where it begins to jump ------------------------------------------------------------------------------------------


def _onset(tracks: list[tuple[ForcedPeriodMaps, ContinuedBranch]], report: Callable[[Place], None]) -> Onset | None:
    """Return the amplitude at which two folds meet, by following them to ever smaller amplitudes.

    Near the cusp the distance of the folds goes with (a − a₀)^(3/2).
    """
    pair = next((p for p in (_two_folds(f, t) for f, t in tracks if f.order == 1) if p is not None), None)
    if pair is None:
        return None
    family, curve = tracks[0][0], [(tracks[0][0].amplitude, *pair)]
    high, low = family.amplitude, 0.0
    ratio = _LOWER
    while high - low > _ONSET * high and len(curve) < 60:
        amplitude = ratio * high if low == 0.0 else 0.5 * (low + high)
        a, b = curve[-1][1:]
        width = max(b / a, 1.0 + 1e-4)
        # As the amplitude falls the folds move together, and down the backbone.
        window = (a / width**2.0 * (1.0 - 0.3 * (1.0 - amplitude / high)), b * width**0.5)
        folds = _folds_in(family.again(amplitude=amplitude, low=window[0], high=window[1]), report)
        if folds is None:
            low = amplitude
        else:
            high = amplitude
            curve.append((amplitude, *folds))
    newest = sorted(curve)[:2]
    if len(newest) == 2:
        (a1, l1, h1), (a2, l2, h2) = newest
        s1, s2 = (h1 - l1) ** (2.0 / 3.0), (h2 - l2) ** (2.0 / 3.0)
        onset = a1 - s1 * (a2 - a1) / (s2 - s1) if s2 > s1 else a1
        onset = min(max(onset, low), a1)
        middle = 0.5 * (l1 + h1) - (a1 - onset) * (0.5 * (l2 + h2) - 0.5 * (l1 + h1)) / (a2 - a1)
    else:
        onset, middle = newest[0][0], 0.5 * (newest[0][1] + newest[0][2])
    ordered = np.array(sorted(curve))
    return Onset(amplitude=onset, frequency_hz=middle, curve_amplitude=ordered[:, 0], curve_hz=ordered[:, 1:])


def _two_folds(family: ForcedPeriodMaps, track: ContinuedBranch) -> tuple[float, float] | None:
    folds = sorted(family.value(s.place.p) for s in track.special if s.kind == "fold")
    return (folds[0], folds[-1]) if len(folds) >= 2 else None


def _folds_in(family: ForcedPeriodMaps, report: Callable[[Place], None]) -> tuple[float, float] | None:
    search = _BranchSearch(family, report, 600)
    try:
        search.from_starts()
    except SimulationError:
        return None
    finally:
        family.close()
    result = [pair for pair in (_two_folds(f, t) for f, t in search.tracks) if pair is not None]
    return result[0] if result else None
