"""A model at one instant: derivatives and outputs at given states and inputs, without time passing."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from workbench.core.machine.closable import Closable
from workbench.core.values.arrays import Floats
from workbench.errors import EndedError, InputError, SimulationError
from workbench.fmi.variable import FLOAT_TYPES, Variable
from workbench.kernel.native_slopes import Pattern
from workbench.session.directional import columns_pattern, why_not_exact
from workbench.session.evaluated_point import Stand, named_states
from workbench.session.exact_jacobian import ExactJacobian
from workbench.session.fmu import FmuSession
from workbench.session.me import MeSession

__all__ = ["Evaluation", "FmuPoint", "ModelPoint"]

_SAME = 1e-9  # relative: a model that is back where it was may differ by its own iterations


@dataclass(frozen=True)
class Evaluation:
    """What a model does at one point.

    Attributes:
        dx: derivatives of the states, shape (n,).
        y: outputs, shape (q,).
        latched: discrete states would have been set on the way to this point (a `when` would have
            fired); the values are those before that.
    """

    dx: Floats
    y: Floats
    latched: bool = False


class ModelPoint(Closable):
    """Evaluates dx/dt and y at any (x, u) near a base point; time and discrete states stay as they are there.

    Obligations of a subclass:
      1. Relations (which branch of an `if`, which step of a `floor`) are those of the evaluated point, not
         of the base point.
      2. Discrete states that remember (what a `when` sets) are never changed by an evaluation.
      3. Evaluations do not depend on those before, failed ones included.

    Attributes:
        states: n of them.
        inputs: those that are numbers, m of them.
        outputs: those that are numbers, q of them.
        time: session time [s].
        x0: states of the base point, shape (n,).
        u0: inputs of the base point, shape (m,).
        nominal: nominal values of the states, shape (n,).
        smallest: sizes of the states below which errors of the integration do not shrink with them, shape (n,).
        memory: discrete real states that the model shows and lets one start elsewhere.
        calls: number of "derivatives" (each with the outputs), "directional" and "adjoint" evaluations so far.
    """

    states: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    time: float
    x0: Floats
    u0: Floats
    nominal: Floats
    smallest: Floats
    memory: tuple[Variable, ...]
    calls: Counter[str]

    @abstractmethod
    def move(self, x: Floats, u: Floats) -> None:
        """Make (x, u) the base point; discrete states keep their values unless a `when` there sets them."""

    @abstractmethod
    def at(self, x: Floats, u: Floats) -> Evaluation:
        """Return derivatives and outputs at (x, u).

        Raises:
            SimulationError: the model cannot be evaluated there; other points may still be.
        """

    @abstractmethod
    def ticks(self, most: int, until: float) -> Floats:
        """Return the next times up to `until` [s] at which the model asks for an event, states held.

        Args:
            most: so many at most.
            until: [s].
        """

    @abstractmethod
    def discrete(self) -> dict[str, float]:
        """Return the discrete states at the base point, those that the model shows."""

    @abstractmethod
    def jacobian(self) -> Floats:
        """Return the exact ∂(dx, y)/∂(x, u) at the base point, shape (n + q, n + m).

        Relations stay as they are there; columns of inputs that are not continuous reals are NaN.

        Raises:
            InputError: the model offers no directional derivatives.
        """

    @property
    def pattern(self) -> Pattern | None:
        """Which states and inputs move which derivatives and outputs, as a large model declares it; None: unknown.

        It is not believed: whoever uses it compares with one more evaluation.
        """
        return None

    @abstractmethod
    def why_not_exact(self) -> str:
        """Return why `jacobian` cannot be used; empty if it can."""


class FmuPoint(ModelPoint):
    """The point at which a model exchange session stands.

    In continuous time an FMU keeps its relations, so an FMU with event indicators is taken through event
    mode at the evaluated point, and its state is taken back afterwards: by the saved FMU state where that can
    be trusted; else by the way back through event mode where that ends at the same values, by replay
    where not. FMUs without event indicators have no relations that could stay behind.

    Args:
        session: of model exchange; the point owns it from now on, and it must not be advanced.

    Raises:
        InputError: the session is of co-simulation.
    """

    def __init__(self, session: FmuSession) -> None:
        if not isinstance(session, MeSession):
            way = session.instance.description.way_out()
            raise InputError(f"a co-simulation FMU provides neither states nor derivatives; {way}")
        self.session = session
        self.time = session.time
        self.calls = Counter()
        self._moved = False
        self._state: Any = None
        self._bind()
        self._snapshot = session.snapshot()
        self.nominal, self.smallest = _usable(session.instance.get_nominals()), session.scales()[0]
        self.x0, self.u0 = self._stand.read()
        self._remember()

    def _bind(self) -> None:
        """Prepare access to the present instance."""
        instance = self.session.instance
        known = instance.description.variables
        self._stand = Stand(instance)
        self.states = named_states(instance)
        self.inputs = self._stand.inputs
        self.outputs = tuple(v for v in known if v.causality == "output" and v.type in instance.TYPES and v.is_number)
        held = [
            v
            for v in known
            if v.variability == "discrete"
            and v.causality in ("local", "output")
            and not v.alias_of
            and v.type in instance.TYPES
            and v.is_number
        ]
        self.memory = tuple(v for v in held if v.type in FLOAT_TYPES and v.start is not None)
        self._outputs, self._held = (instance.access(v) for v in (self.outputs, held))

    # -- base point -----------------------------------------------------------------------

    def move(self, x: Floats, u: Floats) -> None:
        self._back()
        self._settle(x, u)
        self.x0, self.u0 = self._stand.read()
        self._free()
        self._remember()
        self._moved = True

    def _settle(self, x: Floats, u: Floats) -> bool:
        """Go to (x, u) and evaluate every relation there; True: states jumped."""
        self._stand.put(self.time, x, u)
        return self._stand.has_relations and self._event(u)

    def _remember(self) -> None:
        """Keep what tells whether the model is back at the base point, and its state if it may be needed."""
        if self._stand.has_relations and self.session.setup.state_works():
            self._state = self.session.instance.get_state()
        self._signs0, self._held0 = self._signs(), self._held_values()
        self._away = self._lost = False

    def _signs(self) -> Floats:
        """Return on which side of zero each event indicator is."""
        instance = self.session.instance
        instance.get_indicators()
        return np.where(instance.z > 0.0, 1.0, 0.0)

    def _held_values(self) -> Floats:
        return _floats(self._held.read() if self._held.variables else [])

    def _unchanged(self) -> bool:
        """Whether relations and discrete states are those of the base point."""
        return np.array_equal(self._signs(), self._signs0) and _alike(self._held_values(), self._held0)

    def _back(self) -> None:
        """Go back to the base point if relations have been evaluated elsewhere."""
        instance = self.session.instance
        if not instance.healthy or (self._lost and self._state is None):
            self._again()
        elif self._away and self._state is not None:
            instance.set_state(self._state)
        self._away = self._lost = False

    def _again(self) -> None:
        """Take the session back to where it stood, and go to the base point once more."""
        self._free()
        self.session.restore(self._snapshot)
        self._bind()
        self._settle(self.x0, self.u0)
        if self._stand.has_relations and self.session.setup.state_works():
            self._state = self.session.instance.get_state()

    # -- evaluation -----------------------------------------------------------------------

    def at(self, x: Floats, u: Floats) -> Evaluation:
        self._back()
        self._stand.put(self.time, x, u)
        if self.session.instance.nz == 0 and all(u[i] == self.u0[i] for i in self._stand.slow):
            return self._read()
        self._away = self._lost = True  # until it is known to be otherwise
        jumped = self._event(u)
        values = self._read()
        if not jumped and (self._unchanged() or self._returns()):
            self._lost = False
            return values
        return self._before_event(x, u)

    def _returns(self) -> bool:
        """Whether all is as before when states and inputs go back; if not, a `when` has set something."""
        return not self._settle(self.x0, self.u0) and self._unchanged()

    def _before_event(self, x: Floats, u: Floats) -> Evaluation:
        """Evaluate in event mode but before events are handled: relations follow, nothing is set."""
        self._back()
        self._stand.put(self.time, x, u)
        self._away = self._lost = True
        self._stand.enter(u)
        values = self._read()
        if self._state is None:
            self.session.instance.iterate_events()
            self.session.instance.enter_continuous_mode()
        return Evaluation(values.dx, values.y, latched=True)

    def _event(self, u: Floats) -> bool:
        """Set the other inputs and evaluate every relation where the model stands; True: states jumped."""
        info = self._stand.event(u)
        if info.terminate:
            raise EndedError("the FMU ended its run at a perturbed point", time=self.time)
        return info.states_changed

    def _read(self) -> Evaluation:
        instance = self.session.instance
        self.calls["derivatives"] += 1
        # Outputs first: OpenModelica's FMUs do not compute them anew once the derivatives are known.
        y = _floats(self._outputs.read() if self.outputs else [])
        instance.get_derivatives()
        dx = instance.dx.copy()
        if not (np.isfinite(dx).all() and np.isfinite(y).all()):
            raise SimulationError(f"{self._not_finite(dx, y)} is not a finite number", time=self.time)
        return Evaluation(dx, y)

    def _not_finite(self, dx: Floats, y: Floats) -> str:
        names = [f"the derivative of {v.name}" for v in self.states] + [v.name for v in self.outputs]
        return names[int(np.flatnonzero(~np.isfinite(np.concatenate([dx, y])))[0])]

    @cached_property
    def pattern(self) -> Pattern | None:
        instance = self.session.instance
        rows = (*instance.description.derivatives, *self.outputs)
        return columns_pattern(instance, (*self.states, *self.inputs), rows)

    # -- exact derivatives ----------------------------------------------------------------

    def jacobian(self) -> Floats:
        why = self.why_not_exact()
        if why:
            raise InputError(why)
        self._back()
        self._stand.put(self.time, self.x0, self.u0)
        instance, n = self.session.instance, len(self.states)
        # Other outputs change at events alone: nothing moves them here, and an FMU may refuse to be asked.
        smooth = [i for i, v in enumerate(self.outputs) if v.type in FLOAT_TYPES and v.variability == "continuous"]
        shape = n + len(self.outputs), n + len(self.inputs)
        rows = {**dict(enumerate(instance.description.derivatives)), **{n + i: self.outputs[i] for i in smooth}}
        columns = [*enumerate(self.states), *((n + i, v) for i, v in enumerate(self.inputs) if v.is_continuous_input)]
        return ExactJacobian(instance, rows, dict(columns), self.calls).full(shape, self.pattern)

    def why_not_exact(self) -> str:
        return why_not_exact(self.session.instance)

    def ticks(self, most: int, until: float) -> Floats:
        if not self._moved and self.session.next_event == np.inf:  # said at the event with which the session began
            return np.zeros(0)
        instance, result = self.session.instance, list[float]()
        self._back()
        self._away = self._lost = True
        time = self.time
        while len(result) < most:
            instance.set_time(time)
            instance.enter_event_mode()
            info = instance.iterate_events()
            if info.terminate:  # the FMU ends its run there
                break
            time = info.next_time
            instance.enter_continuous_mode()
            if not (np.isfinite(time) and time <= until) or (result and time <= result[-1]):
                break
            result.append(time)
        return np.array(result)

    def discrete(self) -> dict[str, float]:
        return {v.name: float(x) for v, x in zip(self._held.variables, self._held0, strict=True)}

    def _free(self) -> None:
        if self._state is not None:
            self.session.instance.free_state(self._state)
            self._state = None

    def close(self) -> None:
        self._free()
        self.session.close()


def _floats(values: Sequence[Any]) -> Floats:
    return np.array([float(v) for v in values], dtype=np.float64)


def _usable(nominal: Floats) -> Floats:
    good = np.isfinite(nominal) & (nominal != 0.0)
    result: Floats = np.where(good, np.abs(nominal), 1.0)
    return result


def _alike(a: Floats, b: Floats) -> bool:
    return bool(np.allclose(a, b, rtol=_SAME, atol=0.0, equal_nan=True))
