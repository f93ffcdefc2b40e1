"""What every step of pre-processing returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from workbench.data.experiment.experiment import Experiment
from workbench.errors import InputError, suggest

__all__ = ["PreprocessingStep", "all_columns", "check_columns"]


@dataclass(frozen=True, eq=False)
class PreprocessingStep:
    """Data after a step of pre-processing.

    Attributes:
        experiment: the new data; the old are unchanged.
        what: what was done, in one line, also in the notes of the data.
    """

    experiment: Experiment
    what: str


def all_columns(experiment: Experiment) -> tuple[str, ...]:
    """Return the names of all columns, inputs first."""
    return (*experiment.input_names, *experiment.output_names)


def check_columns(experiment: Experiment, columns: Sequence[str] | None, known: Sequence[str]) -> tuple[str, ...]:
    """Return the columns asked for, all known ones where none are.

    Raises:
        InputError: unknown column.
    """
    if columns is None:
        return tuple(known)
    for column in columns:
        if column not in known:
            raise InputError(f"{experiment.name}: there is no column '{column}' here; {suggest(column, known)}")
    return tuple(dict.fromkeys(columns))
