"""FMPy's word on an FMU, for `scripts/zoo.py`: its description and its runs, in a child process under limits.

The child tells the description and each run as they are done. FMUs crash, hang and print; none of it reaches the
caller, and what was told before is not lost.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from itertools import product
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.values.arrays import Floats

__all__ = ["Asked", "Described", "Limits", "Run", "consult"]


MOST_STEPS = 2000
TOLERANCE = 1e-6
MOVED = 0.1  # of an input's start value, or of 1
_FINER = "finer"
_STEPS = 500  # where the FMU names no step
_INTERFACES = {"me": ("modelExchange", "ModelExchange"), "cs": ("coSimulation", "CoSimulation")}
_FLOATS = ("Real", "Float64", "Float32")
_MB = 1 << 20


@dataclass(frozen=True)
class Limits:
    """What a child may take.

    Attributes:
        seconds: of time, for each run.
        megabytes: of address space, beyond what it has with FMPy loaded (Linux); inf for any.
    """

    seconds: float
    megabytes: float = math.inf


@dataclass(frozen=True)
class Asked:
    """What is simulated, by FMPy and by the workbench.

    Attributes:
        start, stop, step: of the FMU's default experiment, at most `MOST_STEPS` steps [s].
        moved: continuous input → by how much it is moved from its start value at the begin.
        jumps: those that jump back in the middle → their start value; FMPy forces no arrays.
    """

    start: float = 0.0
    stop: float = 1.0
    step: float = 0.002
    moved: Mapping[str, float] = field(default_factory=dict)
    jumps: Mapping[str, float] = field(default_factory=dict)

    @property
    def back(self) -> float:
        """When they jump: a communication point in the middle of the run [s]."""
        return self.start + self.step * round(0.5 * (self.stop - self.start) / self.step)


@dataclass(frozen=True)
class Described:
    """What FMPy reads in an FMU's description.

    Attributes:
        fmi: version of FMI.
        tool: that made it, "" where it does not say.
        interfaces: "me" and "cs", as offered; with "needs_tool" and "event_mode".
        variables: name → [type, causality, unit]; elements of arrays by their own names.
        states: how many continuous states.
        asked: what is simulated.
        fails: why FMPy does not read it; "": it does.
    """

    fmi: str = ""
    tool: str = ""
    interfaces: Mapping[str, Mapping[str, bool]] = field(default_factory=dict)
    variables: Mapping[str, tuple[str, str, str | None]] = field(default_factory=dict)
    states: int = 0
    asked: Asked = Asked()
    fails: str = ""


@dataclass(frozen=True)
class Run:
    """FMPy's time history.

    Attributes:
        time: shape (n,) [s].
        signals: by names, of arrays each element, shape (n,).
        fails: why there is none; "": there is one.
    """

    time: Floats = field(default_factory=lambda: np.empty(0))
    signals: Mapping[str, Floats] = field(default_factory=dict)
    fails: str = ""


def consult(file: Path, limits: Limits) -> tuple[Described, dict[str, Run]]:
    """Return what FMPy reads in the description of an FMU, and its run by each interface."""
    told, why = _ask(file, "describe", limits)
    if not told or "fails" in told[0]:
        return Described(fails=told[0]["fails"] if told else why), {}
    described = Described(**{**told[0], "asked": Asked(**told[0]["asked"])})
    runs = dict(zip(described.interfaces, map(_run, told[1:]), strict=False))
    for interface in described.interfaces:
        if interface not in runs:  # the one before it, or its own run, ended the child
            answers, why = _ask(file, interface, limits)
            runs[interface] = _run(answers[0]) if answers else Run(fails=why)
    return described, runs


def finer(file: Path, interface: str, limits: Limits) -> Run:
    """Return FMPy's run again, in a process that shares no memory with those of `consult`, not even the addresses.

    By model exchange with half the interval and a hundredth of the tolerance, in co-simulation without event mode. The
    process: for an FMU that reads what it never set.
    """
    answers, why = _ask(file, f"{interface} {_FINER}", limits, multiprocessing.get_context("spawn"))
    return _run(answers[0]) if answers else Run(fails=why)


def _run(told: Mapping[str, Any]) -> Run:
    if "fails" in told:
        return Run(fails=told["fails"])
    signals = {name: np.array(values, dtype=float) for name, values in told["signals"].items()}
    return Run(time=np.array(told["time"]), signals=signals)


def _ask(file: Path, what: str, limits: Limits, context: Any = None) -> tuple[list[dict[str, Any]], str]:
    """Return what a child tells about an FMU, and why it tells no more."""
    context = context or _children()
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_be_child, args=(what, str(file), limits.megabytes, theirs), daemon=True)
    child.start()
    theirs.close()
    said: list[dict[str, Any]] = []
    end = time.monotonic() + limits.seconds
    with ours, suppress(EOFError, OSError):
        while ours.poll(max(0.0, end - time.monotonic())):
            said.append(ours.recv())
    child.join(max(0.0, end - time.monotonic()))
    if child.exitcode is None:
        child.kill()
        child.join()
        return said, f"it has not answered after {limits.seconds:g} s"
    return said, f"its process ended with exit code {child.exitcode}"


@cache
def _children() -> Any:
    """Return what starts children; they are forked, where the system can, from a process that has loaded FMPy."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["fmpy.simulation", "scripts.zoo_oracle"])
    return context


