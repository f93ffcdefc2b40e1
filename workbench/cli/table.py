"""Tables of results in the terminal."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.fmi.variable import Variable

__all__ = ["table_of", "variable_dict", "variable_table"]


def table_of(title: str, *headings: str, left: Collection[str] = ()) -> Table:
    """Return an empty table with right-aligned columns.

    Args:
        title: above it.
        headings: of the columns, with units.
        left: headings of the columns that hold words.
    """
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD)
    for heading in headings:
        table.add_column(escape(heading), justify="left" if heading in left else "right")
    return table


def variable_dict(variable: Variable) -> dict[str, Any]:
    """Return what the JSON says of a variable."""
    return {
        "name": variable.name,
        "type": variable.type,
        "unit": variable.unit,
        "start": variable.start,
        "description": variable.description,
    }


def variable_table(title: str, variables: tuple[Variable, ...]) -> Table:
    """Return a table of variables for people."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=f"{title} ({len(variables)})", title_justify="left", box=box.SIMPLE_HEAD)
    for heading in ("name", "type", "unit", "start", "description"):
        table.add_column(heading, justify="right" if heading == "start" else "left", overflow="fold")
    for v in variables:
        start = "" if v.start is None else format(v.start, "g") if isinstance(v.start, float) else str(v.start)
        table.add_row(*(escape(x) for x in (v.name, v.type, v.unit or "", start, v.description or "")))
    return table
