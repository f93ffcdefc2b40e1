"""Load a model from a file: a system where the file describes one, else one FMU."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from workbench.errors import InputError
from workbench.fmi.variable import Value
from workbench.model.described import DescribedModel
from workbench.model.load import load as load_fmu
from workbench.system.read import is_system_file, read_system

__all__ = ["load"]


def load(
    path: str | Path,
    interface: str = "auto",
    solver: str = "auto",
    *,
    step: float | None = None,
    tolerance: float | None = None,
    start: float | None = None,
    start_values: Mapping[str, Value] | None = None,
    bias: Mapping[str, float] | None = None,
    hold_inputs: bool = False,
    driver: str = "auto",
) -> DescribedModel:
    """Load an FMU or a system.

    Args:
        path: an `.fmu` file, the folder of an unpacked FMU, `fmu:NAME` or `fmu:NAME@3`; or a system: a `.toml`, `.ssp`
            or `.ssd` file, the folder of an unpacked `.ssp`, or `system:NAME`.
        interface: "me", "cs", or "auto", which takes model exchange where both are offered. The components of a system
            name their own.
        solver: "vkm", "gear", or "auto"; co-simulation FMUs bring their own.
        step: communication step of co-simulation [s]; None: the FMU's default experiment, else
            derived from the signals.
        tolerance: relative tolerance of the integration; None: the default experiment's, else 1e-6.
        start: time at which sessions begin [s]; None: the default experiment's, else 0.
        start_values: parameters and start values to set, by name; in a system "component.variable".
        bias: constants added to inputs, by name, whether forced or not.
        hold_inputs: co-simulation: hold inputs between communication points, as most masters do, also where the FMU
            takes their slopes. For comparisons with such masters; less accurate at the same step.
        driver: what advances sessions: "compiled", "python" (the readable reference, about 20 times slower), or
            "auto", which takes the compiled one where it is installed.

    Returns:
        The model; close it, or use it in a `with` block, to remove its temporary folder.

    Raises:
        InputError: no such file, interface, solver, variable; a value out of range; a system whose parts do not fit.
        FmuError: a file is no usable FMU, or has no binary for this platform.
    """
    if is_system_file(path):
        from workbench.system.connect import open_description  # noqa: PLC0415  loading a single FMU stays quick

        if hold_inputs:
            raise InputError(f"{path}: hold_inputs is for one co-simulation FMU, not for a system")
        return open_description(
            read_system(path),
            interface=interface,
            solver=solver,
            step=step,
            tolerance=tolerance,
            start=start,
            start_values=start_values,
            bias=bias,
            driver=driver,
        )
    return load_fmu(
        path,
        interface,
        solver,
        step=step,
        tolerance=tolerance,
        start=start,
        start_values=start_values,
        bias=bias,
        hold_inputs=hold_inputs,
        driver=driver,
    )
