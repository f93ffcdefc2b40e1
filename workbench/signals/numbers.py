"""Numbers in the texts of signals: plain, with a unit, or a word that stands for one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from workbench.core.records.csv_file import is_number
from workbench.core.records.quantity import DecimalCommaError, quantity
from workbench.core.values.conversion import in_other_unit, named_conversion
from workbench.errors import InputError
from workbench.signals.kinds import exactly

__all__ = ["ANYTHING", "PLAIN", "Meaning", "Numbers"]

Meaning: TypeAlias = Literal["level", "change", "height", "time", "frequency", "phase", "length", "speed", "count"]
"""What a number is: a value of the input; a difference of two, as an amplitude; a value that is counted from zero, as
the height of a pulse; a time [s]; a frequency [Hz]; an angle [deg]; a length [m]; a speed [m/s]; a
whole number without a unit."""
_UNITS: Mapping[Meaning, tuple[str, ...]] = {
    "time": ("s",),
    "frequency": ("Hz", "rev/s"),
    "phase": ("deg",),
    "length": ("m",),
    "speed": ("m/s",),
}


@dataclass(frozen=True)
class Numbers:
    """How the numbers in a signal's text are read.

    Attributes:
        words: what may stand for a value of the input, such as the items of its enumeration.
        converted: text with a unit → its number in the unit of the input, InputError where there is none; None: the
            input is not known, so its values have no units.
    """

    words: Mapping[str, float] = field(default_factory=dict)
    converted: Callable[[str, Meaning], float] | None = None

    def read(self, text: str, meaning: Meaning = "level") -> float:
        """Return the number that a text stands for.

        Args:
            text: a number, with or without a unit, or a word.
            meaning: what the number is.

        Raises:
            InputError: its unit does not convert.
            ValueError: it is none of these.
        """
        if is_number(text) or (meaning == "level" and self.has(text)):
            return self.plain(text)
        try:
            _, unit = quantity(text)
        except DecimalCommaError as error:
            raise InputError(str(error)) from None
        if meaning in _UNITS:
            return _in_one_of(_UNITS[meaning], text)
        if meaning == "count":
            raise InputError(f"'{text}' has a unit; give a whole number")
        if self.converted is None:
            raise InputError(
                f"'{text}' cannot be converted, since the input's unit is not known here; leave '{unit}' out"
            )
        return self.converted(text, meaning)

    def plain(self, text: str) -> float:
        """Return the number that a number without a unit, or a word, stands for.

        Args:
            text: as it was given.

        Raises:
            ValueError: it is neither.
        """
        if not self.has(text):
            raise ValueError(f"'{text}' is not a number")
        return _from_text(text) if is_number(text) else float(self.words[self._word(text)])

    def has(self, text: str) -> bool:
        """Return whether a text is a number without a unit, or a word.

        Args:
            text: as it was given.
        """
        return is_number(text) or self._word(text) in self.words

    def _word(self, text: str) -> str:
        """Return the word that a text is, in small letters where that is how it is known: "true" for "True"."""
        word = text.strip()
        return word.lower() if word not in self.words and word.lower() in self.words else word


def _from_text(text: str) -> float:
    try:
        return exactly(int(text))
    except (OverflowError, ValueError):  # as 1.5, 1e300, or beyond all floats
        return float(text)


def _in_one_of(units: tuple[str, ...], text: str) -> float:
    """Return the number of a text with a unit in the first of several units that are alike; Hz and rev/s are."""
    number, given = quantity(text)
    for unit in units:
        if (result := named_conversion(given, unit)) is not None and not result[1]:
            return in_other_unit(number, result)
    raise InputError(f"'{given}' does not convert to {units[0]}; give it in {units[0]}")


class _AnyWord(dict[str, float]):
    """Words that are not known before the model is open: every one, to see whether the rest can be read."""

    def __contains__(self, word: object) -> bool:
        return bool(word) and not set(":=[]") & set(str(word))

    def __missing__(self, word: str) -> float:
        return 0.0


PLAIN = Numbers()
# Before the model is open: any word and any unit, to see whether the rest of a text can be read.
ANYTHING = Numbers(_AnyWord(), lambda text, _: quantity(text)[0])
