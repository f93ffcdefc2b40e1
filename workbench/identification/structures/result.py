"""The result of an identification with static blocks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from workbench.core.records.record import RecordPart, entry
from workbench.core.values.arrays import Floats
from workbench.data.experiment.experiment import Experiment
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.structures.table import StaticTable
from workbench.identification.validate.residuals import OutputFit, fit_of
from workbench.show.result import Result
from workbench.system.description import (
    BlockComponent,
    Connection,
    GainComponent,
    LinearComponent,
    SystemDescription,
)

__all__ = ["StructureResult", "Tried"]

_AS_WELL = 0.5  # by which fits that are as good may differ [%]
_STEPS = 10  # of the search for an initial state


@dataclass(frozen=True, kw_only=True)
class Tried(RecordPart):
    """One order and number of knots that were tried.

    Attributes:
        order: of the linear block.
        knots: of each static block; 0: the linear model alone.
        criterion: Bayesian, smallest is best.
    """

    order: int
    knots: int
    criterion: float


@dataclass(frozen=True, eq=False, kw_only=True)
class StructureResult(Result):
    """A linear block with static blocks: y = g(G f(u)).

    Attributes:
        structure: hammerstein, wiener or hammerstein-wiener.
        before: f, from the input's unit to the same; None: there is none.
        linear: G, from the input's unit to the output's, with the covariance of its parameters.
        behind: g, from the output's unit to the same; None: there is none.
        knots: of each static block.
        tried: orders and numbers of knots, and 0 knots for the linear model alone.
        order_reason: why the linear block has its order.
        noise_order: coefficients of the equation of the disturbance.
        noise_rms: standard deviation of its innovations [unit of the output].
        settled: a further step would change nothing.
        data: of the fit.
        other: validation data; None: those of the fit.
        simulated: shape (N,), output of the blocks on the validation data.
        linear_fit_percent: fit of the linear model alone on the same data [%].
        notes: what else should be known, one line each.
    """

    _page = "workbench.identification.structures.page:structure_page"
    _picture = "workbench.identification.structures.picture:plot_structure"

    structure: str
    before: StaticTable | None
    linear: IdentifiedModel
    behind: StaticTable | None
    knots: int
    tried: tuple[Tried, ...]
    order_reason: str
    noise_order: int
    noise_rms: float
    settled: bool
    data: Experiment = field(metadata=entry(key="experiment"))
    other: Experiment | None = field(default=None, metadata=entry(key="validation_experiment"))
    simulated: Floats = field(metadata=entry(dims=("validation_time",)))
    linear_fit_percent: float
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "an identification with static blocks", "identify"

    @property
    def model(self) -> IdentifiedModel:
        """The linear block."""
        return self.linear

    @property
    def order(self) -> int:
        """Number of states of the linear block, delays not counted."""
        return self.linear.order - sum(self.linear.delay)

    @property
    def judged(self) -> Experiment:
        """The data of the figures: other data where there are some, else those of the fit."""
        return self.data if self.other is None else self.other

    @property
    def fit(self) -> OutputFit:
        """Fit of the simulation."""
        return fit_of(self.data.output_names[0], self.judged.y[:, 0], self.simulated)

    @property
    def fit_percent(self) -> float:
        """Fit of the simulation; see `residuals.OutputFit` [%]."""
        return self.fit.fit_percent

    @property
    def failed(self) -> dict[str, str]:
        """Output → why the simulation has no fit, or is of no use."""
        why = self.fit.reason
        if not why and self.fit_percent < self.linear_fit_percent - _AS_WELL:
            why = (
                f"the linear model alone follows better, with {self.linear_fit_percent:.4g} % for "
                f"{self.fit_percent:.4g} %: the blocks are of no use; try another order or structure"
            )
        return {self.fit.output: why} if why else {}

    @property
    def pays(self) -> bool:
        """Whether the Bayesian criterion is lower than that of the linear model alone, and the simulation is of use."""
        if self.failed:
            return False
        alone = min((t.criterion for t in self.tried if not t.knots), default=math.inf)
        return min((t.criterion for t in self.tried if t.knots), default=math.inf) < alone

    def simulate(self, u: Floats, y: Floats | None = None) -> Floats:
        """Return the output without noise, shape (N,).

        Args:
            u: shape (N,), [unit of the input].
            y: shape (N,), the measured output, by which the state at the first sample is found; None: at rest at the
                first input.
        """
        given = np.asarray(u, dtype=np.float64).reshape(-1)
        v = given if self.before is None else self.before(given)
        state = _rest(self.linear, float(v[0]))
        if y is not None:
            state = self._begun(v, np.asarray(y, dtype=np.float64).reshape(-1), state)
        w = self.linear.simulate(v[:, None], state)[:, 0]
        return w if self.behind is None else self.behind(w)

    def _begun(self, v: Floats, y: Floats, state: Floats) -> Floats:
        """Return the state at the first sample that fits a record best."""
        if self.behind is None:
            return self.linear.initial_state(v[:, None], y[:, None])
        free = replace(self.linear, B=np.zeros_like(self.linear.B), D=np.zeros_like(self.linear.D), y0=np.zeros(1))
        units = np.array([free.simulate(v[:, None], row)[:, 0] for row in np.eye(len(state))]).reshape(-1, len(v)).T
        width = 1e-4 * float(np.ptp(self.behind.x))
        for _ in range(_STEPS):
            w = self.linear.simulate(v[:, None], state)[:, 0]
            slope = (self.behind(w + width) - self.behind(w - width)) / (2.0 * width)
            change = np.linalg.lstsq(slope[:, None] * units, y - self.behind(w), rcond=1e-6)[0]
            tried = state + change
            if np.sum((y - self.behind(self.linear.simulate(v[:, None], tried)[:, 0])) ** 2) >= np.sum(
                (y - self.behind(w)) ** 2
            ):
                break
            state = tried
        return state

    def to_system(self, name: str | None = None) -> SystemDescription:
        """Return the blocks as a system, without noise: its input and output have the names of the columns.

        The parts are `before`, `linear` and `behind`; a static block that the structure has not is a gain of 1. The
        linear part is sampled: it acts at multiples of its dt and holds its output in between. It starts at its x0, the
        state at the first sample of the data; the connections take its operating point off and add it again.

        Args:
            name: of the system; None: that of the linear block.
        """
        linear, inputs, outputs = self.linear, self.data.input_names, self.data.output_names
        units = [
            {} if unit is None else {"u": unit, "y": unit} for unit in (linear.input_units[0], linear.output_units[0])
        ]
        ends = {"u": linear.input_units[0], "y": linear.output_units[0]}
        sampled = LinearComponent(
            name="linear", A=linear.A, B=linear.B, C=linear.C, D=linear.D, dt=linear.dt, x0=linear.x0,
            input_names=("u",), output_names=("y",), state_names=linear.state_names,
            units={port: unit for port, unit in ends.items() if unit is not None},
        )  # fmt: skip
        return SystemDescription(
            name=name or linear.name,
            components=(
                _static("before", self.before, units[0]), sampled, _static("behind", self.behind, units[1])
            ),
            connections=(
                Connection(source="before.y", destination="linear.u", offset=-float(linear.u0[0])),
                Connection(source="linear.y", destination="behind.u", offset=float(linear.y0[0])),
            ),
            inputs={inputs[0]: ("before.u",)},
            outputs={outputs[0]: "behind.y"},
        )  # fmt: skip

    def derived(self) -> dict[str, Any]:
        """Return figures, and the data by name."""
        return {
            "model": self.data.name, "order": self.order, "fit_percent": self.fit_percent, "pays": self.pays,
            "validated_on": "other data" if self.other is not None else "the data of the fit",
            "failed": [{"where": where, "reason": why} for where, why in self.failed.items()],
        }  # fmt: skip

    @classmethod
    def restored(cls, data: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return what the fields take."""
        return data

    def column_units(self) -> Mapping[str, str | None]:
        """Return the units of the table's columns, as far as they have one."""
        return {**self.judged.units, f"{self.judged.output_names[0]} simulated": self.judged.output_units[0]}

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield time, input, measured and simulated output of the validation data."""
        data = self.judged
        yield ("time [s]", data.input_names[0], data.output_names[0], f"{data.output_names[0]} simulated")
        yield from np.column_stack([data.time, data.u[:, 0], data.y[:, 0], self.simulated]).tolist()


def _static(name: str, table: StaticTable | None, units: Mapping[str, str]) -> BlockComponent | GainComponent:
    """Return a static block as a component, which goes on beyond its knots as the table does; None: a gain of 1."""
    if table is None:
        return GainComponent(name=name, units=units)
    parameters = {"x": table.x.tolist(), "y": table.y.tolist(), "extrapolation": "linear"}
    return BlockComponent(name=name, kind="lookup", parameters=parameters, units=units)


def _rest(model: IdentifiedModel, v: float) -> Floats:
    """Return the state at rest under an input; 0 where there is none."""
    n = model.order
    with np.errstate(all="ignore"):
        try:
            result = np.linalg.solve(np.eye(n) - model.A, model.B[:, 0] * (v - model.u0[0]))
        except np.linalg.LinAlgError:
            return np.zeros(n)
    return result if np.all(np.isfinite(result)) else np.zeros(n)
