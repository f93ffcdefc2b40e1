"""Files that are written: as a whole and on the disk, or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

import workbench as wb
from workbench.core.files import replacing


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is done to files, in its order."""
    done: list[str] = []
    sync, replace = os.fsync, Path.replace

    def synced(file: int) -> None:
        done.append(f"{os.fstat(file).st_size} bytes on the disk")
        sync(file)

    def replaced(path: Path, target: Path) -> Path:
        done.append("renamed")
        return replace(path, target)

    monkeypatch.setattr("os.fsync", synced)
    monkeypatch.setattr(Path, "replace", replaced)
    return done


def test_a_file_is_on_the_disk_before_it_has_its_name(tmp_path: Path, steps: list[str]) -> None:
    with replacing(tmp_path / "out.txt") as part:
        part.write_text("whole")
    assert steps == ["5 bytes on the disk", "renamed"]
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("out.txt", "whole")]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO])
def test_a_disk_that_says_so_only_then_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def full(_: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("os.fsync", full)
    (tmp_path / "out.txt").write_text("old")
    with pytest.raises(wb.InputError, match=f"cannot be written: {os.strerror(number)}"):  # noqa: SIM117
        with replacing(tmp_path / "out.txt") as part:
            part.write_text("new")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("out.txt", "old")]
