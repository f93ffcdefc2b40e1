"""The requirement `drift`: a limit of what the command of that name finds."""

from __future__ import annotations

from workbench.errors import InputError, suggest
from workbench.study.requirements.base import Limited, Result, Value


class DriftLimit(Limited):
    """How far outputs move by themselves.

    Attributes:
        output: the one that is meant; None: each.
    """

    commands = ("drift",)

    output: str | None = None

    def values(self, result: Result) -> list[Value]:
        """Return the drift of the outputs that are meant."""
        found = zip(result["outputs"], result["drift"], result["units"], strict=True)
        if self.output is not None and self.output not in result["outputs"]:
            raise InputError(
                f"{self.name}: there is no output '{self.output}'; {suggest(self.output, result['outputs'])}"
            )
        return [Value(value=d, where=name, unit=u) for name, d, u in found if self.output in (None, name)]
