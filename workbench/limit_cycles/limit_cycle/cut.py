"""A system cut at its nonlinear components: the blocks, and the linear part between their outputs and inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.core.values.linear import LinearPart
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.limit_cycles.equilibrium import rest_of
from workbench.limit_cycles.limit_cycle.bias import Centre, centre_of, is_moving
from workbench.loops.describing.base import DescribedBlock
from workbench.loops.describing.describe import standard_block
from workbench.loops.describing.static import StaticBlock, pointwise
from workbench.loops.opened_system import Ports, find_ports, linear_between, recipe_of, without_block
from workbench.model.described_model import DescribedModel
from workbench.point.lin.result import LinResult
from workbench.session.point import ModelPoint
from workbench.signals.kinds import Table
from workbench.system.description import (
    BlockComponent,
    Component,
    Connection,
    FunctionComponent,
    SumComponent,
    SystemDescription,
)

__all__ = ["SplitLoop", "cut", "driven_block", "only_block"]

_OPENED, _RETURNED = "opened", "returned"
_PROBES = (0.1, 1.0, 10.0)  # amplitudes that tell the sign of N
_WHAT = "the block is taken about"
_SAME = 1e-6  # of the largest output: the outputs on the way up and down are the same
_ROUNDS = 8  # linearisations on the way to the middle of a loop
_BEYOND = 1e3  # times the largest input: past every threshold of a hysteresis
_SWEEP = 1e-5  # [s], or of the session time if that is longer: events must not crowd


@dataclass(frozen=True, eq=False)
class SplitLoop:
    """A loop V + L W = 0 of a linear part and blocks, 1 + N·L = 0 where there is one.

    Attributes:
        every: where it was cut, for each block.
        whole: L, from the outputs of the blocks to their inputs, its sign for one block chosen so that N is positive
            where the block's gain has one sign throughout; its responses have transport delays as they are.
        blocks: static blocks about the operating point; None: it has a memory of its own.
        formulas: of blocks with a memory, the describing function in closed form about that point; None: it has none.
        turned: whether L and the one block have another sign than in the system.
        rest: the linear part as it was linearised.
        point: operating point of the whole system.
        centres: of the blocks' inputs at that point.
        outputs: of the blocks there; where one jumps, between the values on both sides.
        moving: whether the linear part moves at that point, so that nothing can be predicted about it.
        notes: what the user should know.
    """

    every: tuple[Ports, ...]
    whole: LinResult
    blocks: tuple[DescribedBlock | None, ...]
    formulas: tuple[DescribedBlock | None, ...]
    turned: bool
    rest: LinResult
    point: OperatingPoint
    centres: tuple[float, ...]
    outputs: tuple[float, ...]
    moving: bool
    notes: tuple[str, ...]

    @property
    def ports(self) -> Ports:
        """Where it was cut at the first block."""
        return self.every[0]

    @property
    def block(self) -> DescribedBlock | None:
        """The first block; None: it has a memory of its own."""
        return self.blocks[0]

    @property
    def centre(self) -> float:
        """Input of the first block at the operating point."""
        return self.centres[0]

    @cached_property
    def part(self) -> LinearPart:
        """L of a loop with one block; of transport delays it has Padé approximations."""
        return LinearPart.from_lin(self.whole)


def cut(
    model: DescribedModel,
    component: str,
    *further: str,
    at: OperatingPoint | None,
    time: float,
    keep: ExitStack,
) -> SplitLoop:
    """Return the loop of a system through one or several of its components.

    Args:
        model: a system; it stays open.
        component: the block.
        further: more blocks.
        at: operating point; None: the start where that is at rest, else what trim finds.
        time: session time [s]; connections that close later are open.
        keep: closes the models that the blocks need for their evaluation.

    Raises:
        InputError: see `find_ports`; a linear part that cannot be linearised.
        FmuError, SimulationError: the model cannot be opened or evaluated.
    """
    every = tuple(find_ports(model, name) for name in (component, *further))
    for ports in every:
        _refuse_linear(model, ports.component)
    point, notes = (at, []) if at is not None else rest_of(model, time=time, what=_WHAT)
    with model.open_at(time=time, values={**point.x, **point.u}) as session:
        here = session.values([name for p in every for name in (p.v, p.w)])
    rest = _linear_rest(model, every, point, time, [here[p.w] for p in every])
    functions = [_static(model, p, time, keep) for p in every]
    centres, outputs, moving = [here[p.v] for p in every], [here[p.w] for p in every], is_moving(rest)
    characteristic = (functions[0] or _middle_line(model, every[0], time, keep)) if moving and not further else None
    if characteristic is not None:
        middle, rest = _middle(model, every[0], rest, characteristic, (point, centres[0], outputs[0]), time)
        if middle is not None:
            centres, outputs, moving = [middle.v], [middle.w], False
            notes = [_moved_to(middle, every[0], remembers=functions[0] is None)]
    blocks = tuple(
        None if f is None else _block(f, p, v, w) for f, p, v, w in zip(functions, every, centres, outputs, strict=True)
    )
    whole, turned = rest.negated(), False
    if not further:
        block = blocks[0]
        turned = block is not None and all(block.gain(a).real <= 0.0 for a in _PROBES)
        if turned and block is not None:
            whole, blocks = rest, (block.negated(),)
    notes += [f"linear part: {note}" for note in rest.notes]
    notes += [f"linear part, d({d.row})/d({d.column}): {d.reason}" for d in rest.doubts]
    formulas = tuple(
        _formula(_component(recipe_of(model).system, p.component), v, w) if f is None else None
        for f, p, v, w in zip(functions, every, centres, outputs, strict=True)
    )
    return SplitLoop(
        every, whole, blocks, formulas, turned, rest, point, tuple(centres), tuple(outputs), moving, tuple(notes)
    )


def _refuse_linear(model: DescribedModel, name: str) -> None:
    """Refuse a block that is linear, as a delay is.

    Raises:
        InputError: it is.
    """
    component = _component(recipe_of(model).system, name)
    if isinstance(component, BlockComponent) and component.block.is_linear:
        raise InputError(
            f"{model.name}: {name} is a {component.kind.replace('_', ' ')}, which is linear and bounds no amplitude; "
            "name the block that does"
        )


def _block(function: Callable[[Floats], Floats], ports: Ports, centre: float, output: float) -> DescribedBlock:
    return StaticBlock(function, name=ports.component, centre=centre, rest=output)


def _formula(component: Component, centre: float, output: float) -> DescribedBlock | None:
    """Return the describing function of a hysteresis about its middle in closed form; None: there is none.

    The closed form of a block with states is that of an ideal one, without its lag.

    Args:
        component: the block.
        centre: its input at the operating point.
        output: its output there.
    """
    if not isinstance(component, BlockComponent) or component.block.states:
        return None
    known = component.block.described()
    if known is None:
        return None
    sizes = known.parameters.values()
    return standard_block(known.name, known.parameters) if max(abs(centre), abs(output)) <= _SAME * min(sizes) else None


def _middle(  # noqa: PLR0917
    model: DescribedModel,
    ports: Ports,
    rest: LinResult,
    function: Callable[[Floats], Floats],
    here: tuple[OperatingPoint, float, float],
    time: float,
) -> tuple[Centre | None, LinResult]:
    """Return the middle of a loop that is not at rest, and its linear part there; None and as it was: there is none."""
    point, v, w = here
    result, moved = None, rest
    for _ in range(_ROUNDS):
        middle = centre_of(moved, function, v, w)
        if middle is None:
            return None, rest
        x = {n: float(middle.x[i]) for n, i in moved.states.items()}
        moved = _linear_rest(model, [ports], replace(point, x={**point.x, **x}), time, [middle.w])
        result, v, w = middle, float(moved.operating_point.y[_RETURNED]), middle.w
        if not is_moving(moved, rest):
            return result, moved
    return None, rest


def _moved_to(middle: Centre, ports: Ports, *, remembers: bool) -> str:
    line = "hysteresis, its middle line," if remembers else "characteristic, its jumps filled in,"
    why = f"where the rest of the loop is at rest and the block's {line} is met"
    return f"the start is not at rest; {_WHAT} {ports.v} = {middle.v:.4g}, {ports.w} = {middle.w:.4g}, {why}"


# -- the linear part --------------------------------------------------------------------------


def _linear_rest(
    model: DescribedModel, every: Sequence[Ports], point: OperatingPoint, time: float, outputs: Sequence[float]
) -> LinResult:
    """Return the linear model from the outputs of the blocks to their inputs, about given outputs."""
    recipe = recipe_of(model)
    system, returned = recipe.system, {_numbered(_RETURNED, i): p.v for i, p in enumerate(every)}
    for i, ports in enumerate(every):
        system = without_block(model, system, ports, _numbered(_OPENED, i), returned)
    inputs = {_numbered(_OPENED, i): w for i, w in enumerate(outputs)}
    with recipe.changed(system).open() as opened:
        rest = linear_between(opened, inputs, list(returned), x=point.x, u=point.u, time=time)
    if rest.dt > 0.0:
        raise InputError(
            f"{model.name}: the rest of the loop is sampled ({rest.dt:g} s), and cycles are predicted for continuous "
            "loops alone; simulate it from a disturbed state, or measure it with loop or nfr"
        )
    return rest


def _numbered(name: str, index: int) -> str:
    return f"{name}{index + 1}" if index else name


# -- the block --------------------------------------------------------------------------------


def _component(system: SystemDescription, name: str) -> Component:
    return next(c for c in system.components if c.name == name)


def only_block(model: DescribedModel, ports: Ports, *, centre: float = 0.0) -> DescribedModel:
    """Return the block alone as a model with the input `v` and the output `w`; the caller closes it.

    Args:
        model: the system.
        ports: of the block.
        centre: from which `v` is counted.
    """
    system = recipe_of(model).system
    alone = replace(
        system,
        components=(_component(system, ports.component),),
        connections=(),
        inputs={"v": (ports.v,)},
        outputs={"w": ports.w},
    )
    return _open_block(model, alone, bias={"v": centre})


def driven_block(model: DescribedModel, ports: Ports, count: int, *, centre: float) -> DescribedModel:
    """Return the block alone, driven by the sum of the inputs v0 … v(count), with the output `w`; the caller closes it.

    Args:
        model: the system.
        ports: of the block.
        count: number of inputs besides v0.
        centre: from which the sum is counted.
    """
    unit = next((v.unit for v in model.description.variables if v.name == ports.v), None)
    name = f"{ports.component}_drive"

    system = recipe_of(model).system
    summed = SumComponent(name=name, signs=(1.0,) * (count + 1), unit=unit)
    alone = replace(
        system,
        components=(_component(system, ports.component), summed),
        connections=(Connection(source=f"{name}.y", destination=ports.v),),
        inputs={f"v{k}": (f"{name}.u{k + 1}",) for k in range(count + 1)},
        outputs={"w": ports.w},
    )
    return _open_block(model, alone, bias={"v0": centre})


def _open_block(model: DescribedModel, system: SystemDescription, *, bias: Mapping[str, float]) -> DescribedModel:
    recipe = recipe_of(model).changed(system)
    return replace(
        recipe,
        bias={**recipe.bias, **{n: b for n, b in bias.items() if b}},
    ).open()


def _static(model: DescribedModel, ports: Ports, time: float, keep: ExitStack) -> Callable[[Floats], Floats] | None:
    """Return the block as a function where it has no memory."""
    component = _component(recipe_of(model).system, ports.component)
    if isinstance(component, FunctionComponent) and len(component.inputs) == len(component.outputs) == 1:
        return pointwise(component.function)
    if isinstance(component, BlockComponent) and component.block.has_characteristic():
        return component.block.static
    alone = keep.enter_context(only_block(model, ports))
    if any(v.variability == "discrete" for v in alone.outputs):
        return None
    point = keep.enter_context(alone.open_point(time=time))
    if point.memory or len(point.ticks(1, 1e300)) or _sees_states(point):
        return None
    function = _swept(alone, time, keep)
    return None if _remembers(function) else function


def _swept(alone: DescribedModel, time: float, keep: ExitStack) -> Callable[[Floats], Floats]:
    """Return the block as a function: a session goes through the inputs in compiled code, some 10 µs for each."""
    session = keep.enter_context(alone.open_session(start_time=time))
    step = _SWEEP * max(1.0, abs(time))

    def evaluate(v: Floats) -> Floats:
        times = np.asarray(session.time + step * np.arange(1, len(v) + 1), dtype=np.float64)
        signal = Table(tuple(times.tolist()), tuple(v.tolist()))
        record = session.advance(float(times[-1]), signals={"v": signal}, record=["w"], points=times)
        last = np.searchsorted(record.time, times, side="right") - 1
        return np.asarray(record.values["w"][last], dtype=np.float64)

    return evaluate


def _middle_line(
    model: DescribedModel, ports: Ports, time: float, keep: ExitStack
) -> Callable[[Floats], Floats] | None:
    """Return the mean of the outputs on the way up and down, of a block whose only memory is a hysteresis.

    A cycle goes up one branch and down the other, so this line is its characteristic as far as its mean goes.
    None: the block has states of its own or samples.
    """
    alone = keep.enter_context(only_block(model, ports))
    # What a standard block without samples keeps besides states is on which side of a hysteresis it is.
    ours = isinstance(_component(recipe_of(model).system, ports.component), BlockComponent)
    with alone.open_point(time=time) as point:
        if (point.memory and not ours) or len(point.ticks(1, 1e300)) or _sees_states(point):
            return None
    function = _swept(alone, time, keep)

    def middle(v: Floats) -> Floats:
        order = np.argsort(v)
        beyond = np.array([_BEYOND * max(1.0, float(np.abs(v).max(initial=0.0)))])
        up = v[order]
        result = function(np.concatenate([-beyond, up, beyond, up[::-1]]))
        mean = np.empty_like(up)
        mean[order] = 0.5 * (result[1 : len(up) + 1] + result[: len(up) + 1 : -1])
        return mean

    return middle


def _remembers(function: Callable[[Floats], Floats]) -> bool:
    """Whether the output depends on where the input comes from: a Boolean or Integer that the block keeps to itself."""
    sizes = np.geomspace(1e-6, 1e3, 46)
    up = np.concatenate([-sizes[::-1], sizes])
    result = function(np.concatenate([up, up[::-1]]))
    rising, falling = result[: len(up)], result[: len(up) - 1 : -1]
    return bool((np.abs(rising - falling) > _SAME * float(np.abs(result).max(initial=0.0))).any())


def _sees_states(point: ModelPoint) -> bool:
    """Whether the output depends on the block's states; those of a block without memory lead nowhere."""
    if not point.states:
        return False
    shifts = point.nominal * np.array([[-1.0], [-0.1], [0.1], [1.0]])
    for v in (-10.0, -1.0, -0.1, 0.0, 0.1, 1.0, 10.0):
        u = np.array([v])
        y = point.at(point.x0, u).y[0]
        if any(point.at(point.x0 + shift, u).y[0] != y for shift in shifts):
            return True
    return False
