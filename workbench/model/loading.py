"""How a model is opened: the options that every command and `load` have."""

from __future__ import annotations

from dataclasses import KW_ONLY

from workbench.core.records.forms import Numbers, Quantities, Starts
from workbench.core.records.option import Options, documented, option

__all__ = ["DEFAULT_TOLERANCE", "INTERFACES", "Loading"]

INTERFACES = ("me", "cs")
DEFAULT_TOLERANCE = 1e-6  # relative, of the integrator, where neither user nor FMU name one


class Loading(Options):
    """Load an FMU or a system.

    Returns:
        The model; close it, or use it in a `with` block, to remove its temporary folder.

    Raises:
        InputError: no such file, interface, solver, variable; a value out of range; a system whose parts do not fit.
        FmuError: a file is not a usable FMU, or has no binary for this platform.
        KernelMissingError: the compiled kernel is not installed, or is of another version.

    Examples:
        >>> with wb.load("fmu:Rudder@3") as rudder:
        ...     print(rudder.interface, rudder.inputs[0].name, rudder.outputs[0].name)
        me delC del
    """

    group = "Model"

    interface: str = option(
        "Interface of the FMU, model exchange or co-simulation; auto prefers model exchange.",
        choices=("auto", *INTERFACES),
        default="auto",
    )
    solver: str = option(
        "Integrator for model exchange: vkm (Kutta-Merson), gear (stiff models) or none (no states). A co-simulation "
        "FMU has its own, fmu.",
        choices=("auto", "vkm", "gear", "none", "fmu"),
        default="auto",
    )
    _: KW_ONLY
    step: float | None = option(
        "Communication step of co-simulation; by default the analysis chooses it, from the FMU's default experiment "
        "where that names one. With model exchange it only sets the interval at which a time history is recorded.",
        unit="s",
        metavar="S",
        positive=True,
        default=None,
    )
    tolerance: float | None = option(
        "Relative tolerance of the integrator; by default that of the FMU's default experiment, or 1e-6 (commands "
        "nfr, excite and loop: 1e-8).",
        metavar="TOL",
        positive=True,
        below=1.0,
        default=None,
    )
    start: float | None = option(
        "Time at which runs begin; by default that of the FMU's default experiment, or 0.",
        unit="s",
        metavar="T",
        default=None,
    )
    start_values: Starts = option(
        "Value of a parameter, or start value of a variable; of a whole array as NAME=[1,2]; an item of an enumeration "
        "by its name; with a unit, as in T=20degC, converted to that of the variable. A structural parameter changes "
        "the sizes of arrays.",
        flag="--set",
        default_factory=dict,
    )
    bias: Quantities = option(
        "Constant added to an input, whether it is forced or not; with a unit, as in elevator=2deg, it is converted to "
        "that of the input.",
        default_factory=dict,
    )
    periods: Numbers | None = option(
        "Sample periods of the model. Default: those declared by components, blocks and clocks; for an FMU, those "
        "found from its time events.",
        unit="s",
        metavar="S,..",
        positive=True,
        default=None,
    )
    hold_inputs: bool = option(
        "Co-simulation: hold inputs over each communication step at their value at its start, as most masters do, even "
        "if the FMU accepts their slopes. For comparisons with such masters; less accurate at the same step.",
        default=False,
        python=True,
    )


Loading.__doc__ = documented(Loading)
