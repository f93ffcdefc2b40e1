"""Finished measurements on disk, in one SQLite file; they survive `kill -9` and power cuts.

SQLite notices what is wrong with its pages, not what is wrong with their contents: each row has a check sum of its own.
The journal is the one that needs locks of files and nothing else; the write-ahead log would need memory that the
processes share, which a network file system does not give.
"""

from __future__ import annotations

import hashlib
import json
import math
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from workbench.core.machine.closable import Closable
from workbench.core.records.parsing import from_json
from workbench.errors import InputError, WorkbenchError

__all__ = ["FILE_NAME", "Store", "StoredSet", "contents"]

FILE_NAME = "measurements.sqlite"

# Written into the file's header, so that another program's database is not taken for ours: "FMIW".
_APPLICATION, _LAYOUT = 0x464D4957, 2

# Longest time that one process waits for another's write [s].
_PATIENCE = 30.0

# Damaged points that are named in a remark.
_SHOWN = 3

_PRIMARY = 0xFF  # bits of SQLite's error codes that are not the details

_TABLES = """
CREATE TABLE IF NOT EXISTS settings (
    id INTEGER PRIMARY KEY,
    subject TEXT NOT NULL,
    effort TEXT NOT NULL,
    text TEXT NOT NULL,
    UNIQUE (subject, effort)
);
CREATE TABLE IF NOT EXISTS measurements (
    settings INTEGER NOT NULL REFERENCES settings (id),
    point TEXT NOT NULL,
    value TEXT NOT NULL,
    made TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    PRIMARY KEY (settings, point)
) WITHOUT ROWID;
"""

_COLUMNS = (
    "SELECT settings, text, point, value, made, sha256 FROM measurements LEFT JOIN settings ON settings.id = settings"
)
_SAME_SETTINGS = f"{_COLUMNS} WHERE settings.id = ? ORDER BY made"
_EVERYTHING = f"{_COLUMNS} ORDER BY made"
_ONE = f"{_COLUMNS} WHERE settings.id = ? AND point = ?"
_SAME_SUBJECT = f"{_COLUMNS} WHERE settings.subject = ? ORDER BY made"
_NEXT = "SELECT min(settings) FROM measurements WHERE settings > ?"
_OF_NUMBER = "SELECT point FROM measurements WHERE settings = ?"
_INSERT = "INSERT OR REPLACE INTO measurements (settings, point, value, made, sha256) VALUES (?, ?, ?, ?, ?)"

_Row = tuple[int, Any, Any, Any, Any, Any]  # as the columns


