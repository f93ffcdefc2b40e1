"""Faults and mutants: that they are where they are said to be, and that a changed text is what Python runs."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.covered import Covered, is_recorded, read, record
from scripts.covered import Test as CoveredTest
from scripts.mutants import FOLDERS, fresh, mutants_of
from scripts.plant_faults import Fault, main, read_faults
from scripts.planting import ROOT, run_planted
from scripts.reproduce.select import select

PACKAGE = ROOT / "workbench"


def test_every_fault_is_one_line_that_is_there() -> None:
    faults = read_faults()
    assert len(faults) >= 40
    assert {f.area for f in faults} == {"nfr", "lin", "reduction", "feedback", "identification", "models"}
    for fault in faults:
        before, after = (t.splitlines() for t in (fault.file.read_text(encoding="utf-8"), fault.text()))
        assert sum(a != b for a, b in zip(before, after, strict=False)) >= 1, fault.words
        ast.parse(fault.text())
        assert select(fault.targets), fault.words


def test_a_fault_that_is_not_there_is_told() -> None:
    with pytest.raises(SystemExit, match="'nothing like it' occurs 0 times"):
        Fault(area="lin", module="core/values/poles", targets=(), old="nothing like it", new="").text()


def test_areas_are_known(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["nosuch"])
    assert "there are nfr, lin" in capsys.readouterr().err
    assert main(["--list", "models"]) == 0
    assert "Rudder: loopGain = 0.52" in capsys.readouterr().out


def test_a_changed_module_is_what_runs_in_this_process_and_its_children() -> None:
    file = PACKAGE / "core" / "values" / "decibels.py"
    text = file.read_text(encoding="utf-8").replace("20.0 * np.log10", "10.0 * np.log10")
    own = "from workbench.core.values.decibels import decibels; print(float(decibels(10.0)))"
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {own!r}], check=True)"
    for code in (own, child):
        assert run_planted(["-c", code], file, text, timeout=60.0).stdout.split() == ["10.0"]
    assert run_planted(["-c", own], None, "", timeout=60.0).stdout.split() == ["20.0"]
    assert "planted" not in " ".join(sys.path)


SOURCE = '''"""A - b."""
from __future__ import annotations

LIMIT: float = 2.0


def f(a: int, b: float) -> bool:
    """Return a < b."""
    if a is not None and not b:
        raise ValueError(f"{a - 1} is less than {b + 1}")
    return max(a, -b) <= LIMIT * (a) ** (b)
'''
WANTED = {
    "2.0 → 4.0", "is not → is", "and → or", "not b → (b)", "max → min", "-b → (b)", "<= → <", "* → /", "** → *"
}  # fmt: skip


def test_what_is_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "module.py"
    file.write_text(SOURCE, encoding="utf-8")
    monkeypatch.setattr("scripts.mutants.ROOT", tmp_path)
    found = mutants_of(file)
    assert {m.words.split(": ", maxsplit=1)[1] for m in found} == WANTED
    for mutant in found:
        ast.parse(mutant.text())
        assert sum(a != b for a, b in zip(SOURCE.splitlines(), mutant.text().splitlines(), strict=True)) == 1


def test_mutants_of_the_package_are_python_and_follow_from_the_seed() -> None:
    paths = [PACKAGE / name for name in FOLDERS]
    some = fresh(paths, 40, 1)
    few = [PACKAGE / "kernel"]
    assert fresh(few, 10, 1) == fresh(few, 10, 1) != fresh(few, 10, 2)
    for mutant in some:
        ast.parse(mutant.text())
    assert {m.file.relative_to(PACKAGE).parts[0] for m in some} <= set(FOLDERS)


TESTS = """
import os
import subprocess
import sys
from workbench.core.values.decibels import decibels
CODE = "from workbench.core.values.decibels import decibels; decibels(10.0)"

def test_here():
    assert decibels(10.0) == 20.0

