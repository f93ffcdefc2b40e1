"""Connect models to a system in Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from workbench.core.records.option import values_of
from workbench.core.values.linear import Linear
from workbench.errors import InputError, one_line, suggest
from workbench.fmi.archive import locate
from workbench.fmi.bundled import is_bundled
from workbench.fmi.variable import Value
from workbench.model.described_model import DescribedModel, LoadRecipe
from workbench.model.load import FmuModel
from workbench.model.loading import Loading
from workbench.system.description import (
    Component,
    Connection,
    FmuComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    MasterOptions,
    SystemDescription,
)
from workbench.system.model import SystemModel
from workbench.system.nested import Inner, embed
from workbench.system.openable import OpenableSystem

__all__ = ["connect", "open_description"]

Options = Mapping[str, Any]
Wanted = Connection | tuple[str, str] | tuple[str, str, Options]
_OPTIONS = ("gain", "offset", "unit", "closes_at", "convert")


@runtime_checkable
class _StateSpace(Protocol):
    """What is used of `control.StateSpace`."""

    A: Any
    B: Any
    C: Any
    D: Any
    dt: Any


def connect(
    components: Mapping[str, object],
    connections: Sequence[Wanted] = (),
    inputs: Mapping[str, str | Sequence[str]] | Sequence[str] = (),
    outputs: Mapping[str, str] | Sequence[str] = (),
    *,
    name: str = "system",
    solver: str = "auto",
    step: float | None = None,
    tolerance: float | None = None,
    start: float | None = None,
    periods: Sequence[float] | None = None,
    start_values: Mapping[str, Value] | None = None,
    bias: Mapping[str, float] | None = None,
    order: str = "auto",
    hold_inputs: bool = False,
    extrapolation: int = 1,
    step_tolerance: float | None = None,
) -> DescribedModel:
    """Connect models; the system is a model again.

    All model exchange components together are one ordinary differential equation with one solver: no connection
    carries a delay. Values that depend on each other directly (algebraic loops) are solved for by Newton's method.

    Args:
        components: name → a path or `fmu:NAME`, a loaded FMU or system (it may be closed afterwards), a
            `control.StateSpace` or `TransferFunction`, a number (a gain with input `u` and output `y`), a static
            function y = f(u) with `u` of shape (1,) and one output `y`, or a component of
            `workbench.system.description` for all that these cannot say.
        connections: ("plant.w", "controller.w"), or with options ("plant.w", "controller.w", {"gain": -1.0}):
            gain, offset, unit (in which the value is handed over), closes_at [s] (0 before that time).
        inputs: system input → component input, or several of them; names alone ("controller.w_ref") are inputs of
            that name.
        outputs: system output → component variable; names alone as for inputs.
        name: name of the system.
        solver: "vkm", "gear", or "auto".
        step: communication step of co-simulation [s]; model exchange needs none.
        tolerance: relative tolerance of the integration; None: 1e-6.
        start: time at which sessions begin [s]; None: 0.
        periods: sample periods of the system [s]; None: those that its parts declare or show.
        start_values: start values by full name, "component.variable".
        bias: constants added to the system's inputs.
        order: order of systems with co-simulation components: "gauss-seidel" (one after the other), "jacobi" (side by
            side), or "auto".
        hold_inputs: in such systems, hold inputs between communication points, as simple masters do.
        extrapolation: in such systems, order of the polynomial by which a value goes on over a step whose source is
            stepped later: 0 (it stands still), 1 or 2. Order 2 is for smooth signals, and for FMUs that take slopes of
            their inputs.
        step_tolerance: in such systems, tolerance of one communication step, relative to the largest magnitude that
            each connected value and output has had; None: 100 times `tolerance`. Not together with `step`.

    Returns:
        The model; close it, or use it in a `with` block.

    Raises:
        InputError: unknown names, types or units that do not fit, two sources for one input.
        FmuError: an FMU cannot be used.

    Examples:
        Feedback with the gain 3 moves the pole of 1/(s + 1) from -1 to -4.

        >>> system = wb.connect(
        ...     {"lag": "fmu:FirstOrderLag", "gain": 3.0, "error": wb.SumComponent(name="error", signs=(1, -1))},
        ...     [("lag.y", "error.u2"), ("error.y", "gain.u"), ("gain.y", "lag.u")],
        ...     inputs={"reference": "error.u1"},
        ...     outputs=["lag.y"],
        ... )
        >>> with system:
        ...     print(wb.lin(system).A)
        [[-4.]]
    """
    parts = [_part(n, value) for n, value in components.items()]
    master = MasterOptions(
        order=order, extrapolation=extrapolation, step_tolerance=step_tolerance, hold_inputs=hold_inputs
    )
    starts = {**_own_starts(components), **(start_values or {})}
    loading = Loading(
        solver=solver,
        step=step,
        tolerance=tolerance,
        start=start,
        periods=periods,
        start_values=starts,
        bias=bias or {},
    )
    return open_description(embed(_described(name, connections, inputs, outputs, master), parts), loading)


def _described(
    name: str,
    connections: Sequence[Wanted],
    inputs: Mapping[str, str | Sequence[str]] | Sequence[str],
    outputs: Mapping[str, str] | Sequence[str],
    master: MasterOptions,
) -> SystemDescription:
    """Return the system without its components."""
    return SystemDescription(
        name=name,
        components=(),
        connections=tuple(_connection(c) for c in _pairs(connections)),
        inputs=_inputs(inputs),
        outputs=_outputs(outputs),
        master=master,
    )


def _own_starts(components: Mapping[str, object]) -> dict[str, Value]:
    """Return what the systems among the components were loaded with, by full names."""
    return {
        f"{name}.{inner}": value
        for name, model in components.items()
        if isinstance(model, SystemModel)
        for inner, value in model.recipe.start_values.items()
    }


def open_description(description: SystemDescription, loading: Loading | None = None) -> DescribedModel:
    """Open a system as it is written down.

    Args:
        description: the system.
        loading: how; None: all at its default.

    Raises:
        InputError, FmuError: see `connect`.
    """
    source = description.source or description.name
    loading = replace(loading or Loading(), hold_inputs=description.master.hold_inputs)
    return OpenableSystem(source=source, system=description, **values_of(loading)).open()


# -- components -------------------------------------------------------------------------------


def _part(name: str, value: object) -> Component | Inner:
    """Return what a user's value stands for, a system among them."""
    if not isinstance(value, SystemModel):
        return _component(name, value)
    _refuse_bias(name, value.recipe)
    return Inner(name, value.recipe.system)


