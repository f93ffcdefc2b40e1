"""References from one analysis to another, and the arguments of each: checked before anything runs."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.errors import InputError
from workbench.study.arguments import arguments
from workbench.study.commands import Commands
from workbench.study.description import Analysis, Reference, Study, Word
from workbench.study.place import known, place

__all__ = ["check_arguments", "check_references", "words_of"]

# The runner gives these itself.
_OURS = {"json": "results are in the JSON of the study", "store": "the study has its own store"}


def words_of(analysis: Analysis, commands: Commands) -> list[Word]:
    """Return the arguments of an analysis without those of its model.

    Raises:
        InputError: an option that the command does not have, or a value that it cannot take.
    """
    where = f"[analyses.{analysis.name}]"
    for name, why in _OURS.items():
        if name in analysis.options:
            raise InputError(f"{where}: leave '{name}' out: {why}")
    with place(where):
        return arguments(commands.get(analysis.command), analysis.options)


def check_references(study: Study, commands: Commands) -> None:
    """Check that every option is one of its command, and that no reference leads nowhere or back.

    Raises:
        InputError: one line with the table and the key.
    """
    needs: dict[str, list[str]] = {}
    for analysis in study.analyses.values():
        words = words_of(analysis, commands)
        references = [w for w in words if isinstance(w, Reference)]
        for reference in references:
            _check(analysis, reference, study, commands)
        needs[analysis.name] = [r.analysis for r in references]
    for name in needs:
        _check_circle(name, needs, ())


def _check(analysis: Analysis, reference: Reference, study: Study, commands: Commands) -> None:
    where = f"[analyses.{analysis.name}]"
    known(where, "analysis", reference.analysis, study.analyses)
    source = study.analyses[reference.analysis]
    if reference.kind == "json":
        return
    if "csv" not in commands.get(source.command).options:
        raise InputError(f"{where}: [analyses.{source.name}] runs {source.command}, which writes no CSV")
    if "csv" in source.options:
        raise InputError(
            f"[analyses.{source.name}]: leave 'csv' out: [analyses.{analysis.name}] takes it from the store"
        )


def _check_circle(name: str, needs: Mapping[str, list[str]], before: tuple[str, ...]) -> None:
    if name in before:
        raise InputError(f"[analyses.{name}]: needs its own result, by way of {', '.join(before)}")
    for other in needs[name]:
        _check_circle(other, needs, (*before, name))


def check_arguments(analysis: Analysis, commands: Commands) -> None:
    """Let the command read its arguments, files of other analyses replaced by some name.

    Raises:
        InputError: one is missing, or has a value of another type.
    """
    words = words_of(analysis, commands)
    texts = [w if isinstance(w, str) else f"{w.prefix}{w.analysis}.{w.kind}" for w in words]
    with place(f"[analyses.{analysis.name}]"):
        commands.check(analysis.command, [*analysis.models, *texts])
