"""Files that are written: as a whole and on the disk, or not at all; files that are read: an end, a depth."""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import pytest

import workbench as wb
from tests.platforms import posix_signals
from workbench.cli.app import run
from workbench.core.machine.files import content_of, replacing
from workbench.core.records.parsing import from_json, from_toml
from workbench.ui.root import ServedFolder


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


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="an endless file is needed; this system has no /dev/zero")
@pytest.mark.parametrize(
    "line",
    [
        "identify zero.csv --input u --output y",
        "simulate fmu:FirstOrderLag --stop 1 --input u=zero.csv",
        "simulate fmu:FirstOrderLag --stop 1 --at zero.json",
        "info zero.toml",
        "info zero.ssp",
        "info zero.ssd",
        "run zero.toml",
        "build zero.mo --out zero.fmu",
    ],
)
def test_a_device_that_has_no_end_is_not_read(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for suffix in ("csv", "json", "toml", "ssp", "ssd", "mo"):
        (tmp_path / f"zero.{suffix}").symlink_to("/dev/zero")
    assert run(line.split()) == 2
    told = [text for text in capsys.readouterr().err.splitlines() if text.startswith("workbench: ")]
    assert len(told) == 1
    assert re.search("device|not a file|no such file", told[0])


@posix_signals
def test_a_pipe_is_read(tmp_path: Path) -> None:
    pipe = tmp_path / "data.csv"
    os.mkfifo(pipe)
    writer = Thread(target=pipe.write_text, args=("0,1\n2,3\n",))
    writer.start()
    assert content_of(pipe) == b"0,1\n2,3\n"
    writer.join()


@posix_signals
def test_the_browser_s_list_does_not_wait_for_pipes(tmp_path: Path) -> None:
    for name in ("a.json", "a.toml", "a.fmu"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "b.toml").write_text("[components]\n", encoding="utf-8")
    root = ServedFolder(tmp_path)
    assert [entry["name"] for entry in root.listing() if ":" not in entry["name"]] == ["b.toml"]
    with pytest.raises(wb.InputError, match=r"a\.toml: cannot be read as text"):
        root.text_of("a.toml")


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="a full disk is needed; only Linux has /dev/full, which acts as one"
)
def test_a_file_that_cannot_be_written_does_not_cost_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, page = tmp_path / "out.json", tmp_path / "out.html"
    files = ["--csv", "/dev/full", "--json", str(data), "--report", str(page)]
    assert run(["simulate", "fmu:FirstOrderLag", "--stop", "1", *files]) == 2
    shown = capsys.readouterr()
    assert shown.err.splitlines()[-1] == "workbench: /dev/full: cannot be written: No space left on device"
    assert [line for line in shown.out.splitlines() if line.startswith("wrote")] == [f"wrote {data}", f"wrote {page}"]
    assert len(json.loads(data.read_text(encoding="utf-8"))["time"]) > 10
    assert "</html>" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * 50_000) + " = 1",
        "[" + " . ".join(['"a"'] * 50_000) + "]",
        "x = {" + ".".join(["a"] * 50_000) + " = 1}",
        "a = " + "[" * 5000 + "]" * 5000,
    ],
)
def test_toml_that_is_nested_endlessly_is_refused_before_it_takes_minutes(text: str) -> None:
    """Python's own reader needs time with the square of the number of dots."""
    with pytest.raises(ValueError, match="nested more than 100 deep"):
        from_toml(text)


def test_dots_in_values_nest_nothing() -> None:
    names = ", ".join(f"plant.x{k}.y" for k in range(200))
    assert from_toml(f'name = "{names}"\na.b.c = 1')["name"] == names


@pytest.mark.parametrize("read", [from_json, lambda text: from_toml(f"a = {text}")])
def test_a_number_of_thousands_of_digits_is_told_in_plain_words(read: Callable[[str], object]) -> None:
    with pytest.raises(ValueError, match=r"^a number has more than 4300 digits$"):
        read("1" * 5000)