def _refuse_bias(name: str, recipe: LoadRecipe) -> None:
    """Raise an InputError if a loaded model has a bias: its inputs are connected now."""
    if recipe.bias:
        names = ", ".join(recipe.bias)
        raise InputError(f"component {name}: it was loaded with a bias on {names}; give the bias to the system")


def _component(name: str, value: object) -> Component:
    """Return what a user's value stands for."""
    if isinstance(value, Component):
        if value.name != name:
            raise InputError(f"component {name}: the object is named {value.name}; use the same name for both")
        return value
    for kinds, make in _KINDS:
        if isinstance(value, kinds):
            return make(name, value)
    linear = _linear(name, value)
    if linear is not None:
        return linear
    if callable(value):
        return FunctionComponent(name=name, function=value)
    raise InputError(
        f"component {name}: {type(value).__name__} is not a component; give a path, fmu:NAME, a loaded FMU, a "
        "control.StateSpace or TransferFunction, a number, or a function"
    )


def _file(name: str, value: object) -> Component:
    text = str(value)
    return FmuComponent(name=name, file=text if is_bundled(text) else str(locate(text).absolute()))


def _loaded(name: str, value: object) -> Component:
    if not isinstance(value, FmuModel):
        raise InputError(f"component {name}: only loaded FMUs can be connected; connect the parts of systems instead")
    recipe = value.recipe
    _refuse_bias(name, recipe)
    return FmuComponent(
        name=name,
        file=recipe.file or recipe.source,
        interface=value.interface,
        set=recipe.start_values,
        step=recipe.step,
        solver=recipe.solver,
        called=recipe.source if recipe.file else "",
    )


