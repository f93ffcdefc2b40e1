"""The page of the blocks that a system can contain."""

from __future__ import annotations

from workbench.health.blocks.result import BlockKind, BlocksResult
from workbench.show.page import Page, PageTable, Section
from workbench.show.tables import counted

__all__ = ["blocks_page"]


def blocks_page(result: BlocksResult) -> Page:
    """Return the page of blocks: one table for each group, or one section for each block."""
    groups = dict.fromkeys(b.group for b in result.blocks)
    listed = [_listed(group, [b for b in result.blocks if b.group == group]) for group in groups]
    lead = 'In a system file: NAME = {block = KIND, parameters}; a gain is NAME = 2.0, a sum NAME = {sum = "+-"}. '
    return Page(
        title=", ".join(b.kind for b in result.blocks) if result.detailed else "Blocks",
        lead=lead + ("" if result.detailed else "`workbench info --blocks KIND` shows one with its parameters."),
        facts={},
        sections=[_detail(b) for b in result.blocks] if result.detailed else listed,
        kind="info",
    )


def _listed(group: str, blocks: list[BlockKind]) -> Section:
    rows = [(b.kind, ", ".join(b.inputs), ", ".join(p.name for p in b.parameters), b.summary) for b in blocks]
    headings = ("block", "inputs", "parameters", "what it does")
    return Section(group.capitalize(), tables=[PageTable(headings, rows, right=())])


def _detail(b: BlockKind) -> Section:
    states = [*b.states, *(f"{name} (discrete)" for name in b.remembers)]
    known = []
    if b.describing_function:
        known.append(f"describing function in closed form: {b.describing_function}")
    if b.sector is not None:
        known.append(f"sector with the parameters of the example: {b.sector[0]:g} to {b.sector[1]:g}")
    if b.events:
        known.append("its changes are events, located exactly")
    facts = [
        *b.equations,
        f"inputs: {', '.join(b.inputs)}; output: {b.output}",
        f"states: {', '.join(states) or 'none'}",
        *known,
        f"in a system file: {b.example}",
    ]
    rows = [
        (p.name, p.type, p.unit or "–", p.default or ("required" if p.required else "–"), p.help) for p in b.parameters
    ]
    headings = ("parameter", "type", "unit", "default", "meaning")
    return Section(
        b.kind,
        paragraphs=[b.summary, *b.details],
        items=facts,
        tables=[PageTable(headings, rows, right=(), title=counted(len(rows), "parameter"))] if rows else [],
    )
