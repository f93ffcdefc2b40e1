"""What a model is to an analysis."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any, Self

from workbench.core.machine.closable import Closable
from workbench.core.values.calendar import Sampler, exact
from workbench.core.values.closed_loop import ClosedLoop
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError, visible
from workbench.fmi.variable import Value, Variable

if TYPE_CHECKING:
    from workbench.session.base import Session
    from workbench.session.point import ModelPoint
    from workbench.signals.kinds import Signal

__all__ = ["DeclaredRates", "Model", "Recipe"]

_MOST = 40  # variables of a kind that a notebook shows


def _row(v: Variable) -> str:
    cells = (v.name, v.unit or "", "" if v.start is None else str(v.start), v.description or "")
    return f"<tr>{''.join(f'<td>{escape(visible(c))}</td>' for c in cells)}</tr>"


@dataclass(frozen=True)
class DeclaredRates:
    """When a model says that it samples.

    Attributes:
        samplers: what is declared to sample at fixed times, whenever a session begins.
        clocks: those of FMI 3.0 with a declared period, whose offset counts from where a session begins.
        others: itself, or parts of it, that may sample besides without declaring it; only their events show when.
    """

    samplers: tuple[Sampler, ...] = ()
    clocks: tuple[Sampler, ...] = ()
    others: tuple[Model, ...] = ()

    def begun(self, time: float) -> tuple[Sampler, ...]:
        """Return when all of them sample in a session that begins at `time` [s]."""
        begin = exact(time)
        return (
            *(s.since(time) for s in self.samplers),
            *(replace(c, offset=c.offset + begin) for c in self.clocks),
        )


class Recipe(ABC):
    """Small and picklable; opens the same model wherever it is sent.

    Obligations of a subclass:
      1. `open` returns a model that behaves as the one the recipe came from; whoever opens it closes it.
      2. `identity` names everything that influences what the model computes, and nothing else:
         results are kept under it.

    Attributes:
        source: what the user named, for messages.
    """

    source: str = "the model"

    @abstractmethod
    def open(self) -> Model:
        """Return the model.

        Raises:
            InputError, FmuError: as when it was loaded first.
        """

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """Return what tells this model from others, ready for JSON."""

    @abstractmethod
    def tighter(self, factor: float) -> Recipe:
        """Return the recipe of the same model with `factor` times its relative tolerance of the integration."""

    def content(self) -> str:
        """Return the SHA-256 of what the model is, whatever is set in it; empty: it cannot be told from another."""
        return ""

    @property
    def portable(self) -> bool:
        """Whether it can be sent to another process."""
        return True

    def packed(self) -> Recipe:
        """Return a recipe that needs no file of this machine."""
        return self

    def settled(self) -> Recipe:
        """Return what `packed` gave with its files in folders of this process, each FMU once for all recipes."""
        return self


class Model(Closable):
    """Inputs, outputs, states, parameters, and sessions: all that an analysis sees.

    Obligations of a subclass:
      1. The attributes are fixed after construction.
      2. `open_session` may be called as often as wanted, several sessions may live at once
         (a model that allows one says so with an FmuError); sessions do not influence each other.
      3. Sessions must be closed before the model; `close` closes those still open.
      4. `notes` tells every choice made on the user's behalf and every rule the file bends.

    Attributes:
        name: short name for tables and pictures.
        interface: "me" or "cs".
        solver: "vkm", "gear", "fmu" (co-simulation: the FMU's own), "none" (nothing to integrate).
        inputs, outputs, parameters, states: the variables, in the model's order.
        notes: remarks for the user.
        grid: constant communication step that co-simulation insists on [s]; None: steps may differ.
        start_time: where sessions begin unless told otherwise [s].
        stop_time: end of the default experiment [s]; None: it names none.
        recipe: how to make the model again in another process; None: it lives in this one only.
        at: where its sessions start; None: where the model starts by itself.
        closed: whether it was closed.
        rtol: relative tolerance of the workbench's own integration; 0: there is nothing that it integrates.
    """

    name: str
    interface: str
    solver: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    states: tuple[Variable, ...]
    notes: tuple[str, ...]
    grid: float | None = None
    start_time: float = 0.0
    stop_time: float | None = None
    recipe: Recipe | None = None
    at: OperatingPoint | None = None
    rtol: float = 0.0
    closed: bool = False

    def __repr__(self) -> str:
        """Return one line: what it is, and how many variables of each kind it has."""
        counts = ", ".join(f"{len(held)} {kind[: -(len(held) == 1) or None]}" for kind, held in self._kinds().items())
        return f"<{type(self).__name__} {visible(self.name)} ({self.interface}, {self.solver}): {counts}>"

    def _repr_html_(self) -> str:
        """Return its variables as tables, for a notebook."""
        parts = [f"<strong>{escape(visible(self.name))}</strong> ({self.interface}, {self.solver})"]
        for kind, held in self._kinds().items():
            rows = "".join(_row(v) for v in held[:_MOST])
            more = f"<p>… {len(held) - _MOST} more</p>" if len(held) > _MOST else ""
            opened = " open" if kind in {"inputs", "outputs"} else ""
            head = "<tr><th>name</th><th>unit</th><th>start</th><th>description</th></tr>"
            table = f"<table>{head}{rows}</table>{more}"
            parts.append(f"<details{opened}><summary>{len(held)} {kind}</summary>{table}</details>")
        return "".join(parts)

    def _kinds(self) -> dict[str, tuple[Variable, ...]]:
        return {
            "inputs": self.inputs, "outputs": self.outputs, "states": self.states, "parameters": self.parameters,
        }  # fmt: skip

    def starting_at(self, point: OperatingPoint | None, notes: Sequence[str] = ()) -> Self:
        """Return the model that starts at an operating point, here and in every worker; it is closed with this one.

        Its inputs hold the point's values until a signal forces them.

        Args:
            point: one of this model, see `operating_point.find_point`; None: where the model starts by itself.
            notes: on the point.

        Raises:
            InputError: this kind of model starts at its start values only.
        """
        if self.recipe is None:
            raise InputError(f"{self.name}: this kind of model can only start at its start values")
        twin = copy.copy(self)
        twin.at, twin.notes = point, (*self.notes, *notes)
        twin.start_time = self.start_time if point is None else point.time
        return twin

    @property
    def start_values(self) -> Mapping[str, Value]:
        """Parameters and start values that it was opened with, in their variables' types, arrays element by element."""
        return {}

    @property
    def bias(self) -> Mapping[str, float]:
        """Input → constant that is added to it."""
        return {}

    @abstractmethod
    def open_session(
        self,
        *,
        start_time: float | None = None,
        step: float | None = None,
        signals: Mapping[str, Signal] | None = None,
    ) -> Session:
        """Return a session, initialised, at `start_time` [s]: at the operating point `at` where the model has one.

        Args:
            start_time: session time at which the model is initialised [s]; None: the model's own.
            step: communication step [s] in place of the model's; ignored by model exchange.
            signals: forced inputs whose values at `start_time` hold already during
                initialisation; None: the inputs' start values. At an operating point its inputs hold then.

        Raises:
            FmuError: the FMU cannot be instantiated.
            SimulationError: it cannot be initialised.
        """

    def open_at(
        self,
        *,
        time: float | None = None,
        values: Mapping[str, float] | None = None,
        outputs: Mapping[str, float] | None = None,
        step: float | None = None,
        tolerance: float | None = None,
        approach: bool = True,
    ) -> Session:
        """Return a session that stands at an operating point: every value asked for was read back.

        In model exchange, states and inputs are set after initialisation, and events are iterated there; a state that
        an event then moves on has taken. Discrete states are set before initialisation, the only way in FMI. In
        co-simulation states can be set before initialisation alone. Where they do not take, the model is run under the
        inputs of the point, before `time`, until it rests: at a stable equilibrium it stands there then.

        Args:
            time: session time at which the model is initialised [s]; None: the model's own.
            values: states, discrete states and inputs → where they start, beside or instead of those of `at`; the
                others start as the model starts them.
            outputs: output → what the model shows there, where it is known; compared, never set.
            step: communication step [s] in place of the model's.
            tolerance: relative tolerance of the integration in place of the model's.
            approach: in co-simulation, run to the point where it cannot be set.

        Raises:
            NotReachedError: a value did not take; the message names it. It is an InputError.
            InputError: an unknown name, or the model cannot do that.
            FmuError, SimulationError: see `open_session`.
        """
        raise InputError(f"{self.name}: this kind of model can only start at its start values")

    def controls_step(self) -> bool:
        """Whether its communication step is controlled by a tolerance; what the step costs then follows from that."""
        return False

    def way_out(self, *others: str) -> str:
        """Return what to do where co-simulation does not do, for a message.

        Args:
            others: what can be done besides using model exchange, as "use a shorter `step`".
        """
        return ", or ".join(others) or "use another model"

    def open_point(
        self,
        *,
        time: float | None = None,
        values: Mapping[str, float] | None = None,
    ) -> ModelPoint:
        """Return the model at one instant, for derivatives and outputs at any states and inputs near it.

        Args:
            time: session time [s]; None: where the model's sessions begin.
            values: values at the point, see `open_at`.

        Raises:
            InputError: the model cannot do that.
            FmuError, SimulationError: see `open_session`.
        """
        raise InputError(f"{self.name}: this kind of model provides no derivatives; use method response")

    def closed_loops(self, signals: Sequence[str], *, until: float) -> tuple[ClosedLoop, ...]:
        """Return the closed loops that are known to be inside, with what signals have to do with them: of systems.

        Args:
            signals: inputs, outputs or other variables.
            until: connections that close later than that [s] are open.
        """
        del signals, until
        return ()

    def declared_rates(self) -> DeclaredRates:
        """Return when it says that it samples: what analyses take for granted; `model/sample_rates` finds more."""
        return DeclaredRates(others=(self,))

    def remarks(self, given: Collection[str] = ()) -> tuple[str, ...]:
        """Return what was found out about the model while it ran; complete once the analysis is done.

        Args:
            given: inputs that the analysis sets: nothing is said of what they had before.
        """
        return ()

    @abstractmethod
    def close(self) -> None:
        """Close the open sessions and remove what the model owns. Any number of times."""
