"""Works that have ended, on disk in this user's cache: a restart, also after `kill -9`, shows them again."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

from workbench.core.machine.files import cache_folder, replacing
from workbench.core.records.lazy import homes_in
from workbench.core.records.named import named
from workbench.errors import InputError
from workbench.jobs.store import contents
from workbench.requests.origin import FmuOrigin, ModelFacts, Origin

__all__ = ["Drawer", "Shelf", "origin_from_json", "origin_to_json", "restorable"]

_MOST = 200  # works that are kept; the oldest go first
_FACTS, _RECORD, _POINTS, _STORE = "work.json", "record.json", "points.json", "store"
_REPORT, _SECTIONS = "report.html", "sections.json"
_STUB = Path(__file__).resolve().parents[1] / "__init__.pyi"


class Drawer:
    """What is kept of one work: its facts, its record, its points, its report, its finished measurements.

    Args:
        folder: of its own.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @property
    def number(self) -> int:
        """Number of the work."""
        return int(self._folder.name)

    @property
    def store(self) -> Path:
        """Folder for the finished measurements of a sweep."""
        return self._folder / _STORE

    def finished(self) -> int:
        """Return how many points of a sweep were finished; of a store that cannot be read none count."""
        with suppress(InputError):
            every, _ = contents(self.store)
            return sum(isinstance(v, dict) and "point" in v for stored in every for v in stored.values.values())
        return 0

    def facts(self) -> dict[str, Any] | None:
        """Return the facts of the work; None: they were never written, or cannot be read."""
        facts = _read(self._folder / _FACTS)
        return facts if isinstance(facts, dict) else None

    def write(self, facts: Mapping[str, Any]) -> None:
        """Keep the facts.

        Raises:
            InputError: they cannot be written.
        """
        _write(self._folder / _FACTS, facts)

    def write_result(self, record: Mapping[str, Any], kind: str, points: list[Any]) -> None:
        """Keep a record, and the points that were told; what says that the work has ended is written after them.

        Args:
            record: as JSON has it.
            kind: name of its class.
            points: ready for JSON.

        Raises:
            InputError: they cannot be written.
        """
        _write(self._folder / _POINTS, points)
        _write(self._folder / _RECORD, {"kind": kind, "record": record})

    def remove(self) -> None:
        """Throw all of it away."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def told(self) -> dict[str, Any] | None:
        """Return the record as JSON has it; None: there is none."""
        kept = _read(self._folder / _RECORD)
        return kept["record"] if isinstance(kept, dict) else None

    def record(self) -> Any:  # noqa: ANN401 - any record
        """Return the record; None: there is none, or none that can be read back."""
        kept = _read(self._folder / _RECORD)
        home = _homes().get(kept["kind"]) if isinstance(kept, dict) else None
        if home is None:
            return None
        try:
            return named(f"{home}:{kept['kind']}").from_dict(kept["record"])
        except InputError:
            return None

    def points(self) -> list[dict[str, Any]]:
        """Return the points that were told."""
        return _read(self._folder / _POINTS) or []

    def report(self) -> bytes | None:
        """Return the report; None: it was not made yet."""
        return self._page(_REPORT)

    def write_report(self, page: bytes) -> None:
        """Keep the report; where that cannot be, it is made again when it is asked for."""
        self._write_page(_REPORT, page)

    def sections(self) -> bytes | None:
        """Return the sections of the page; None: they were not made yet."""
        return self._page(_SECTIONS)

    def write_sections(self, page: bytes) -> None:
        """Keep the sections of the page, as `write_report` does."""
        self._write_page(_SECTIONS, page)

    def _page(self, name: str) -> bytes | None:
        with suppress(OSError):
            return (self._folder / name).read_bytes()
        return None

    def _write_page(self, name: str, page: bytes) -> None:
        with suppress(InputError), replacing(self._folder / name) as part:
            part.write_bytes(page)


class Shelf:
    """The works of one served folder.

    Args:
        served: the folder.
    """

    def __init__(self, served: Path) -> None:
        name = hashlib.sha256(str(served).encode("utf-8", "surrogateescape")).hexdigest()[:16]
        self._folder = cache_folder("ui") / name

    def drawers(self) -> Iterator[Drawer]:
        """Yield what was kept, in order of number; what is too old is thrown away."""
        try:
            found = sorted((f for f in self._folder.iterdir() if f.name.isdigit()), key=lambda f: int(f.name))
        except OSError:
            return
        for old in found[:-_MOST]:
            shutil.rmtree(old, ignore_errors=True)
        for folder in found[-_MOST:]:
            yield Drawer(folder)

    def new(self, least: int) -> Drawer:
        """Return a place for a work, with a number that no other server has taken.

        Args:
            least: the lowest number that it may have.

        Raises:
            InputError: nothing can be kept.
        """
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            for number in count(least):
                with suppress(FileExistsError):
                    (self._folder / str(number)).mkdir()
                    break
        except OSError as error:
            raise InputError(f"{self._folder}: cannot be made: {error.strerror or error}") from None
        return Drawer(self._folder / str(number))


def _homes() -> Mapping[str, str]:
    return homes_in(str(_STUB))


def restorable(record: object) -> bool:
    """Return whether a record can be read back: that of a study cannot.

    Args:
        record: any.
    """
    return type(record).__name__ in _homes()


def origin_to_json(origin: Origin) -> dict[str, Any]:
    """Return how a record was made, ready for JSON."""
    return {**asdict(origin), "when": origin.when.isoformat()}


def origin_from_json(data: Mapping[str, Any]) -> Origin:
    """Return what `origin_to_json` wrote."""
    models = tuple(
        ModelFacts(**{**m, "fmus": tuple(FmuOrigin(**f) for f in m["fmus"]), "notes": tuple(m["notes"])})
        for m in data["models"]
    )
    when = datetime.fromisoformat(data["when"])
    return Origin(**{**data, "models": models, "notes": tuple(data["notes"]), "when": when})


def _read(file: Path) -> Any:  # noqa: ANN401 - whatever JSON holds
    try:
        return json.loads(file.read_bytes())
    except (OSError, ValueError):
        return None


def _write(file: Path, content: object) -> None:
    with replacing(file) as part:
        part.write_text(json.dumps(content), encoding="utf-8")