def _gain(name: str, value: object) -> Component:
    gain = float(value)  # type: ignore[arg-type]  # it is a number
    if not np.isfinite(gain):
        raise InputError(f"component {name}: a gain must be a finite number, not {gain}")
    return GainComponent(name=name, gain=gain)


_KINDS: Sequence[tuple[type | tuple[type, ...], Callable[[str, object], Component]]] = (
    ((str, Path), _file),
    (DescribedModel, _loaded),
    (Real, _gain),
)


def _linear(name: str, value: object) -> LinearComponent | None:
    """Return a linear system of python-control as a component; None if `value` is none."""
    if type(value).__module__.partition(".")[0] != "control":
        return None
    if not isinstance(value, _StateSpace):
        from control import ss  # noqa: PLC0415 - takes long to load, and only transfer functions need it

        try:
            value = ss(value)
        except Exception as error:  # noqa: BLE001  python-control raises many kinds
            raise InputError(f"component {name}: no state-space form: {one_line(str(error))}") from None
        if not isinstance(value, _StateSpace):
            raise InputError(f"component {name}: this kind of linear system cannot be connected; give a StateSpace")
    try:
        result = Linear.from_state_space(value)
    except InputError as error:
        raise InputError(f"component {name}: {error}") from None
    A, B, C, D = result.A, result.B, result.C, result.D
    if not all(np.isfinite(x).all() for x in (A, B, C, D)):
        raise InputError(f"component {name}: a matrix has entries that are not finite numbers")
    return LinearComponent(
        A, B, C, D, name=name, dt=result.dt, input_names=_labels(result.input_names, "u", B.shape[1]),
        output_names=_labels(result.output_names, "y", len(C)), state_names=_labels(result.state_names, "x", len(A)),
        x0=np.zeros(len(A)),
    )  # fmt: skip


def _labels(labels: tuple[str, ...], letter: str, count: int) -> tuple[str, ...]:
    """Return python-control's names; its own defaults, "u[0]", become "u" or "u1" and so on."""
    if len(labels) == count and labels != tuple(f"{letter}[{i}]" for i in range(count)):
        return labels
    return (letter,) if count == 1 else tuple(f"{letter}{i + 1}" for i in range(count))


# -- connections ------------------------------------------------------------------------------


def _pairs(connections: Sequence[Wanted]) -> Sequence[Wanted]:
    given: object = connections
    if isinstance(given, Mapping | str):
        raise InputError('connections: give pairs (source, destination), as in [("plant.y", "controller.u")]')
    return connections


def _connection(wanted: Wanted) -> Connection:
    if isinstance(wanted, Connection):
        return wanted
    given: object = wanted
    pair = isinstance(given, Sequence) and not isinstance(given, str) and len(given) in (2, 3)
    if not pair or not all(isinstance(name, str) for name in wanted[:2]):
        raise InputError(
            f"connection {given!r}: give pairs (source, destination), as in "
            '[("plant.y", "controller.u")], or these with options'
        )
    options: Options = wanted[2] if len(wanted) == 3 else {}
    if not isinstance(options, Mapping):
        raise InputError(f'connection {wanted[0]} → {wanted[1]}: options are a dictionary, as in {{"gain": -1.0}}')
    for key in options:
        if key not in _OPTIONS:
            raise InputError(
                f"connection {wanted[0]} → {wanted[1]}: '{key}' is not an option; {suggest(key, _OPTIONS)}"
            )
    return Connection(source=wanted[0], destination=wanted[1], **options)


def _inputs(wanted: Mapping[str, str | Sequence[str]] | Sequence[str]) -> dict[str, tuple[str, ...]]:
    if not isinstance(wanted, Mapping):
        return {name: (name,) for name in wanted}
    return {name: (ends,) if isinstance(ends, str) else tuple(ends) for name, ends in wanted.items()}


def _outputs(wanted: Mapping[str, str] | Sequence[str]) -> dict[str, str]:
    return dict(wanted) if isinstance(wanted, Mapping) else {name: name for name in wanted}
