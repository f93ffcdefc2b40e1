"""The list of blocks, from their table."""

from __future__ import annotations

import inspect
from collections.abc import Sequence

from workbench.core.records.option import DeclaredOption, options_of
from workbench.core.records.parsing import toml_value
from workbench.errors import InputError, suggest
from workbench.health.blocks.request import Blocks
from workbench.health.blocks.result import BlockKind, BlockParameter, BlocksResult
from workbench.jobs.job import Job
from workbench.system.block_table.base import Block
from workbench.system.block_table.registry import BLOCKS, entry_of, sample_of

__all__ = ["run"]

_SHORT = {"gain": "2.0", "sum": '{sum = "+-"}'}  # components that are no blocks


def run(kinds: Sequence[str], request: Blocks, job: Job) -> BlocksResult:
    """Return what is known of blocks.

    Args:
        kinds: names; none: all.
        request: the request.
        job: is told.
    """
    del request  # it has no options
    for kind in kinds:
        if kind in _SHORT:
            raise InputError(f"{kind} is no block; a system file has it as NAME = {_SHORT[kind]}")
        if kind not in BLOCKS:
            raise InputError(f"block '{kind}' is unknown; {suggest(kind, BLOCKS)}")
    described = tuple(_kind(BLOCKS[kind]) for kind in (kinds or BLOCKS))
    result = BlocksResult(described, detailed=bool(kinds))
    job.partial = lambda: result
    job.done("blocks", len(described), len(described))
    return result


def _kind(cls: type[Block]) -> BlockKind:
    block = sample_of(cls.kind)
    summary, *details = inspect.cleandoc(cls.__doc__ or "").split("\n\n")
    described = block.described()
    return BlockKind(
        kind=cls.kind,
        group=cls.group,
        summary=" ".join(summary.split()),
        details=tuple(" ".join(text.split()) for text in details),
        equations=tuple(cls.equations.split("\n")),
        inputs=block.inputs,
        output="y",
        states=block.states,
        remembers=tuple(block.remembers),
        events=block.indicators > 0 or cls.number == "delay" or getattr(block.matrices(), "dt", 0.0) > 0.0,
        linear=block.is_linear,
        describing_function="" if described is None else described.name,
        sector=block.sector(),
        parameters=tuple(map(_parameter, options_of(cls))),
        example=f"{cls.kind} = {entry_of(cls.kind)}",
    )


def _parameter(declared: DeclaredOption) -> BlockParameter:
    default = declared.default
    return BlockParameter(
        name=declared.name,
        type=f"one of {', '.join(declared.choices)}" if declared.choices else _type(declared),
        unit=declared.option.unit,
        default="" if default is None or declared.required else toml_value(default),
        required=declared.required,
        help=declared.option.help,
    )


def _type(declared: DeclaredOption) -> str:
    if declared.form is not None and declared.form.layout.kind == "list":
        return "rows of numbers" if "array" in declared.form.items else "list of numbers"
    return {bool: "true or false", int: "whole number"}.get(declared.type, "number")
