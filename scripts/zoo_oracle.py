"""FMPy's word on an FMU, for `scripts/zoo.py`: its description and its run, in a child process under limits.

Run as a script it is the child: it reads what is asked for as JSON from standard input and prints one line of JSON.
FMUs crash, hang and print; none of it reaches the caller.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Described", "Limits", "Run", "describe", "simulate"]

Floats = NDArray[np.float64]

_MARK = "===== "
_INTERFACES = {"me": ("modelExchange", "ModelExchange"), "cs": ("coSimulation", "CoSimulation")}
_MB = 1 << 20


@dataclass(frozen=True)
class Limits:
    """What a child may take.

    Attributes:
        seconds: of time.
        megabytes: of address space, beyond what it has with FMPy loaded (Linux).
    """

    seconds: float
    megabytes: float


@dataclass(frozen=True)
class Described:
    """What FMPy reads in an FMU's description.

    Attributes:
        fmi: version of FMI.
        tool: that made it, "" where it does not say.
        interfaces: "me" and "cs", as offered; with "needs_tool", "event_mode", "variable_step".
        variables: name → [type, causality, unit]; elements of arrays by their own names.
        states: how many continuous states.
        experiment: "start", "stop" and "step" of its default experiment, those that it has [s].
        fails: why FMPy does not read it; "": it does.
    """

    fmi: str = ""
    tool: str = ""
    interfaces: Mapping[str, Mapping[str, bool]] = field(default_factory=dict)
    variables: Mapping[str, tuple[str, str, str | None]] = field(default_factory=dict)
    states: int = 0
    experiment: Mapping[str, float] = field(default_factory=dict)
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


def describe(file: Path, limits: Limits) -> Described:
    """Return what FMPy reads in the description of an FMU."""
    found = _ask({"what": "describe", "file": str(file)}, limits)
    return Described(**found) if "fails" not in found else Described(fails=found["fails"])


def simulate(file: Path, interface: str, limits: Limits, **settings: Any) -> Run:
    """Return FMPy's run of an FMU.

    Args:
        file: the FMU.
        interface: "me" or "cs".
        limits: of the child.
        **settings: of `fmpy.simulate_fmu`; "forced": input → value, held.
    """
    found = _ask({"what": "simulate", "file": str(file), "interface": interface, "settings": settings}, limits)
    if "fails" in found:
        return Run(fails=found["fails"])
    signals = {name: np.array(values, dtype=float) for name, values in found["signals"].items()}
    return Run(time=np.array(found["time"]), signals=signals)


def _ask(question: Mapping[str, Any], limits: Limits) -> dict[str, Any]:
    words = [sys.executable, __file__, repr(limits.megabytes)]
    try:
        done = subprocess.run(
            words, input=json.dumps(question).encode(), capture_output=True, timeout=limits.seconds, check=False
        )
    except subprocess.TimeoutExpired:
        return {"fails": f"it has not answered after {limits.seconds:g} s"}
    told = [line for line in done.stdout.decode(errors="replace").splitlines() if line.startswith(_MARK)]
    if not told:
        return {"fails": f"its process ended with exit code {done.returncode}"}
    answer: dict[str, Any] = json.loads(told[-1].removeprefix(_MARK))
    return answer


# -- the child ------------------------------------------------------------------------------------


def _be_child() -> None:
    question = json.loads(sys.stdin.read())
    import fmpy  # noqa: F401, PLC0415  loaded before the limit is set

    _limit_memory(float(sys.argv[1]))
    try:
        answer = _describe(question["file"]) if question["what"] == "describe" else _simulate(question)
    except Exception as error:  # noqa: BLE001  whatever FMPy says is its answer
        text = str(error) or type(error).__name__
        answer = {"fails": " ".join(text.split())}
    sys.stdout.flush()
    print("\n" + _MARK + json.dumps(answer), flush=True)


def _limit_memory(megabytes: float) -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource  # noqa: PLC0415 - not on Windows

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * resource.getpagesize() + int(megabytes * _MB)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _describe(file: str) -> dict[str, Any]:
    import fmpy  # noqa: PLC0415

    read = fmpy.read_model_description(file, validate=False)
    experiment = read.defaultExperiment
    given = {
        name: float(value)
        for name, attribute in (("start", "startTime"), ("stop", "stopTime"), ("step", "stepSize"))
        if (value := getattr(experiment, attribute, None)) is not None
    }
    return {
        "fmi": read.fmiVersion,
        "tool": read.generationTool or "",
        "interfaces": dict(_interfaces(read)),
        "variables": {name: said for v in read.modelVariables for name, said in _variable(v)},
        "states": int(read.numberOfContinuousStates),
        "experiment": given,
    }


def _interfaces(read: Any) -> Iterator[tuple[str, dict[str, bool]]]:
    for name, (attribute, _) in _INTERFACES.items():
        offered = getattr(read, attribute)
        if offered is not None:
            yield (
                name,
                {
                    "needs_tool": bool(offered.needsExecutionTool),
                    "event_mode": bool(getattr(offered, "hasEventMode", False)),
                    "variable_step": bool(getattr(offered, "canHandleVariableCommunicationStepSize", True)),
                },
            )


def _variable(variable: Any) -> Iterator[tuple[str, tuple[str, str, str | None]]]:
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
    said = (variable.type, variable.causality or "local", unit)
    for name in _names_of(variable):
        yield name, said


def _names_of(variable: Any) -> list[str]:
    return _elements(variable.name, tuple(variable.shape or ()) if variable.dimensions else ())


def _elements(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of an array's elements, in the order of its values."""
    if not shape:
        return [name]
    return [f"{name}[{','.join(map(str, at))}]" for at in product(*(range(1, n + 1) for n in shape))]