# -- the child ------------------------------------------------------------------------------------


def _be_child(what: str, file: str, megabytes: float, tell: Connection) -> None:
    import fmpy.simulation  # noqa: F401, PLC0415  loaded before the limit is set

    with open(os.devnull, "r+b", buffering=0) as nothing:  # noqa: PTH123 - a device; what an FMU prints is not read
        for descriptor in range(3):
            os.dup2(nothing.fileno(), descriptor)
    _limit_memory(megabytes)
    try:
        read, told = _describe(file)
    except Exception as error:  # noqa: BLE001  whatever FMPy says is its answer
        tell.send(_failure(error))
        return
    if what == "describe":
        tell.send(told)
    one, _, better = what.partition(" ")
    asked, tolerance = Asked(**told["asked"]), TOLERANCE
    if better == _FINER and one == "me":  # in co-simulation the solver is the FMU's
        asked, tolerance = replace(asked, step=asked.step / 2.0), TOLERANCE / 100.0
    for interface in told["interfaces"] if what == "describe" else [one]:
        try:
            tell.send(_simulate(file, interface, read, asked, tolerance, events=better != _FINER))
        except Exception as error:  # noqa: BLE001
            tell.send(_failure(error))


def _failure(error: Exception) -> dict[str, str]:
    return {"fails": " ".join((str(error) or type(error).__name__).split())}


def _limit_memory(megabytes: float) -> None:
    if not math.isfinite(megabytes):
        return
    with suppress(ImportError, OSError, ValueError):
        import resource  # noqa: PLC0415 - not on Windows

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * resource.getpagesize() + int(megabytes * _MB)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _describe(file: str) -> tuple[Any, dict[str, Any]]:
    import fmpy  # noqa: PLC0415

    read = fmpy.read_model_description(file, validate=False)
    experiment = read.defaultExperiment
    given = {
        name: float(value)
        for name, attribute in (("start", "startTime"), ("stop", "stopTime"), ("step", "stepSize"))
        if (value := getattr(experiment, attribute, None)) is not None
    }
    return read, {
        "fmi": read.fmiVersion,
        "tool": read.generationTool or "",
        "interfaces": dict(_interfaces(read)),
        "variables": {name: said for v in read.modelVariables if v.alias is None for name, said in _variable(v)},
        "states": int(read.numberOfContinuousStates),
        "asked": asdict(_asked(read, given)),
    }


