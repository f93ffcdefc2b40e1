"""Tables of results in the terminal."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["table_of"]


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