def test_in_a_child():
    subprocess.run([sys.executable, "-c", CODE], check=True)

def test_fails():
    assert decibels(10.0) == 10.0

def test_other():
    pass
"""


def test_tests_are_known_by_the_lines_that_they_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "test_decibels.py"
    file.write_text(TESTS, encoding="utf-8")
    monkeypatch.setattr("scripts.covered.FOLDER", tmp_path)
    module = PACKAGE / "core" / "values" / "decibels.py"
    (line,) = (i for i, row in enumerate(module.read_text(encoding="utf-8").splitlines(), 1) if "np.log10" in row)
    assert not is_recorded([(module, line)])
    assert record([(module, line)], [str(file)]) == 1
    assert is_recorded([(module, line)])
    assert not is_recorded([(PACKAGE / "core" / "values" / "modal.py", 137)])
    read.cache_clear()
    try:
        known = read()
    finally:
        read.cache_clear()
    running = known.running(module, line)
    assert {t.name.partition("::")[2] for t in running} == {"test_here", "test_in_a_child"}
    file.write_text(TESTS.replace("test_here", "test_here_now"), encoding="utf-8")
    assert record([(module, line)], [str(file)], again=True) == 1
    read.cache_clear()
    try:
        again = read()
    finally:
        read.cache_clear()
    assert {t.name.partition("::")[2] for t in again.running(module, line)} == {"test_here_now", "test_in_a_child"}
    assert len(again.tests) == len(known.tests)
    assert [t.name.partition("::")[2] for t in known.beside(running)] == ["test_other"]
    assert known.running(PACKAGE / "core" / "values" / "modal.py", 137) == []


def test_a_constant_is_run_where_its_name_is_used(tmp_path: Path) -> None:
    file = tmp_path / "package" / "module.py"
    file.parent.mkdir()
    file.write_text("_MOST = 2\n\n\ndef f(a=3):\n    b = 2\n    return min(a, _MOST)\n", encoding="utf-8")
    tests = {n: CoveredTest(f"t{n}", 3.0 - n) for n in (1, 2)}
    known = Covered(tests, {file: {5: {1, 2}, 6: {2, 3}}})
    assert known.running(file, 1) == [tests[2]]  # the third one has not passed
    assert known.running(file, 4) == [tests[2], tests[1]]  # a default
    assert known.running(file, 5) == [tests[2], tests[1]]


def test_a_quick_run_leaves_out_what_took_longest(tmp_path: Path) -> None:
    """`pytest --quick` of a folder with the project's conftest: the quickest that take so long, and new ones."""
    for folder in ("tests", "build-cache"):
        (tmp_path / folder).mkdir()
    code = (ROOT / "tests" / "conftest.py").read_text(encoding="utf-8")
    (tmp_path / "tests" / "conftest.py").write_text(code, encoding="utf-8")
    names = ("slow", "quick", "medium", "new")
    (tmp_path / "tests" / "test_a.py").write_text(
        "\n".join(f"def test_{name}():\n    pass\n" for name in names), encoding="utf-8"
    )
    (tmp_path / "setup.cfg").write_text("[tool:pytest]\ntestpaths = tests\n", encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "--quick=3"]

    def ran() -> tuple[int, set[str], str]:
        done = subprocess.run(
            command,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        return done.returncode, {n for n in names if f"test_{n} PASSED" in done.stdout}, done.stdout + done.stderr

    assert "run scripts/dev.py test once" in ran()[2]
    took = {"slow": 9.0, "quick": 1.0, "medium": 2.0}
    rows = "".join(f'<testcase classname="tests.test_a" name="test_{n}" time="{s}"/>' for n, s in took.items())
    (tmp_path / "build-cache" / "tests.xml").write_text(f"<testsuite>{rows}</testsuite>", encoding="utf-8")
    assert ran()[:2] == (0, {"quick", "medium", "new"})
