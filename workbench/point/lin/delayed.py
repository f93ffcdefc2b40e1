"""Systems with transport delays: the state space has a Padé approximation, the frequency response the delay itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError
from workbench.model.base import Model
from workbench.model.described_model import DescribedModel
from workbench.model.operating_point import named
from workbench.point.lin.delay_roots import delay_roots
from workbench.point.lin.result import DelayFreePart, LinResult
from workbench.point.lin.task import LinTask
from workbench.system.block_table.linear import DelayBlock as DelayedBlock
from workbench.system.block_table.linear import VariableDelay
from workbench.system.description import BlockComponent, LinearComponent, SystemDescription
from workbench.system.recipe import SystemRecipe

__all__ = ["has_delays", "pade", "phase_holds_to", "through_delays"]

_INTO, _IN, _OUT = "lin_delayed", "lin_delayed_{}", "lin_delay_{}"
_GOOD = 1.0  # deg, of the phase of an approximation
_SAME = 1e-9  # relative; of a delay to a multiple of a sample period


@dataclass(frozen=True)
class _Cut:
    """One delay of a system.

    Attributes:
        component: it.
        time: how long [s], at the operating point.
        x0: states of what is behind it, there.
        delayed: what comes out of the delay, there.
    """

    component: BlockComponent
    time: float
    x0: Floats
    delayed: float

    @property
    def order(self) -> int:
        """Of its Padé approximation."""
        return _block(self.component).pade

    @property
    def source(self) -> str:
        """Full name of what is delayed."""
        return f"{self.component.name}.{self.component.block.inputs[0]}"


def _delays(model: Model) -> list[BlockComponent]:
    system = getattr(model, "system", None)
    if not isinstance(system, SystemDescription) or model.interface != "me":
        return []
    parts = [c for c in system.components if isinstance(c, BlockComponent)]
    return [c for c in parts if isinstance(c.block, DelayedBlock)]


def has_delays(model: Model) -> bool:
    """Whether a model is a system of model exchange parts with transport delays."""
    return bool(_delays(model))


def through_delays(task: LinTask, linearise: Callable[[LinTask], LinResult]) -> LinResult:
    """Return the linear model of a system with delays.

    The system is opened at every delay, linearised, and closed again: in the state space by a Padé approximation of
    each delay, in the frequency response by e^(−sT) itself. A sampled model holds a delay that is a multiple of its
    period exactly, as a chain.

    Args:
        task: the linearisation.
        linearise: how a system without delays is.

    Raises:
        InputError: a delay that a sampled model cannot hold.
    """
    model = task.model
    components = _delays(model)
    recipe = getattr(model, "recipe", None)
    if not isinstance(model, DescribedModel) or not isinstance(recipe, SystemRecipe):
        raise InputError(f"{model.name}: this is not a system")
    with model.open_at(time=task.time, values=dict(task.values)) as session:
        wanted = [f"{c.name}.{port}" for c in components for port in (*c.block.inputs, *c.block.states, "y")]
        here = session.values(wanted)
    cuts = [_cut(c, here) for c in components]
    standing = {_IN.format(i): c.delayed for i, c in enumerate(cuts)}
    with _opened(recipe, cuts).open() as opened:
        request = replace(
            task,
            model=opened,
            inputs=(*task.inputs, *standing),
            outputs=(*task.outputs, *(_OUT.format(i) for i in range(len(cuts)))),
            values={**task.values, **standing},
        )
        result = linearise(request)
    return _closed(task, result, cuts)


def _cut(component: BlockComponent, here: Mapping[str, float]) -> _Cut:
    block, name = _block(component), component.name
    time = block.times[0]
    if isinstance(block, VariableDelay):
        time = min(max(here[f"{name}.u2"], block.smallest), block.largest)
    behind, x0 = block.filter(), np.array([here[f"{name}.{state}"] for state in block.states])
    through = float(behind.d[0, 0])
    # Without a direct path nothing at the point depends on it; any value will do.
    delayed = (here[f"{name}.y"] - float(behind.c[0] @ x0)) / through if through else here[f"{name}.{block.inputs[0]}"]
    return _Cut(component, time, x0, delayed)


def _block(component: BlockComponent) -> DelayedBlock:
    block = component.block
    if not isinstance(block, DelayedBlock):
        raise InputError(f"component {component.name} is not a delay")
    return block


def _opened(recipe: SystemRecipe, cuts: Sequence[_Cut]) -> SystemRecipe:
    """Return the system with each delay replaced by what is behind it, driven by an input of the system."""
    stand_ins = {c.component.name: _stand_in(c) for c in cuts}
    system = recipe.system
    shown = {_OUT.format(i): c.source for i, c in enumerate(cuts)}
    return recipe.changed(
        replace(
            system,
            components=tuple(stand_ins.get(c.name, c) for c in system.components),
            inputs={
                **system.inputs,
                **{_IN.format(i): (f"{c.component.name}.{_INTO}",) for i, c in enumerate(cuts)},
            },
            outputs={**system.outputs, **shown},
        )
    )


def _stand_in(cut: _Cut) -> LinearComponent:
    component = cut.component
    block, behind = component.block, _block(component).filter()
    unused = np.zeros((1, len(block.inputs)))
    units = {**component.units, **({_INTO: component.units["y"]} if "y" in component.units else {})}
    return LinearComponent(
        behind.a, np.hstack([behind.b * unused, behind.b]), behind.c, np.hstack([unused, behind.d]), dt=0.0,
        name=component.name, input_names=(*block.inputs, _INTO), output_names=("y",), state_names=block.states,
        x0=cut.x0, units=units,
    )  # fmt: skip


def _closed(task: LinTask, linear: LinResult, cuts: Sequence[_Cut]) -> LinResult:
    """Close an opened linear model by what stands for its delays."""
    from scipy.linalg import block_diag  # noqa: PLC0415 - slow to import, and for delays only

    parts = [_approximation(c, linear.dt) for c in cuts]
    a, b, c, d = (block_diag(*(p[i] for p in parts)) for i in range(4))
    m, q = len(task.inputs), len(task.outputs)
    B1, B2, C1, C2 = linear.B[:, :m], linear.B[:, m:], linear.C[:q], linear.C[q:]
    D11, D12, D21, D22 = linear.D[:q, :m], linear.D[:q, m:], linear.D[q:, :m], linear.D[q:, m:]
    loop = np.eye(len(cuts)) - d @ D22
    if abs(np.linalg.det(loop)) < _SAME:
        raise InputError(f"{task.model.name}: a loop without states goes through a delay; it has no linear model")
    # w = c z + d v, v = C2 x + D21 u + D22 w
    wx, wz, wu = (np.linalg.solve(loop, right) for right in (d @ C2, c, d @ D21))
    vx, vz, vu = C2 + D22 @ wx, D22 @ wz, D21 + D22 @ wu
    names = [f"{cut.component.name}.pade{k + 1}" for cut, p in zip(cuts, parts, strict=True) for k in range(len(p[0]))]
    delayed = DelayFreePart(linear.A, linear.B, linear.C, linear.D, np.array([cut.time for cut in cuts]))
    where = linear.operating_point
    opened = replace(
        where,
        u={n: v for n, v in where.u.items() if not n.startswith(_INTO)},
        y={n: v for n, v in where.y.items() if n in task.outputs},
    )
    closed = replace(
        linear,
        model=task.model.name,
        A=np.block([[linear.A + B2 @ wx, B2 @ wz], [b @ vx, a + b @ vz]]),
        B=np.vstack([B1 + B2 @ wu, b @ vu]),
        C=np.hstack([C1 + D12 @ wx, D12 @ wz]),
        D=D11 + D12 @ wu,
        state_names=(*linear.state_names, *names),
        input_names=task.inputs,
        output_names=task.outputs,
        units={**{n: u for n, u in linear.units.items() if "lin_delay" not in n}, **dict.fromkeys(names)},
        operating_point=named(task.model, opened),
        zeros=tuple(z for z in linear.zeros if "lin_delay" not in z.name),
        doubts=tuple(x for x in linear.doubts if "lin_delay" not in x.row + x.column),
        delayed=delayed if linear.dt == 0.0 else None,
        notes=(*linear.notes, *(_words(cut, linear.dt) for cut in cuts)),
    )
    return _with_poles(closed)


def _with_poles(result: LinResult) -> LinResult:
    """Return a linear model with the rightmost poles that its delays make of it."""
    if result.delayed is None:
        return result
    found = delay_roots(result.delayed, result.poles)
    line = found.complete_to if math.isfinite(found.complete_to) else None
    return replace(result, delay_poles=found.roots, delay_poles_complete_to=line)


def _approximation(cut: _Cut, dt: float) -> tuple[Floats, Floats, Floats, Floats]:
    if dt == 0.0:
        return pade(cut.time, cut.order)
    count = round(cut.time / dt)
    if abs(cut.time - count * dt) > _SAME * cut.time:
        raise InputError(
            f"component {cut.component.name}: a delay of {cut.time:g} s is not a multiple of the sample period {dt:g} "
            "s, and a sampled linear model cannot hold it; linearise with method difference, which holds the samples"
        )
    last = np.zeros((1, count))
    last[0, -1] = 1.0
    return np.eye(count, k=-1), np.eye(count, 1), last, np.zeros((1, 1))


def _words(cut: _Cut, dt: float) -> str:
    name = f"{cut.component.name}: delay of {cut.time:g} s"
    if dt > 0.0:
        return f"{name} as a chain of {round(cut.time / dt)} samples"
    return (
        f"{name} as a Padé approximation of order {cut.order} in A, B, C, D, whose phase is within {_GOOD:g}° up to "
        f"{phase_holds_to(cut.time, cut.order):.3g} Hz; the frequency response and `delay_poles` have the delay itself"
    )


def _coefficients(order: int) -> Floats:
    """Return c of the denominator Σ c[k] s^k for a delay of 1 s; the numerator has (−1)^k c[k]."""
    f = math.factorial
    return np.array(
        [f(2 * order - k) * f(order) / (f(2 * order) * f(k) * f(order - k)) for k in range(order + 1)],
        dtype=np.float64,
    )


def pade(delay: float, order: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the Padé approximation of e^(−sT), numerator and denominator of one order.

    Args:
        delay: T [s].
        order: of both.

    Returns:
        A, B, C, D.

    Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., section 9.3.1 (diagonal Padé approximants).
    """
    c = _coefficients(order)
    signs = (-1.0) ** np.arange(order + 1)
    direct = float(signs[-1])
    below = c[:-1] / c[-1]
    above = (signs * c / c[-1])[:-1] - direct * below
    # Controllable form in s T; the states, derivatives of each other, in units of the size of the poles.
    scale = float(np.abs(below[0]) ** (1.0 / order)) ** np.arange(order)
    A = np.eye(order, k=1)
    A[-1] = -below
    B = np.eye(order)[:, -1:] / scale[:, None]
    return A * scale / scale[:, None] / delay, B / delay, (above * scale)[None, :], np.array([[direct]])


def phase_holds_to(delay: float, order: int) -> float:
    """Return up to which frequency the phase of a Padé approximation is within 1° [Hz].

    Args:
        delay: T [s].
        order: of numerator and denominator.
    """
    c = _coefficients(order)
    turns = np.linspace(0.0, 3.0 * order + 3.0, 4001)  # ωT
    below = np.polyval(c[::-1], 1j * turns)
    phase = -2.0 * np.unwrap(np.angle(below))
    off = np.abs(np.degrees(phase + turns))
    beyond = np.flatnonzero(off > _GOOD)
    last = turns[beyond[0]] if len(beyond) else turns[-1]
    return float(last / (2.0 * math.pi * delay))
