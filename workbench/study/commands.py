"""What a study has to know of the commands that do its analyses; the command line tells it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from workbench.errors import InputError, suggest

__all__ = ["Command", "Commands", "Ended", "Option", "RunCommand"]


@dataclass(frozen=True, kw_only=True)
class Option:
    """One option or argument of a command.

    Attributes:
        name: the long name without dashes; of an argument its own name.
        argument: whether it stands without a name.
        flag: whether it takes no value.
        off: what switches a flag off, such as "--no-probe"; empty: it is off unless given.
        multiple: whether it can be given several times.
        metavar: what the help shows in place of the value, such as "A,.." or "NAME=VALUE".
    """

    name: str
    argument: bool = False
    flag: bool = False
    off: str = ""
    multiple: bool = False
    metavar: str = ""


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        name: as it is called.
        options: by every name they have.
    """

    name: str
    options: Mapping[str, Option]

    @property
    def model(self) -> Option | None:
        """The argument that names a model, if there is one."""
        return next((o for o in self.options.values() if o.argument and _is_model(o)), None)

    def option(self, name: str) -> Option:
        """Return the option of a name; underscores stand for hyphens.

        Raises:
            InputError: there is none.
        """
        found = self.options.get(name) or self.options.get(name.replace("_", "-"))
        if found is None:
            raise InputError(f"key '{name}' is not an option of '{self.name}'; {suggest(name, self.options)}")
        return found


def _is_model(option: Option) -> bool:
    return option.metavar.rstrip(".") in ("MODEL", "SYSTEM")


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a command ended.

    Attributes:
        code: its exit code.
        reason: why there is no result; empty: it came to its end.
        bad_input: whether what was asked for cannot be done, rather than that it failed.
        notes: remarks beside the result, one line each.
    """

    code: int
    reason: str = ""
    bad_input: bool = False
    notes: tuple[str, ...] = ()


# Runs a command with its arguments, in the process that calls it; a function of a module, so that it can be sent.
RunCommand = Callable[[Sequence[str]], Ended]


class Commands(ABC):
    """All commands that a study can use.

    Obligations of a subclass:
      1. `run` is a function of a module that writes nothing to standard output or standard error.
      2. `check` finds what the command's own reading of its arguments finds, and runs nothing.
    """

    run: RunCommand

    def __contains__(self, name: str) -> bool:
        """Tell whether a study can use a command of that name."""
        return name in self.names()

    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the commands."""

    @abstractmethod
    def get(self, name: str) -> Command:
        """Return what is known of a command; `name` is one of `names()`."""

    @abstractmethod
    def check(self, name: str, arguments: Sequence[str]) -> None:
        """Read the arguments as the command would.

        Raises:
            InputError: one is missing, or has a value of another type.
        """
