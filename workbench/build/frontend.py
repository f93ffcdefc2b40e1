"""The Modelica front end: rumoca, pinned, called as a library."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from workbench.build.ir import Dae
from workbench.core.machine.files import content_of
from workbench.errors import BuildError

REQUIRED_VERSION = "0.10.2"
_STANDARD_ERROR = 2


@dataclass(frozen=True, slots=True)
class FlatModel:
    """A model that the front end accepted."""

    name: str
    description: str
    dae: Dae
    stop_time: float | None
    tolerance: float | None
    interval: float | None


def _front_end() -> Any:  # noqa: ANN401 - the module, untyped because it is optional
    try:
        import rumoca  # noqa: PLC0415 - optional: only building needs it
    except ImportError as error:
        raise BuildError(
            'building FMUs needs the Modelica front end and the compiler: pip install "fmi-workbench[build]"'
        ) from error
    if rumoca.version().split()[-1].lstrip("v") != REQUIRED_VERSION:
        raise BuildError(
            f"the Modelica front end is rumoca {rumoca.version()}, but {REQUIRED_VERSION} is needed: "
            'pip install "fmi-workbench[build]"'
        )
    return rumoca


def check(file: Path, model: str) -> FlatModel:
    """Parse, check and flatten `model` out of `file`.

    A file that says `within Package;` is read together with the whole package.

    Raises:
        BuildError: The front end is missing or refuses the model; the message carries file and line.
    """
    rumoca = _front_end()
    if not file.is_file():
        raise BuildError(f"{file}: no such file; give a Modelica file (.mo)")
    text = _text(file)
    try:
        with _without_its_drawings():
            package = _package_folder(file, text)
            if package is None:
                checked = rumoca.Session(roots=[]).loads(text, model=model, filename=file.name)
            else:
                checked = rumoca.Session(roots=[str(package)]).load(str(file), model=model)
            dae = json.loads(checked.to_json("dae"))
            flat = json.loads(checked.to_json("flat"))
    except rumoca.RumocaError as error:
        raise BuildError(_diagnosis(rumoca, file, text, error)) from error
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # what Rust raises; it is not an Exception
            raise
        raise BuildError(
            f"{file.name}: the Modelica front end fails on this model, by a fault of its own: “{error}”; it does so on "
            "array comprehensions, {… for i in 1:n}: write out the array, or use a loop of equations"
        ) from None
    experiment = _experiment(text, model)
    return FlatModel(
        name=model,
        description=_description(text, model),
        dae=Dae(dae, flat),
        stop_time=experiment.get("StopTime"),
        tolerance=experiment.get("Tolerance"),
        interval=experiment.get("Interval"),
    )


@contextmanager
def _without_its_drawings() -> Iterator[None]:
    """Keep off standard error what the front end writes there when it fails, beside what it raises."""
    sys.stderr.flush()
    kept, nowhere = os.dup(_STANDARD_ERROR), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, _STANDARD_ERROR)
    try:
        yield
    finally:
        os.dup2(kept, _STANDARD_ERROR)
        os.close(kept)
        os.close(nowhere)


# What the front end says of an element of an array in a when clause: what that means, where it stands, what to do.
_ALONE = "use variables without an index, or put the when clause into a model of which there is an array (Cell cell[n])"
_WHOLE = "assign the whole array (x = pre(x) + a)"
_MEANINGS = (
    (
        re.compile(r"when assignment`?: `([^`]+\[[^`]*\])` is not a discrete"),
        f"a when clause assigns {{}}, one element of an array, which is not supported; {_WHOLE}, {_ALONE}",
        r"\b{}\s*\[",
    ),
    (
        re.compile(r"reinit\(\) can only be applied to state variables: (\S+\[\S*\])"),
        f"reinit of {{}}, one element of an array, is not supported; {_ALONE}",
        r"\breinit\s*\(\s*{}\s*\[",
    ),
)
# What it says of delays, without a line.
_DELAYS = (
    ("`delay`: delayTime must evaluate to a finite positive", "a delay() of 0 s is none: write its variable alone"),
    (
        "delay() time argument must be a parameter expression",
        "the time of a delay() must be a constant or parameter; in a loop write the equations out",
    ),
)
_STAGE = re.compile(r"^\w+ failed: \S+ failed in \w+: ")  # of the front end, before its reason


def _meant(file: Path, text: str, message: str) -> str | None:
    """Return what a message of the front end means, where it is one that says nothing to who wrote the model."""
    bare = _without_comments(text)
    for pattern, words, place in _MEANINGS:
        if result := pattern.search(message):
            name = result[1].rpartition("[")[0].rpartition(".")[2]
            whens = re.finditer(r"\b(?:else)?when\b.*?\bend\s+when\b", bare, flags=re.DOTALL)
            at = (m.start() + inner.start() for m in whens if (inner := re.search(place.format(name), m[0])))
            line = next((f":{bare[:begin].count(chr(10)) + 1}" for begin in at), "")
            return f"{file.name}{line}: {words.format(result[1])}"
    calls = [m.start() for m in re.finditer(r"\bdelay\s*\(", bare)]
    for said, words in _DELAYS:
        if said in message:
            line = f":{bare[: calls[0]].count(chr(10)) + 1}" if len(calls) == 1 else ""  # which of several is not told
            return f"{file.name}{line}: {words}"
    return None


def _diagnosis(rumoca: Any, file: Path, text: str, error: Exception) -> str:  # noqa: ANN401 - see _front_end
    """Return the front end's complaint with file and line, which it draws rather than tells."""
    drawn = "\n".join(str(d.message) for d in _validate(rumoca, file, text))
    place = re.search(rf"{re.escape(file.name)}:(\d+)", drawn)
    if place:
        problem = re.search(r"×\s*(.+)", drawn)
        wanted = re.search(r"help:\s*(.+)", drawn, flags=re.DOTALL)
        hint = f"; {' '.join(wanted.group(1).split())}" if wanted else ""
        return f"{file.name}:{place.group(1)}: {problem.group(1) if problem else 'syntax error'}{hint}"
    message = str(error).splitlines()[0]
    if meant := _meant(file, text, message):
        return meant
    named = re.search(r"'(\w+)'", message)
    line = _line_of(_without_comments(text), named.group(1)) if named else None
    reason = _STAGE.sub("", message)
    words = message if reason == message else f"the Modelica front end refuses this: “{reason}”; write it another way"
    return f"{file.name}{f':{line}' if line else ''}: {words}"


