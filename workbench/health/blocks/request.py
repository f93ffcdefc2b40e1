"""The list of blocks: what can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from workbench.requests.request import Request, Subject, function

if TYPE_CHECKING:
    from workbench.health.blocks.result import BlocksResult  # noqa: F401 - the record's type, below

__all__ = ["Blocks", "blocks"]


class Blocks(Request[Sequence[str], "BlocksResult"]):
    """List the blocks that a system can contain: equations, ports, parameters with units, defaults and ranges.

    With names of blocks each is shown in detail, with the line of a system file that makes it.

    Raises:
        InputError: an unknown block; near names are in the message.

    Examples:
        >>> (limiter,) = wb.blocks(["rate_limiter"]).blocks
        >>> print(limiter.equations[0])
        dy/dt = min(max((u − y) / lag, falling), rising)
    """

    command = "info"
    called = "blocks"
    case = "blocks"
    chosen_by = "--blocks"
    algorithm = "workbench.health.blocks.run:run"
    example = "workbench info --blocks rate_limiter"
    subject = Subject(
        name="kinds",
        type="Sequence[str]",
        help="Blocks to show in detail, as `rate_limiter`; by default all are listed.",
        metavar="BLOCK",
        words="Blocks to show in detail, as rate_limiter; by default all are listed.",
        several=True,
        optional=True,
    )
    counts = "blocks"
    unwritten = ("mat", "plot")


blocks = function(Blocks)