def _asked(read: Any, given: Mapping[str, float]) -> Asked:
    start = given.get("start", 0.0)
    stop = given["stop"] if given.get("stop", start) > start else start + 1.0
    step = given.get("step") or (stop - start) / _STEPS
    forced = _forced_variables(read)
    elements = [dict(zip(_names_of(v), _starts(v), strict=True)) for v in forced]
    moved = {name: MOVED * (abs(value) or 1.0) for of_variable in elements for name, value in of_variable.items()}
    jumps = {v.name: of_variable[v.name] for v, of_variable in zip(forced, elements, strict=True) if not v.dimensions}
    return Asked(start, min(stop, start + MOST_STEPS * step), step, moved, jumps)


def _forced_variables(read: Any) -> list[Any]:
    """Return the inputs that are numbers with a point, those with several names once."""
    forced = (v for v in reversed(read.modelVariables) if v.causality == "input" and v.type in _FLOATS)
    return list({v.valueReference: v for v in forced}.values())


def _starts(variable: Any) -> list[float]:
    """Return the start values of a variable's elements."""
    names = _names_of(variable)
    values = [float(v) for v in str(variable.start or "0").split()]
    return values if len(values) == len(names) else [values[0]] * len(names)


def _interfaces(read: Any) -> Iterator[tuple[str, dict[str, bool]]]:
    for name, (attribute, _) in _INTERFACES.items():
        offered = getattr(read, attribute)
        if offered is not None:
            flags = {"needs_tool": "needsExecutionTool", "event_mode": "hasEventMode"}
            yield name, {key: bool(getattr(offered, flag, False)) for key, flag in flags.items()}


def _variable(variable: Any) -> Iterator[tuple[str, tuple[str, str, str | None]]]:
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
    for name in _names_of(variable):
        yield name, (variable.type, variable.causality or "local", unit)


def _names_of(variable: Any) -> list[str]:
    return _elements(variable.name, tuple(variable.shape or ()) if variable.dimensions else ())


def _elements(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of an array's elements, in the order of its values."""
    if not shape:
        return [name]
    return [f"{name}[{','.join(map(str, at))}]" for at in product(*(range(1, n + 1) for n in shape))]


def _simulate(file: str, interface: str, read: Any, asked: Asked, tolerance: float, *, events: bool) -> dict[str, Any]:
    import fmpy  # noqa: PLC0415

    settings = _forced(read, asked)
    if events and interface == "cs" and getattr(read.coSimulation, "hasEventMode", False):
        settings |= {"use_event_mode": True, "early_return_allowed": True}
    outputs = [v.name for v in read.modelVariables if v.causality == "output" and v.type not in ("Binary", "Clock")]
    states = [d.variable.derivative.name for d in read.derivatives if getattr(d.variable, "derivative", None)]
    found = fmpy.simulate_fmu(
        file,
        validate=False,
        fmi_type=_INTERFACES[interface][1],
        model_description=read,
        start_time=asked.start,
        stop_time=asked.stop,
        output_interval=asked.step,
        relative_tolerance=tolerance,
        output=outputs or states,
        record_events=False,
        **settings,
    )
    signals: dict[str, list[float]] = {}
    for name in found.dtype.names:
        column = found[name]
        if column.dtype.kind in "fiub":
            flat = column.reshape(len(found), -1).astype(float)
            names = _elements(name, column.shape[1:])
            signals |= {n: flat[:, i].tolist() for i, n in enumerate(names)}
    return {"time": signals.pop("time"), "signals": signals}


def _forced(read: Any, asked: Asked) -> dict[str, Any]:
    """Return start values and input signals for FMPy: arrays are held whole, other inputs jump back to their start."""
    starts: dict[str, Any] = {}
    for variable in _forced_variables(read):
        values = [v + asked.moved[n] for n, v in zip(_names_of(variable), _starts(variable), strict=True)]
        starts[variable.name] = values if variable.dimensions else values[0]
    held = list(asked.jumps)
    if not held:
        return {"start_values": starts}
    first = tuple(starts[n] for n in held)
    then = tuple(asked.jumps.values())
    rows = [(asked.start, *first), (asked.back, *first), (asked.back, *then), (asked.stop, *then)]
    types = [("time", np.float64), *((n, np.float64) for n in held)]
    return {"start_values": starts, "input": np.array(rows, dtype=types)}