class Store(Closable):
    """The finished measurements of one subject, in a folder that many subjects and processes share.

    Obligations:
      1. After `save` returns, the measurement is on disk: journal and file are flushed at each commit.
      2. Only what was saved under the same subject is ever returned; a row that has changed since is not.
      3. Several processes may save and load at once, also of several machines, where the file system locks files.
      4. A lock that another process does not give back within 30 s is an error, not waited for.

    Args:
        folder: made if it is not there.
        subject: everything that influences a value, ready for JSON: the FMU's hash, settings, versions.
        effort: how hard is tried, ready for JSON: told apart from the subject since `latest` looks past it.

    Raises:
        InputError: the folder cannot be used, or its file is damaged or no store.

    Attributes:
        damaged: points whose rows have changed since they were saved, as far as they were read; they are not there.
    """

    def __init__(self, folder: str | Path, *, subject: Mapping[str, Any], effort: Mapping[str, Any]) -> None:
        self.path = Path(folder) / FILE_NAME
        self._subject, self._effort = _canonical(subject), _canonical(effort)
        self._text = f'{{"subject": {self._subject}, "effort": {self._effort}}}'
        self.damaged: list[str] = []
        try:
            Path(folder).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"store {folder}: cannot be made: {error.strerror or error}") from None
        with _told_in_one_line(self.path):
            self._database = _connected(self.path)
        try:
            with _told_in_one_line(self.path):
                self._prepare()
        except BaseException:
            self._database.close()
            raise

    def _prepare(self) -> None:
        database = self._database
        # In this order: another process that makes the store meanwhile writes tables and mark together.
        (tables,) = database.execute("SELECT count(*) FROM sqlite_master").fetchone()
        (application,) = database.execute("PRAGMA application_id").fetchone()
        if application != _APPLICATION and tables:
            raise InputError(f"{self.path}: is a database of another program; name another folder for the store")
        (layout,) = database.execute("PRAGMA user_version").fetchone()
        if tables and layout != _LAYOUT:
            age = "a newer" if layout > _LAYOUT else "an older"
            raise InputError(f"{self.path}: was made by {age} workbench; move it away or name another folder")
        # EXTRA also flushes the folder: a journal that came back after a power cut would undo the last point.
        database.execute("PRAGMA synchronous = EXTRA")
        marks = f"PRAGMA application_id = {_APPLICATION}; PRAGMA user_version = {_LAYOUT};"
        database.executescript(f"BEGIN IMMEDIATE; {_TABLES} {marks} COMMIT;")
        self._settings = self._settings_row()
        self.damaged += self._astray()

    def _settings_row(self) -> int:
        key = (_hash(self._subject), _hash(self._effort))
        self._database.execute(
            "INSERT INTO settings (subject, effort, text) VALUES (?, ?, ?)"
            " ON CONFLICT (subject, effort) DO UPDATE SET text = excluded.text WHERE text IS NOT excluded.text",
            (*key, self._text),
        )
        result = self._database.execute("SELECT id FROM settings WHERE subject = ? AND effort = ?", key).fetchone()
        return int(result[0])

    def _astray(self) -> list[str]:
        """Return the points to which nothing leads any more: the key of their settings has changed, or its number."""
        rows = self._database.execute("SELECT id, subject, effort, text FROM settings ORDER BY id").fetchall()
        sound = {tuple(key): number for number, *key, text in rows if key == _keys(text)}.values()  # of each the last
        result: list[str] = []
        number = -math.inf
        while (number := self._database.execute(_NEXT, (number,)).fetchone()[0]) is not None:
            if number not in sound:
                result += [repr(point) for (point,) in self._database.execute(_OF_NUMBER, (number,))]
        return result

    def save(self, point: str, value: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Keep the value of a point; an earlier one under the same settings is replaced.

        Args:
            point: what was measured.
            value: ready for JSON; numbers come back exactly.

        Raises:
            WorkbenchError: it cannot be written, e.g. because the disk is full.
        """
        text, made = json.dumps(value), datetime.now(UTC).isoformat(timespec="milliseconds")
        row = (self._settings, point, text, made, _check_sum(self._text, point, text, made))
        with _told_in_one_line(self.path, WorkbenchError):
            self._database.execute(_INSERT, row)

    def load(self) -> dict[str, Any]:
        """Return the values measured under exactly these settings, by point."""
        return self._values(_SAME_SETTINGS, self._settings)

    def get(self, point: str) -> Any:  # noqa: ANN401 - as it went in
        """Return the value of one point, measured under exactly these settings; None: there is none."""
        return self._values(_ONE, self._settings, point).get(point)

    def latest(self) -> dict[str, Any]:
        """Return the newest value of each point of the subject, whatever the effort."""
        return self._values(_SAME_SUBJECT, _hash(self._subject))

    def _values(self, query: str, *keys: int | str) -> dict[str, Any]:
        with _told_in_one_line(self.path):
            sound, damaged = _parted(self._database.execute(query, keys).fetchall())
            self.damaged += [point for point in damaged if point not in self.damaged]
            return {point: from_json(value) for _, _, point, value, *_ in sound}

    def remarks(self) -> list[str]:
        """Return what was found damaged, in a line."""
        return _remarks(self.path, self.damaged)

    @contextmanager
    def taken_apart(self) -> Iterator[None]:
        """Name the file in the error of whoever makes records of its values, which somebody may have changed there.

        Raises:
            InputError: a value is not what it should be.
        """
        try:
            yield
        except (WorkbenchError, AttributeError, KeyError, TypeError, ValueError) as error:
            raise InputError(_damaged(self.path, error)) from None

    def close(self) -> None:
        """Close the file. Any number of times."""
        self._database.close()


@contextmanager
def _told_in_one_line(path: Path, kind: type[WorkbenchError] = InputError) -> Iterator[None]:
    """Turn what SQLite raises into one line, and what is raised by whoever takes apart what somebody changed there.

    Args:
        path: of the store.
        kind: of the error that tells it.

    Raises:
        WorkbenchError: of that kind.
    """
    try:
        yield
    except sqlite3.OperationalError as error:
        raise kind(f"{path}: {_why_unusable(error)}") from None
    except (sqlite3.DatabaseError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise kind(_damaged(path, error)) from None


def _damaged(path: Path, error: Exception) -> str:
    line = next(iter(str(error).splitlines()), type(error).__name__)
    return f"{path}: is damaged or no store of the workbench ({line}); move it away or name another folder"


def _canonical(value: Mapping[str, Any]) -> str:
    """One text for equal settings: keys sorted, numbers as Python writes them, which is exact."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


@dataclass(frozen=True)
class StoredSet:
    """What was measured under the same settings.

    Attributes:
        subject: everything that influences a value, as it went in.
        effort: how hard was tried, as it went in.
        values: point → result, as they went in; in the order in which they were measured.
    """

    subject: dict[str, Any]
    effort: dict[str, Any]
    values: dict[str, Any]


def contents(folder: str | Path) -> tuple[list[StoredSet], list[str]]:
    """Return everything that a store holds, and what was found damaged, in a line; nothing in it is changed.

    Args:
        folder: of the store.

    Raises:
        InputError: there is no store, or it is damaged.
    """
    path = Path(folder) / FILE_NAME
    result: dict[int, StoredSet] = {}
    with (
        _told_in_one_line(path),
        closing(_connected(f"{path.absolute().as_uri()}?mode=rw", uri=True)) as database,
    ):
        sound, damaged = _parted(database.execute(_EVERYTHING).fetchall())
        for number, text, point, value, *_ in sound:
            if number not in result:
                settings = from_json(text)
                result[number] = StoredSet(dict(settings["subject"]), dict(settings["effort"]), {})
            result[number].values[point] = from_json(value)
    return list(result.values()), _remarks(path, damaged)


def _remarks(path: Path, damaged: list[str]) -> list[str]:
    if not damaged:
        return []
    which = ", ".join(damaged[:_SHOWN]) + ", …" * (len(damaged) > _SHOWN)
    what = f"{len(damaged)} stored values have changed on the disk since they were measured ({which})"
    return [f"{path}: {what} and count as not measured: is the disk failing?"]


def _connected(name: str | Path, *, uri: bool = False) -> sqlite3.Connection:
    result = sqlite3.connect(name, uri=uri, timeout=_PATIENCE, isolation_level=None)
    result.text_factory = lambda text: text.decode("utf-8", "replace")  # damaged text is for the check sum to notice
    return result


def _parted(rows: list[_Row]) -> tuple[list[_Row], list[str]]:
    """Return the rows that are what was saved, and the points of the others."""
    sound: list[_Row] = []
    damaged: list[str] = []
    for row in rows:
        if _is_sound(row):
            sound.append(row)
        else:
            damaged.append(repr(row[2]))
    return sound, damaged


def _is_sound(row: _Row) -> bool:
    """Return whether a row is what was saved."""
    _, *texts, check = row
    return all(isinstance(text, str) for text in texts) and check == _check_sum(*texts)


def _keys(text: object) -> list[str]:
    """Return the keys under which settings are found; none where their text is damaged."""
    try:
        settings = from_json(str(text))
        return [_hash(_canonical(settings[part])) for part in ("subject", "effort")]
    except (KeyError, TypeError, ValueError):
        return []


def _check_sum(*texts: str) -> str:
    return _hash(json.dumps(texts))


def _why_unusable(error: sqlite3.OperationalError) -> str:
    if getattr(error, "sqlite_errorcode", 0) & _PRIMARY == sqlite3.SQLITE_BUSY:
        return f"another process has kept it locked for {_PATIENCE:g} s; end that one, or name another folder"
    return f"cannot be used: {error}"


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
