"""`workbench delays`: what the master of a system with co-simulation components costs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from workbench.cli.options import (
    At,
    Interface,
    Json,
    ModelName,
    Report,
    Set,
    Solver,
    Start,
    Tolerance,
    open_named,
    pairs,
)
from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.cli.output import Output
    from workbench.model.described import DescribedModel

__all__ = ["delays"]


def delays(
    model: ModelName,
    stop: Annotated[
        float | None, typer.Option("--stop", metavar="T", help="How long the runs are [s]; else the experiment's end.")
    ] = None,
    input: Annotated[
        list[str] | None, typer.Option("--input", metavar="NAME=SIGNAL", help="Force an input; repeatable.")
    ] = None,
    step: Annotated[
        float | None, typer.Option("--step", metavar="S", help="Communication step [s]; else the one a run would use.")
    ] = None,
    frequency: Annotated[
        float | None, typer.Option("--freq", metavar="F", help="Tell the phase at F [Hz]; else at the crossovers.")
    ] = None,
    at: At = None,
    interface: Interface = "auto",
    solver: Solver = "auto",
    tolerance: Tolerance = None,
    start: Start = None,
    set_: Set = None,
    json_path: Json = None,
    report: Report = None,
) -> int:
    """Say which connections of a system carry a delay, what phase that costs, and how far the answer is off.

    For systems with co-simulation components. The system runs three times, with the step, half and a quarter of it.

    Example: `workbench delays drive.toml --stop 5 --input reference=1 --step 0.01`
    """
    from workbench.cli.output import Output
    from workbench.signals import parse_signal
    from workbench.system.master.model import MasterModel

    out = Output("delays", json_path=json_path, report=report)
    inputs = {name: parse_signal(text) for name, text in pairs("--input", input).items()}
    loaded = open_named(
        model, interface=interface, solver=solver, step=None, tolerance=tolerance, start=start, set_=set_, bias=None
    )
    with loaded:
        if not isinstance(loaded, MasterModel):
            if loaded.interface == "me":
                _none(loaded, out)
                return 0
            raise InputError(f"{loaded.name}: one co-simulation FMU has no connections; connect it to a system first")
        result = loaded.delays(stop=stop, inputs=inputs, at=at, step=step, frequency=frequency)
        for line in result.lines():
            out.console.print(line, markup=False, soft_wrap=True)
        envelope = {"model": loaded.name, "interface": loaded.interface, "solver": loaded.solver}
        out.write({**envelope, **result.to_dict()}, report=result)
    return 0


def _none(model: DescribedModel, out: Output) -> None:
    """Say that a system has no master."""
    from workbench.cli.notes import note
    from workbench.origin import Origin
    from workbench.origin.models import facts_of
    from workbench.report.delays import no_delays_page

    words = "all parts are of model exchange: one set of equations, no connection carries a delay"
    note(words)
    out.write(
        {"model": model.name, "interface": model.interface, "connections": [], "loops": []},
        page=lambda: no_delays_page(model.name, words),
        origin=Origin(models=(facts_of(model),)),
    )
