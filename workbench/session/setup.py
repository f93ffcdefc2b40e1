"""How the sessions of one model begin."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from workbench.core.values.calendar import Sampler
from workbench.fmi.instance import Instance
from workbench.fmi.variable import Value, Variable
from workbench.session.start_values import Miss
from workbench.signals.kinds import Signal

__all__ = ["Lead", "Manners", "Setup"]


@dataclass
class Manners:
    """How an FMU lets itself be started: learned at the first start of a model, kept for all its sessions.

    Where FMI allows two orders of calls and an FMU refuses the first, the other is tried.

    Attributes:
        other_order: co-simulation: the FMU declares event mode, but runs only without.
        time_first: model exchange: whether the FMU is told the time once more before the first event iteration; None:
            where it does not begin at 0, since some exports initialise at 0 whatever start time they are told.
        note: says so; empty where all goes as usual.
        guessed: says which start values, mere guesses by the FMU's own word, came out otherwise; empty: none.
        forgets: says that parameters are set once more during initialisation; empty: the FMU keeps those set before.
        stop: co-simulation: the stop time that the FMU is told [s]; None: none, since it is seldom known.
        unkept: input that nobody set → what it has in place of its declared start value; None: it has that.
        stops: says that it is told one, since it goes no further than its own otherwise; empty: it is told none.
    """

    other_order: bool = False
    time_first: bool | None = None
    note: str = ""
    guessed: str = ""
    forgets: str = ""
    stop: float | None = None
    stops: str = ""
    unkept: dict[str, Miss | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Lead:
    """A run that leads a co-simulation session to its start.

    Attributes:
        duration: how long [s]; it begins that much before the session's start time.
        step: its communication step [s].
        clock: the FMU's own time is that much later than the session's [s].
        sizes: state or output → its largest magnitude on the way.
    """

    duration: float
    step: float
    clock: float
    sizes: Mapping[str, float]


def _not_yet() -> Instance:
    raise NotImplementedError


@dataclass(frozen=True)
class Setup:
    """How sessions of one model begin.

    Attributes:
        variables: name → variable, all of the model's.
        open_instance: returns a new instance of the FMU; a model puts its own in place.
        start_values: parameters and start values set before initialisation.
        guesses: the same of the point's values, as far as FMI lets them be set; initialisation may override them.
        point: states, discrete states and inputs → where the session starts, whatever initialisation makes of it.
        outputs: what the model shows at that point, where it is known.
        lead: co-simulation: a run under the inputs of the point that ends there; None: there is none.
        bias: constants added to inputs.
        rtol: relative tolerance of the integration.
        tolerance: what a co-simulation FMU is told; None: nothing.
        start_time: [s].
        step: communication step [s]; None: derived from signals and points.
        signals: what forces the inputs during initialisation.
        hold_inputs: co-simulation: inputs stand over a step as they are at its start, also where the FMU interpolates.
        solver: "gear", "vkm", "none" (there are no states), or "fmu".
        state_works: asks once whether the FMU's own state can be trusted for snapshots.
        slopes_act: co-simulation that takes slopes of its inputs: asks once whether it makes anything of them.
        manners: in which order it lets itself be started; shared by the sessions of one model.
        samplers: what declares how often it samples.
    """

    variables: Mapping[str, Variable]
    open_instance: Callable[[], Instance] = _not_yet
    start_values: Mapping[str, Value] = field(default_factory=dict)
    guesses: Mapping[str, Value] = field(default_factory=dict)
    point: Mapping[str, float] = field(default_factory=dict)
    outputs: Mapping[str, float] = field(default_factory=dict)
    lead: Lead | None = None
    bias: Mapping[str, float] = field(default_factory=dict)
    rtol: float = 1e-6
    tolerance: float | None = None
    start_time: float = 0.0
    step: float | None = None
    signals: Mapping[str, Signal] = field(default_factory=dict)
    hold_inputs: bool = False
    solver: str = "gear"
    state_works: Callable[[], bool] = lambda: False
    slopes_act: Callable[[], bool] = lambda: True
    manners: Manners = field(default_factory=Manners)
    samplers: tuple[Sampler, ...] = ()