def _validate(rumoca: Any, file: Path, text: str) -> Sequence[Any]:  # noqa: ANN401 - see _front_end
    try:
        return list(rumoca.validate_source(text, filename=file.name))
    except rumoca.RumocaError:
        return []


def _line_of(text: str, name: str) -> int | None:
    match = re.search(rf"\b{re.escape(name)}\b", text)
    return text[: match.start()].count("\n") + 1 if match else None


def _within(text: str) -> list[str]:
    """Return the parts of the package name that a file says it belongs to."""
    match = re.match(r"\s*within\s+([\w.]+)\s*;", _without_comments(text))
    return match.group(1).split(".") if match else []


def _package_folder(file: Path, text: str) -> Path | None:
    depth = len(_within(text))
    return file.resolve().parents[depth - 1] if depth else None


def _text(file: Path) -> str:
    try:
        return content_of(file).decode("utf-8")
    except OSError as error:
        raise BuildError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise BuildError(f"{file}: is not UTF-8 text (byte {error.start}); save it as UTF-8") from None


def models_in(file: Path) -> list[str]:
    """Return the names of the models and blocks that stand at the top of `file`.

    A package's models come as ``Package.Model``. A light scan: the front end checks the rest.
    """
    text = _without_comments(_text(file))
    outer = ".".join(_within(text))
    names: list[str] = []
    scopes: list[str] = []
    pattern = re.compile(
        r"\b(end)\s+(\w+)\s*;|\b(?:(partial)\s+)?(package|model|block|class|function|connector|record|type)\s+(\w+)"
        r"(\s*=|\s+extends\b)?"
    )
    for match in pattern.finditer(text):
        end, closed, partial, kind, name, short = match.groups()
        if end:
            if scopes and scopes[-1].rpartition(".")[2] == closed:
                scopes.pop()
            continue
        if short and short.strip() == "=":
            continue
        full = f"{scopes[-1]}.{name}" if scopes else name
        outer_is_package = all(scope in packages for scope in scopes) if (packages := _packages(text)) else not scopes
        if kind in {"model", "block", "class"} and not partial and outer_is_package:
            names.append(f"{outer}.{full}" if outer else full)
        scopes.append(full)
    return names


def _packages(text: str) -> set[str]:
    result: set[str] = set()
    prefix: list[str] = []
    for match in re.finditer(r"\bpackage\s+(\w+)|\bend\s+(\w+)\s*;", text):
        opened, closed = match.groups()
        if opened:
            prefix.append(opened)
            result.add(".".join(prefix))
        elif prefix and prefix[-1] == closed:
            prefix.pop()
    return result


def _without_comments(text: str) -> str:
    blank = lambda m: re.sub(r"[^\n]", " ", m.group())  # noqa: E731 - keeps the line numbers
    return re.sub(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', blank, text, flags=re.DOTALL)


def _description(text: str, model: str) -> str:
    match = re.search(rf'\b(?:model|block|class)\s+{re.escape(model.rpartition(".")[2])}\s+"((?:\\.|[^"\\])*)"', text)
    return match.group(1) if match else ""


def _experiment(text: str, model: str) -> dict[str, float]:
    local = re.escape(model.rpartition(".")[2])
    body = re.search(rf"\b(?:model|block|class)\s+{local}\b(.*?)\bend\s+{local}\s*;", text, flags=re.DOTALL)
    annotation = re.search(r"\bexperiment\s*\(([^)]*)\)", body.group(1)) if body else None
    pairs = re.findall(r"(\w+)\s*=\s*([-+.\deE]+)", annotation.group(1)) if annotation else []
    return {name: float(value) for name, value in pairs}