def _simulate(question: Mapping[str, Any]) -> dict[str, Any]:
    import fmpy  # noqa: PLC0415

    kind = _INTERFACES[question["interface"]][1]
    read = fmpy.read_model_description(question["file"], validate=False)
    settings = dict(question["settings"])
    if question["interface"] == "cs" and getattr(read.coSimulation, "hasEventMode", False):
        settings |= {"use_event_mode": True, "early_return_allowed": True}
    # An element of an array: FMPy records arrays whole.
    known = {v.name for v in read.modelVariables}
    wanted = [n if n in known else n.rpartition("[")[0] for n in settings.pop("output")]
    settings |= _forced(read, settings.pop("forced"), settings["start_time"], settings["stop_time"])
    found = fmpy.simulate_fmu(
        question["file"], validate=False, fmi_type=kind, output=list(dict.fromkeys(wanted)), record_events=False,
        model_description=read, **settings,
    )  # fmt: skip
    signals: dict[str, list[float]] = {}
    for name in found.dtype.names:
        column = found[name]
        if column.dtype.kind in "fiub":
            flat = column.reshape(len(found), -1).astype(float)
            names = _elements(name, column.shape[1:])
            signals |= {n: flat[:, i].tolist() for i, n in enumerate(names)}
    return {"time": signals.pop("time"), "signals": signals}


def _forced(read: Any, values: Mapping[str, float], start: float, stop: float) -> dict[str, Any]:
    """Return start values and input signals for FMPy: inputs held at values, arrays whole."""
    starts: dict[str, Any] = {}
    for variable in read.modelVariables:
        names = _names_of(variable)
        if set(names) <= values.keys():
            whole = [values[n] for n in names]
            starts[variable.name] = whole[0] if names == [variable.name] else whole
    held = [n for n, v in starts.items() if isinstance(v, float)]
    if not held:
        return {"start_values": starts}
    row = tuple(starts[n] for n in held)
    types = [("time", np.float64), *((n, np.float64) for n in held)]
    return {"start_values": starts, "input": np.array([(start, *row), (stop, *row)], dtype=types)}


if __name__ == "__main__":
    _be_child()
