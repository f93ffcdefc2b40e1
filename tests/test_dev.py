"""`scripts/dev.py`: which versions are installed, and that each step can end it. `dev.py checks` plants real faults."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts import checks, dev, environment
from scripts.environment import LOCK, ROOT, Environment, InstallError, moved

PYTHONS = ("3.11.7", "3.12.1", "3.13.0")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def locked(python: str) -> dict[str, str]:
    """The versions that hold on a Python, here; each name stands once."""
    here = {k: str(v) for k, v in default_environment().items()}
    here |= {"python_full_version": python, "python_version": python.rpartition(".")[0]}
    lines = [Requirement(line) for line in LOCK.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    holding = [line for line in lines if line.marker is None or line.marker.evaluate(here)]
    found = {str(canonicalize_name(line.name)): str(line.specifier).removeprefix("==") for line in holding}
    assert len(found) == len(holding)
    return found


def asked() -> list[Requirement]:
    """All that pyproject.toml asks for: to build, to run, for each extra."""
    project = PROJECT["project"]
    extras = [word for words in project["optional-dependencies"].values() for word in words]
    words = [*PROJECT["build-system"]["requires"], *project["dependencies"], *extras]
    return [found for found in map(Requirement, words) if found.name != project["name"]]


@pytest.mark.parametrize("python", PYTHONS)
def test_the_lock_has_all_that_the_project_asks_for(python: str) -> None:
    versions = locked(python)
    absent = [r.name for r in asked() if not r.specifier.contains(versions.get(canonicalize_name(r.name), "0"))]
    assert absent == [], "run scripts/dev.py upgrade with these names"


def test_the_lock_names_versions_and_no_addresses() -> None:
    lines = [line for line in LOCK.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    assert [line for line in lines if not re.fullmatch(r"[\w.-]+==[\w.+!]+( ; [\w\s.'=<>!]+)?", line)] == []
    assert "resolved" not in (ROOT / "tests" / "js" / "package-lock.json").read_text(encoding="utf-8")


def test_what_moved_is_told() -> None:
    old, new = "a==1\nB_c==2 ; python_version < '3.12'\nd==3\n", "a==1\nb-c==2.1\ne==1\n"
    assert moved(old, new) == ["b-c 2 → 2.1", "d 3 → none", "e none → 1"]


def test_what_is_not_locked_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "_logged", lambda *_, **__: "pip==1\nscipy==0.1\nstranger==1.0\n")
    with pytest.raises(
        InstallError, match=r"^scipy==0\.1, stranger==1\.0: not in requirements\.lock; .*upgrade scipy$"
    ):
        Environment()._compare()


@pytest.mark.parametrize("name", ["pyproject.toml", "hatch_build.py", "requirements.lock"])
def test_an_environment_is_made_anew_when_its_settings_change(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for file in ("pyproject.toml", "hatch_build.py", "requirements.lock"):
        (tmp_path / file).write_text("a = 1\n[tool.ruff]\n")
    monkeypatch.setattr(environment, "ROOT", tmp_path)
    monkeypatch.setattr(environment, "LOCK", tmp_path / "requirements.lock")
    made: list[str] = []
    monkeypatch.setattr(Environment, "make", lambda self: made.append(self.name))
    monkeypatch.setattr(Environment, "_install_all", lambda _: None)
    monkeypatch.setattr(Environment, "_compare", lambda _: None)
    (tmp_path / ".venv").mkdir()
    for _ in range(2):
        Environment().ensure()
    assert made == [".venv"]
    (tmp_path / "pyproject.toml").write_text("a = 1\n[tool.ruff]\nline-length = 100\n")
    Environment().ensure()
    assert made == [".venv"]
    (tmp_path / name).write_text("a = 2\n[tool.ruff]\n")
    Environment().ensure()
    assert made == [".venv", ".venv"]


STEPS = [
    "ruff",
    "ruff",
    "eslint",
    "mypy",
    "properdocs",
    "pytest",
    "pytest",
    "scripts.reproduce",
    "build",
    "scripts.evidence",
    "scripts.reproduce",
]


@pytest.mark.parametrize("failing", [*range(len(STEPS)), None])
def test_each_step_of_all_can_end_it(failing: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """In their order, what fails in seconds first; types and pages run beside each other, before the tests."""
    done: list[str] = []

    def step(words: Sequence[str], *_: object, check: bool = True, **__: object) -> subprocess.CompletedProcess[str]:
        result = subprocess.CompletedProcess(list(words), int(len(done) == failing), "")
        done.append(words[0])
        if check:
            result.check_returncode()
        return result

    monkeypatch.setattr(dev, "_module", step)
    monkeypatch.setattr(dev, "_lint_javascript", lambda: step(["eslint"]))
    monkeypatch.setattr(dev, "_ensure_installed", lambda *_: None)
    monkeypatch.setattr(dev, "build", lambda **_: step(["build"], check=False).returncode)
    monkeypatch.setattr(Path, "replace", lambda *_: None)
    try:
        code = dev.everything()
    except subprocess.CalledProcessError as error:
        code = error.returncode
    assert code == int(failing is not None)
    asides = slice(STEPS.index("mypy"), STEPS.index("properdocs") + 1)
    assert sorted(done[asides]) == sorted(STEPS[asides][: len(done[asides])])
    done[asides] = STEPS[asides][: len(done[asides])]
    last = len(STEPS) - 1 if failing is None else failing
    assert done == STEPS[: asides.stop if last in range(*asides.indices(len(STEPS))) else last + 1]


@pytest.mark.parametrize("passes", [True, False])
def test_upgrade_keeps_a_move_that_passes(passes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {name: tmp_path / name for name in ("requirements.lock", "package.json", "package-lock.json")}
    for file in files.values():
        file.write_text("six==1\n")
    newest = Environment("newest", resolution="highest")
    (tmp_path / "newest").mkdir()
    for module in (dev, environment):
        monkeypatch.setattr(module, "LOCK", files["requirements.lock"])
        monkeypatch.setattr(module, "JAVASCRIPT", tmp_path)
    monkeypatch.setattr(environment, "ROOT", tmp_path)
    monkeypatch.setattr(dev, "NEWEST", newest)
    monkeypatch.setattr(Environment, "resolve", lambda self, **_: self.lock.write_text("six==2\n"))
    monkeypatch.setattr(dev, "move_eslint", lambda: files["package-lock.json"].write_text("six==2\n"))
    monkeypatch.setattr(dev, "everything", lambda *, place: 0 if passes and place is newest else 1)
    assert dev.upgrade() == int(not passes)
    assert files["requirements.lock"].read_text() == files["package-lock.json"].read_text() == f"six=={1 + passes}\n"


@pytest.mark.parametrize("check", checks.CHECKS, ids=lambda c: c.name)
def test_each_fault_can_still_be_planted(check: checks.Check, tmp_path: Path) -> None:
    for name in check.faults:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).exists():
            (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    before = [(tmp_path / name).read_bytes() if (tmp_path / name).exists() else None for name in check.faults]
    with checks.changed(check.faults, tmp_path):
        assert all((tmp_path / name).read_bytes() != b for name, b in zip(check.faults, before, strict=True))
    assert [(tmp_path / n).read_bytes() if (tmp_path / n).exists() else None for n in check.faults] == before


def test_words_behind_some_commands_are_their_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They run where they were called, with the project on the path; other commands know their options."""
    called: list[tuple[list[str], str]] = []

    def call(words: Sequence[str], *, env: Mapping[str, str]) -> int:
        called.append(([str(word) for word in words[1:]], env["PYTHONPATH"].split(os.pathsep)[0]))
        return 3

    monkeypatch.setattr(dev, "_ensure_installed", lambda *_: None)
    monkeypatch.setattr(subprocess, "call", call)
    for words in (
        ["reproduce", "3.3", "--json", "x.json", "--help"],
        ["evidence", "nfr", "--cases", "5"],
        ["bench", "nfr", "--against", "x"],
    ):
        monkeypatch.setattr(sys, "argv", ["dev.py", *words])
        assert dev.main() == 3
        assert called.pop() == (["-m", f"scripts.{words[0]}", *words[1:]], str(ROOT))
    monkeypatch.setattr(sys, "argv", ["dev.py", "build", "--chek"])
    with pytest.raises(SystemExit):
        dev.main()
    assert "unrecognized arguments: --chek" in capsys.readouterr().err
    assert called == []
