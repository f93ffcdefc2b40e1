"""What `workbench info` says of a system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from workbench.cli.output import Output
from workbench.cli.table import variable_dict, variable_table

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.model.described import DescribedModel
    from workbench.report import Page
    from workbench.system.description import Component, Connection, SystemDescription

__all__ = ["info_system"]


def info_system(path: str, out: Output) -> None:
    """Show components, connections and the variables of the whole.

    Args:
        path: of the system.
        out: where it goes.

    Raises:
        InputError: the system cannot be read or its parts do not fit.
        FmuError: a component cannot be loaded.
    """
    from workbench.cli.notes import note
    from workbench.origin import Origin
    from workbench.origin.models import facts_of
    from workbench.system.load import load
    from workbench.system.read import read_system

    system = read_system(path)
    with load(path) as model:
        for text in model.notes:
            note(text)
        out.console.print(f"{system.name} ({model.interface}, {model.solver}): a system", markup=False)
        out.console.print(_components(system))
        out.console.print(_connections(system))
        groups = {"inputs": model.inputs, "outputs": model.outputs, "states": model.states}
        for title, variables in groups.items():
            if variables:
                out.console.print(variable_table(title, tuple(variables)))
        told = _to_dict(system, model)
        out.write(told, page=lambda: _page(told), origin=Origin(models=(facts_of(model),)))


def _page(told: dict[str, object]) -> Page:
    from workbench.report.info import system_page

    return system_page(told)


def _what(component: Component) -> str:
    """A component in a few words."""
    from workbench.system.description import (
        FmuComponent,
        FunctionComponent,
        GainComponent,
        LinearComponent,
        SumComponent,
    )

    match component:
        case FmuComponent():
            return component.file
        case LinearComponent():
            kind = f"sampled at {component.dt:g} s" if component.dt > 0.0 else "continuous"
            return f"linear, {len(component.A)} states, {kind}"
        case GainComponent():
            return f"gain {component.gain:g}"
        case SumComponent():
            return f"sum {''.join('+' if s > 0 else '-' for s in component.signs)}"
        case FunctionComponent():
            return "Python function"


def _components(system: SystemDescription) -> Table:
    return _rows(
        f"components ({len(system.components)})", ("name", "what"), [(c.name, _what(c)) for c in system.components]
    )


def _connections(system: SystemDescription) -> Table:
    rows = [(c.destination, c.source, _how(c)) for c in system.connections]
    return _rows(f"connections ({len(rows)})", ("destination", "source", "by"), rows)


def _how(connection: Connection) -> str:
    words = [f"gain {connection.gain:g}"] if connection.gain != 1.0 else []
    words += [f"offset {connection.offset:g}"] if connection.offset else []
    words += [f"in {connection.unit}"] if connection.unit else []
    words += [f"closes at {connection.closes_at:g} s"] if connection.closes_at is not None else []
    return ", ".join(words)


def _rows(title: str, headings: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> Table:
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    return table


def _to_dict(system: SystemDescription, model: DescribedModel) -> dict[str, object]:
    groups = {"inputs": model.inputs, "outputs": model.outputs, "parameters": model.parameters, "states": model.states}
    return {
        "model": system.name,
        "interfaces": [model.interface],
        "solver": model.solver,
        "runnable": True,
        "components": [{"name": c.name, "what": _what(c)} for c in system.components],
        "connections": [
            {"destination": c.destination, "source": c.source, "gain": c.gain, "offset": c.offset, "unit": c.unit,
             "closes_at": c.closes_at}
            for c in system.connections
        ],
        **{name: [variable_dict(v) for v in group] for name, group in groups.items()},
        "notes": list(model.notes),
    }  # fmt: skip
