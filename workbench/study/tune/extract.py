"""The linear model of an analysis with some blocks taken out, made in a worker process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from workbench.core.machine.blas import one_thread
from workbench.core.records.option import recast
from workbench.core.values.arrays import Complex
from workbench.core.values.linear import Linear
from workbench.errors import InputError, WorkbenchError
from workbench.jobs.job import Job
from workbench.loops.loop.request import Loop, openings
from workbench.loops.loop.tunable import ports_of_blocks, tunable_loop
from workbench.loops.opened_system import linear_between, system_of, without_block
from workbench.model import Model
from workbench.model.operating_point import find_point
from workbench.point.lin.linearise import linearise
from workbench.point.lin.request import Lin
from workbench.point.lin.result import LinResult
from workbench.point.trim.request import trim
from workbench.study.commands import command
from workbench.system.model import SystemModel

__all__ = ["ExtractJob", "Extracted", "extract"]


@dataclass(frozen=True, eq=False)
class Extracted:
    """A linear model without some blocks.

    Attributes:
        rest: its last inputs are what the blocks give, its last outputs what they take; None: see `reason`.
        blocks: names of those that were taken out.
        poles: of the model with them; empty: not known.
        reason: why there is none; empty: there is one.
    """

    rest: Linear | None
    blocks: tuple[str, ...] = ()
    poles: Complex | tuple[complex, ...] = ()
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class ExtractJob:
    """What is to be linearised.

    Attributes:
        number: for whoever sent it.
        command: name of the analysis's request, `lin` or `loop`.
        subject: the model.
        options: of the command, by its keys.
        folder: in which it runs.
        blocks: components that are taken out, those that can be.
    """

    number: int
    command: str
    subject: str
    options: Mapping[str, Any]
    folder: Path
    blocks: Sequence[str]


def extract(_model: None, job: ExtractJob) -> Iterator[Extracted]:
    """Linearise and yield what was found, once."""
    try:
        with chdir(job.folder), one_thread():
            request, _, loading = command(job.command).asked(job.options)
            with request.opened(job.subject, loading) as (model, _notes):
                found = _of_loop(model, request, job) if isinstance(request, Loop) else _of_lin(model, request, job)
    except WorkbenchError as error:
        found = Extracted(None, reason=str(error))
    yield found


def _of_loop(model: Model, request: Loop, job: ExtractJob) -> Extracted:
    at = trim(model, in_process=True).operating_point if request.trim else request.at
    point, _ = find_point(model, at)
    found = tunable_loop(model, openings(request.open)[0], point=point, in_process=True, only=job.blocks)
    return Extracted(_plain(found.rest), found.blocks)


def _of_lin(model: Model, request: Any, job: ExtractJob) -> Extracted:  # noqa: ANN401 - of the command
    whole = linearise(model, recast(Lin, request), Job())
    if whole.dt > 0.0 or whole.delayed is not None:
        raise InputError("the linear model is sampled, or has delays")
    system = system_of(model, "tuning needs")
    ports = [p for p in ports_of_blocks(model) if p.component in job.blocks] if isinstance(model, SystemModel) else []
    if not ports or not isinstance(model, SystemModel):
        return Extracted(_plain(whole), (), whole.poles)
    point = whole.operating_point
    outputs = {name: system.outputs.get(name, name) for name in whole.output_names}
    outputs |= {f"tuned.{p.component}.u": p.v for p in ports}
    with model.open_at(time=point.time, values=point.values) as session:
        given = {f"tuned.{p.component}": session.values([p.w])[p.w] for p in ports}
    for p in ports:
        system = without_block(model, system, p, f"tuned.{p.component}", outputs)
    kept = {n: v for n, v in model.recipe.bias.items() if n in system.inputs and n not in point.u}
    inputs: dict[str, float | None] = {**dict.fromkeys(whole.input_names), **given}
    with replace(model.recipe.changed(system), bias={**kept, **given}).open() as opened:
        rest = linear_between(
            opened, inputs, list(outputs), x={**point.x, **point.discrete}, u=point.u, time=point.time, in_process=True
        )
    return Extracted(_plain(rest), tuple(p.component for p in ports), whole.poles)


def _plain(found: LinResult) -> Linear:
    if found.dt > 0.0 or found.delayed is not None:
        raise InputError("the linear model is sampled, or has delays")
    return Linear(found.A, found.B, found.C, found.D, input_names=found.input_names, output_names=found.output_names)
