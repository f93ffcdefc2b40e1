"""The controller alone: the blocks with the tuned parameters, sampled, as a Modelica model."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from workbench.core.machine.files import replacing
from workbench.core.machine.scratch import remove, scratch_folder
from workbench.core.values.matrices import held
from workbench.errors import InputError
from workbench.loops.loop.tunable import linear_block
from workbench.system.block_table.limits import Integrator, Pi, Pid
from workbench.system.description import BlockComponent, Component, Connection, SystemDescription

__all__ = ["sampled_controller", "write_controller"]


def write_controller(system: SystemDescription, names: Sequence[str], period: float, path: Path, fmi: int = 2) -> None:
    """Write the controller as Modelica (.mo), or build an FMU of it (.fmu).

    Args:
        system: with the parameters found.
        names: of the parameters; the controller consists of their blocks.
        period: at which it is sampled [s].
        path: of the file.
        fmi: version of the FMU, 2 or 3.

    Raises:
        InputError: see `sampled_controller`; the file cannot be written.
        BuildError: the compiler failed.
    """
    name = re.sub(r"\W", "_", path.stem)
    text = sampled_controller(system, names, period, name if name[:1].isalpha() else f"Controller_{name}")
    if path.suffix.lower() == ".mo":
        with replacing(path) as part:
            part.write_text(text, encoding="utf-8")
        return
    from workbench.build.request import Build  # noqa: PLC0415 - slow to import, and seldom needed
    from workbench.jobs.job import Job  # noqa: PLC0415

    folder = scratch_folder("controller")
    source = folder / f"{path.stem}.mo"
    source.write_text(text, encoding="utf-8")
    Build(out=path.resolve(), fmi=fmi).run([source], Job())
    remove(folder)


def sampled_controller(system: SystemDescription, names: Sequence[str], period: float, name: str) -> str:
    """Return the controller as the text of a Modelica model.

    Each block becomes what it does at its samples with its input held between them: x⁺ = e^(AT) x + ∫e^(At)dt B u. The
    integral of a PI or PID with limits follows the limited output within a sample by (y − v) T/tracking, at most to it.

    Args:
        system: as it is written down.
        names: full names of parameters; their blocks are taken.
        period: [s].
        name: of the model.

    Raises:
        InputError: a parameter of an FMU, or a block that has no such form.
    """
    wanted = {n.rpartition(".")[0] for n in names}
    blocks = [c for c in system.components if c.name in wanted]
    if missing := wanted - {c.name for c in blocks}:
        raise InputError(f"out: {min(missing)} is not a block of the system; only blocks make a controller")
    for block in blocks:
        if not re.fullmatch(r"[A-Za-z_]\w*", block.name, re.ASCII):
            raise InputError(
                f"out: '{block.name}' is not a Modelica identifier; name the block with letters, digits and _"
            )
        if linear_block(block) is None:
            raise InputError(f"out: {block.name} is not a linear block, a PI or a PID controller")
        integrator = block.block if isinstance(block, BlockComponent) else None
        if isinstance(integrator, Integrator) and (integrator.indicators or integrator.start != 0.0):
            raise InputError(
                f"out: {block.name} is an integrator with limits or a start, which has no sampled form; a pi with "
                "proportional = 0 has one"
            )
    inside = {c.destination.rpartition(".")[0]: c for c in system.connections if _within(c, wanted)}
    read = [*(c.source for c in system.connections if not _within(c, wanted)), *system.outputs.values()]
    outside = {source.rpartition(".")[0] for source in read} & wanted
    lines = [f'model {name} "Controller of {system.name}, sampled every {period!r} s"']
    lines += [f"  input Real {b.name}_in(start = 0);" for b in blocks if b.name not in inside]
    lines += [f"  output Real {b.name}_out;" for b in blocks if b.name in outside]
    equations: list[str] = []
    for block in blocks:
        link = inside.get(block.name)
        source = f"{block.name}_in" if link is None else _linked(link, blocks)
        states, own = _sampled(block, source, period)
        lines += [f"  discrete Real {v}(start = {x!r}, fixed = true);" for v, x in states.items()]
        equations += own
    lines += ["equation", f"  when sample(0, {period!r}) then", *(f"    {line};" for line in equations), "  end when;"]
    lines += [f"  {b.name}_out = {b.name}_y;" for b in blocks if b.name in outside]
    return "\n".join([*lines, f"end {name};", ""])


def _within(connection: Connection, names: set[str]) -> bool:
    return {connection.source.rpartition(".")[0], connection.destination.rpartition(".")[0]} <= names


def _linked(link: Connection, blocks: Sequence[Component]) -> str:
    """Return what a block inside gives to another one.

    Raises:
        InputError: units are converted between them.
    """
    ends = zip((link.source, link.destination), ("y", "u"), strict=True)
    units = {getattr(b, "units", {}).get(port) for end, port in ends for b in blocks if end == f"{b.name}.{port}"}
    if link.unit is not None or (link.convert and len(units) > 1):
        raise InputError(f"out: the unit changes between {link.source} and {link.destination}; give both the same")
    return f"({link.gain!r} * {link.source.rpartition('.')[0]}_y + {_number(link.offset)})"


def _sampled(block: Component, u: str, period: float) -> tuple[dict[str, float], list[str]]:
    """Return states with their start values, and the equations of a sample."""
    n = block.name
    if isinstance(block, BlockComponent) and isinstance(block.block, Pi | Pid):
        return _pid(n, block.block, u, period)
    found = linear_block(block)
    assert found is not None  # noqa: S101 - see `sampled_controller`
    a, b = held(found.a, found.b, period)
    before = [f"pre({n}_x{k + 1})" for k in range(len(a))]
    states = {f"{n}_u": 0.0, f"{n}_y": 0.0, **{f"{n}_x{k + 1}": 0.0 for k in range(len(a))}}
    own = (*before, f"{n}_u")
    ahead = [_sum((*a[k], *b[k]), own) for k in range(len(a))]
    later = [f"{n}_x{k + 1} = {x}" for k, x in enumerate(ahead)]
    return states, [f"{n}_u = {u}", f"{n}_y = {_sum((*found.c[0], *found.d[0]), own)}", *later]


def _pid(n: str, block: Pi | Pid, u: str, period: float) -> tuple[dict[str, float], list[str]]:
    lower, upper, proportional, integral, derivative, filter_time, tracking = block.packed()
    states = {f"{n}_u": 0.0, f"{n}_v": block.start, f"{n}_y": block.start, f"{n}_x": block.start}
    rate = derivative / filter_time
    difference = f" + {_number(rate)} * ({n}_u - pre({n}_w))" if isinstance(block, Pid) else ""
    limited = f"{n}_v"
    limited = limited if math.isinf(lower) else f"max({limited}, {lower!r})"
    limited = limited if math.isinf(upper) else f"min({limited}, {upper!r})"
    back = f" + {min(1.0, period / tracking)!r} * ({n}_y - {n}_v)" if block.limited else ""
    equations = [
        f"{n}_u = {u}", f"{n}_v = {proportional!r} * {n}_u + pre({n}_x){difference}", f"{n}_y = {limited}",
        f"{n}_x = pre({n}_x) + {_number(period * integral)} * {n}_u{back}",
    ]  # fmt: skip
    if isinstance(block, Pid):
        states[f"{n}_w"] = 0.0
        equations.append(f"{n}_w = pre({n}_w) + {-math.expm1(-period / filter_time)!r} * ({n}_u - pre({n}_w))")
    return states, equations


def _sum(factors: Sequence[float], names: Sequence[str]) -> str:
    parts: Iterator[str] = (f"{_number(f)} * {v}" for f, v in zip(factors, names, strict=True) if f != 0.0)
    return " + ".join(parts) or "0.0"


def _number(x: float) -> str:
    """Return a number as Modelica takes it behind an operator: a sign may not follow one."""
    return repr(float(x)) if math.copysign(1.0, x) > 0.0 else f"({float(x)!r})"
