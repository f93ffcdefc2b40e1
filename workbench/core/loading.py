"""How a model is opened: the options that every command and `load` have."""

from __future__ import annotations

from dataclasses import KW_ONLY

from workbench.core.forms import Settings, Values
from workbench.core.option import Options, documented, option

__all__ = ["INTERFACES", "Loading"]

INTERFACES = ("me", "cs")


class Loading(Options):
    """Load an FMU or a system.

    Returns:
        The model; close it, or use it in a `with` block, to remove its temporary folder.

    Raises:
        InputError: no such file, interface, solver, variable; a value out of range; a system whose parts do not fit.
        FmuError: a file is no usable FMU, or has no binary for this platform.
        KernelMissingError: the compiled kernel is not installed, or is of another version.
    """

    group = "Model"

    interface: str = option(
        "Model exchange or co-simulation; auto takes model exchange where the FMU offers it.",
        choices=("auto", *INTERFACES),
        default="auto",
    )
    solver: str = option(
        "Integration of model exchange: Kutta-Merson, Gear (stiff), none (no states); co-simulation brings its own.",
        choices=("auto", "vkm", "gear", "none", "fmu"),
        default="auto",
    )
    _: KW_ONLY
    step: float | None = option(
        "Communication step of co-simulation, output interval of a time history by model exchange; else the default "
        "experiment's.",
        unit="s",
        metavar="S",
        positive=True,
        default=None,
    )
    tolerance: float | None = option(
        "Relative tolerance of the integration; else the default experiment's, or 1e-6 (nfr, excite: 1e-8).",
        positive=True,
        below=1.0,
        default=None,
    )
    start: float | None = option(
        "Time at which runs begin; else the default experiment's, or 0.",
        unit="s",
        metavar="T",
        finite=True,
        default=None,
    )
    start_values: Settings = option("Parameter or start value; repeatable.", flag="--set", default_factory=dict)
    bias: Values = option("Constant added to an input, forced or not; repeatable.", default_factory=dict)
    hold_inputs: bool = option(
        "Co-simulation: hold inputs between communication points, as most masters do, also where the FMU takes their "
        "slopes. For comparisons with such masters; less accurate at the same step.",
        default=False,
        python=True,
    )


Loading.__doc__ = documented(Loading)
