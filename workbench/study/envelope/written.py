"""What is asked of the record rather than of the analysis: files and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY
from pathlib import Path
from typing import Any

from workbench.core.machine.files import replacing
from workbench.core.records.forms import File
from workbench.core.records.option import option
from workbench.errors import InputError
from workbench.show.cases import JudgedFiles

__all__ = ["EnvelopeFiles"]


class EnvelopeFiles(JudgedFiles):
    """What can be asked of an envelope."""

    _: KW_ONLY
    worst: File | None = option(
        "Write the model of the worst case as a system file, .toml; of several models, each with its name added.",
        default=None,
    )

    def check(self, request: Any) -> None:  # noqa: ANN401 - see `Written`
        super().check(request)
        if self.worst is not None and Path(self.worst).suffix.lower() != ".toml":
            raise InputError(f"--worst: {self.worst} is not a system file; name it .toml")

    def write(self, record: Any) -> Iterator[str | Path]:  # noqa: ANN401 - of a layer above
        yield from super().write(record)
        if self.worst is None:
            return
        systems = {} if record.worst is None else record.worst.systems
        if not systems:
            raise InputError(
                "--worst: the worst case cannot be written as a system file, because its margin is unknown or its "
                "model is neither an FMU nor a system in TOML; run the command lines shown to measure it again"
            )
        path = Path(self.worst)
        for name, text in systems.items():
            file = path if len(systems) == 1 else path.with_stem(f"{path.stem}_{name}")
            with replacing(file) as part:
                part.write_text(text, encoding="utf-8")
            yield file
