"""A session as a study file: what was measured, to be run again and compared with requirements."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from workbench.core.records.parsing import toml_key, toml_value
from workbench.ui.work import Work

__all__ = ["study_of"]

_WITHOUT = {"store", "redo"}  # a study has its own store
_RESULT, _KIND = "result", "kind"  # why a work is not in it
_SAID = {
    "": "Analyses of this session",
    _KIND: "Not in it, since a study asks for analyses of one model",
    _RESULT: "Not in it, since they gave no result",
}


def study_of(works: Iterable[Work]) -> str:
    """Return the study file that does the same work, one analysis for each that was done on one model.

    It begins with what it has and what not, and why; empty: nothing was done, only this: nothing that a study can do.

    Args:
        works: in their order.
    """
    from workbench.study.commands import COMMANDS  # noqa: PLC0415 - of all commands: it takes a while

    models: dict[str, str] = {}
    analyses: list[str] = []
    said: dict[str, list[str]] = {}
    for work in works:
        fits = len(work.subject) == 1 and work.kind.subject.opened and work.command in COMMANDS
        why = _RESULT if not work.headline else "" if fits else _KIND
        said.setdefault(why, []).append(f"{work.command} {work.number}")
        if why:
            continue
        subject = work.subject[0]
        model = models.setdefault(subject, _name(subject, models.values()))
        options = work.asked
        lines = [
            f"[analyses.{work.command.replace('-', '_')}_{work.number}]",
            f'command = "{work.kind.command}"',
            f'model = "{model}"',
        ]
        lines += [
            f"{_key(work, name)} = {toml_value(value)}" for name, value in options.items() if name not in _WITHOUT
        ]
        analyses.append("\n".join(lines))
    heading = "".join(f"# {_SAID[why]}: {', '.join(said[why])}.\n" for why in _SAID if why in said)
    if not analyses:
        return heading
    named = "\n".join(f"{name} = {toml_value(subject)}" for subject, name in models.items())
    return heading + "\n\n".join(['name = "session"', f"[models]\n{named}".rstrip(), *analyses]) + "\n"


def _name(subject: str, taken: Iterable[str]) -> str:
    stem = re.sub(r"\W+", "_", Path(subject.partition(":")[2] or subject).stem) or "model"
    name, count = stem, 1
    while name in set(taken):
        count += 1
        name = f"{stem}_{count}"
    return name


def _key(work: Work, name: str) -> str:
    from workbench.requests.request import asked_options  # noqa: PLC0415

    declared, _ = asked_options(work.kind)[name]
    key = declared.flag.removeprefix("--")
    return toml_key(key)
