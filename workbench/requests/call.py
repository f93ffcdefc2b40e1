"""A call in Python as it could be written again, and what it was given."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import is_dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.records.option import values_of
from workbench.errors import WorkbenchError
from workbench.model.base import Model
from workbench.model.described_model import LoadRecipe
from workbench.model.loading import Loading
from workbench.requests.kept import origin_of
from workbench.requests.model_facts import facts_of, hash_of
from workbench.requests.origin import ModelFacts, Origin

__all__ = ["files_of", "origin_of_call"]

_LONGEST = 120  # an argument whose text is longer is called by its name
_WRITTEN = ("out", "path", "store")  # arguments that name what is written, not what is read


_signature = lru_cache(maxsize=256)(inspect.signature)


def origin_of_call(
    function: Callable[..., object],
    args: Iterable[Any],
    by_name: Mapping[str, Any],
    *,
    seconds: float,
    result: object = None,
) -> Origin:
    """Return the origin of what `function` returned.

    Args:
        function: that was called.
        args: its arguments.
        by_name: its keyword arguments.
        seconds: that it took.
        result: what it returned; it may remember models that are not among the arguments.
    """
    given = _signature(function).bind(*args, **by_name).arguments
    values = [*given.values(), *(vars(given["self"]).values() if "self" in given else ())]
    models = [m for v in values for m in _models_in(v)]
    earlier = [origin for v in (*values, result) if (origin := _earlier(v)) is not None]
    facts = [*(facts_of(m) for m in models), *(m for o in earlier for m in o.models)]
    files = {k: v for o in earlier for k, v in o.files.items()}
    return Origin(
        command=function.__name__,
        call=_call(function, given, models),
        line=getattr(function, "command_line", _no_line)(given),
        models=tuple(_different(facts)),
        files={**files, **_files(given)},
        seconds=round(seconds, 3),
        notes=tuple(dict.fromkeys(note for m in models for note in m.notes)),
    )


def _no_line(_: Mapping[str, Any]) -> str:
    return ""


def _models_in(value: object) -> list[Model]:
    """Return the models that an argument is or holds."""
    several = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else [value]
    return [v for v in several if isinstance(v, Model)]


def _different(facts: Iterable[ModelFacts]) -> list[ModelFacts]:
    result: list[ModelFacts] = []
    for one in facts:
        if one not in result:
            result.append(one)
    return result


def _earlier(value: object) -> Origin | None:
    """Return the origin of an argument that is a result itself."""
    return origin_of(value) if is_dataclass(value) or hasattr(value, "report") else None


def _files(given: Mapping[str, Any]) -> dict[str, str]:
    """Return name → hash of the files that were read."""
    result = {}
    for name, value in given.items():
        several = value if isinstance(value, list | tuple) else [value]
        for path in several if name not in _WRITTEN else ():
            if isinstance(path, str | Path) and _is_file(path):
                result.update(files_of([path]))
    return result


def files_of(paths: Iterable[str | Path]) -> dict[str, str]:
    """Return name → SHA-256 of files; those that are gone are left out."""
    result = {}
    for path in paths:
        try:
            result[Path(path).name] = hash_of(Path(path))
        except WorkbenchError:
            continue
    return result


def _is_file(value: str | Path) -> bool:
    try:
        return Path(value).is_file()
    except (OSError, ValueError):  # text that can be no path
        return False


# -- the call as text --------------------------------------------------------------------------


def _call(function: Callable[..., object], given: Mapping[str, Any], models: list[Model]) -> str:
    names = {id(m): "model" if len(models) == 1 else f"model_{i}" for i, m in enumerate(models, start=1)}
    owner = "wb" if "self" not in given else names.get(id(given["self"]), type(given["self"]).__name__.lower())
    texts, positional = [], True
    for name, parameter in _signature(function).parameters.items():
        value = given.get(name)
        # Behind one that was left out, names are needed.
        positional = positional and value is not None and parameter.kind is not inspect.Parameter.KEYWORD_ONLY
        if name != "self" and value is not None and not callable(value):
            texts.append(f"{'' if positional else f'{name}='}{_text(value, name, names)}")
    lines = [f"{names[id(m)]} = {load}" for m in models if (load := _load(m))]
    return "\n".join([*lines, f"result = {owner}.{function.__name__}({', '.join(texts)})"])


def _text(value: Any, name: str, names: Mapping[int, str]) -> str:  # noqa: ANN401 - any argument
    """Return a value as code, or the parameter's name where it would be long or cannot be written."""
    text = _code(value, names)
    return text if text and len(text) <= _LONGEST else name


def _code(value: Any, names: Mapping[int, str]) -> str:  # noqa: ANN401, PLR0911 - any argument, one way for each kind
    """Return a value as code, models by their names; empty where it cannot be written so."""
    if id(value) in names:
        return names[id(value)]
    if isinstance(value, np.generic | np.ndarray):
        return repr(value.tolist()) if value.size < _LONGEST else ""
    if isinstance(value, Mapping | tuple | list | set | frozenset) and len(value) > _LONGEST:
        return ""
    if value is None or isinstance(value, str | bool | int | float | complex):
        return repr(value)
    if isinstance(value, Path):
        return repr(str(value))
    if isinstance(value, Mapping):
        return _joined("{", ((f"{k!r}: ", v) for k, v in value.items()), "}", names)
    if isinstance(value, tuple):
        return _joined("(", (("", v) for v in value), ",)" if len(value) == 1 else ")", names)
    if isinstance(value, list | set | frozenset):
        return _joined("[", (("", v) for v in value), "]", names)
    if getattr(value, "repr_is_code", False) and type(value).__module__.startswith("workbench."):
        return f"wb.{value!r}"
    return ""


def _joined(begin: str, items: Iterable[tuple[str, Any]], end: str, names: Mapping[int, str]) -> str:
    texts = [(before, _code(value, names)) for before, value in items]
    return "" if not all(text for _, text in texts) else begin + ", ".join(a + b for a, b in texts) + end


@cache
def _usual_loading() -> Mapping[str, Any]:
    return values_of(Loading())


def _load(model: Model) -> str:
    """Return the line that loads a model again; empty for one that is not a file."""
    recipe = model.recipe
    facts = facts_of(model)
    if not isinstance(recipe, LoadRecipe) or not facts.source:
        return ""
    usual = _usual_loading()
    chosen = [repr(facts.source)]
    chosen += [f"{k}={_code(v, {})}" for k, v in values_of(recipe).items() if v != usual[k]]
    return f"wb.load({', '.join(chosen)})"
