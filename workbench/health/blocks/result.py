"""What is known of blocks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.core.records.record import RecordPart
from workbench.show.result import Result

__all__ = ["BlockKind", "BlockParameter", "BlocksResult"]


@dataclass(frozen=True)
class BlockParameter(RecordPart):
    """One parameter of a block.

    Attributes:
        name: as a system file has it.
        type: "number", "whole number", "true or false", "list of numbers", "rows of numbers", or "one of …".
        unit: unit of the value; empty: none, or that of an input or the output.
        default: as a system file would have it; empty: it has to be given, or follows from others.
        required: whether it has to be given.
        help: what it means.
    """

    name: str
    type: str
    unit: str
    default: str
    required: bool
    help: str


@dataclass(frozen=True)
class BlockKind(RecordPart):
    """One kind of block.

    Attributes:
        kind: its name in a system file.
        group: of the list.
        summary: what it is, in a sentence.
        details: what there is to know besides, in paragraphs.
        equations: what it computes, line by line.
        inputs: names of the inputs; of blocks that can have more of them those of the smallest number.
        output: name of the output.
        states: names of the continuous states.
        remembers: names of the discrete states.
        events: whether it makes events where its behaviour changes.
        linear: whether it is a linear system.
        describing_function: name of the standard block that has its describing function; empty: it is measured.
        sector: smallest sector [α, β] with α u² ≤ u y ≤ β u², with the default parameters; None: none.
        parameters: in the order of the list.
        example: a line of a system file.
    """

    kind: str
    group: str
    summary: str
    details: tuple[str, ...]
    equations: tuple[str, ...]
    inputs: tuple[str, ...]
    output: str
    states: tuple[str, ...]
    remembers: tuple[str, ...]
    events: bool
    linear: bool
    describing_function: str
    sector: tuple[float, float] | None
    parameters: tuple[BlockParameter, ...]
    example: str


@dataclass(frozen=True)
class BlocksResult(Result):
    """Blocks that a system can contain.

    Attributes:
        blocks: as they were asked for, or all.
        detailed: whether they were asked for by name.
    """

    _page = "workbench.health.blocks.page:blocks_page"

    blocks: tuple[BlockKind, ...]
    detailed: bool

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield one row for each parameter; a block without parameters has one row."""
        yield ("block", "parameter", "type", "unit", "default", "required", "help")
        for block in self.blocks:
            for p in block.parameters:
                yield (block.kind, p.name, p.type, p.unit, p.default, p.required, p.help)
            if not block.parameters:
                yield (block.kind, "", "", "", "", False, block.summary)
