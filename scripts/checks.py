"""What the checks notice: for each check of `dev.py all`, a fault that it must name, planted in a copy of the checkout.

    python scripts/checks.py           all, in twenty minutes; `dev.py checks` runs it
    python scripts/checks.py --list    their names
    python scripts/checks.py docs …    those whose names begin so

First each command is run without a fault: it must pass. Then each fault is planted alone; the command must fail, and
its output must have the words that name the fault. Exit code 1: a check did not notice its fault.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

Change = Callable[[str], str]  # of a file's text; one that is not there is empty


@dataclass(frozen=True)
class Check:
    """A fault and who notices it.

    Attributes:
        name: of the check, and what is planted.
        command: words of `scripts/dev.py`.
        faults: what is changed in which file.
        says: pattern that the output must have.
        beside: what else is changed, also without the fault, so that little runs.
    """

    name: str
    command: tuple[str, ...]
    faults: Mapping[str, Change]
    says: str
    beside: Mapping[str, Change] | None = None


def swap(old: str, new: str) -> Change:
    """Put other words in place of some that stand in the file once."""

    def changed(text: str) -> str:
        if text.count(old) != 1:
            raise ValueError(f"stands {text.count(old)} times there, not once: {old}")
        return text.replace(old, new)

    return changed


def add(words: str) -> Change:
    """Put words at the end; the file may be new."""
    return lambda text: text + words


def one_test(body: str, *, imports: str = "") -> str:
    """Return a module with one test, as lint and formatter want it."""
    return f"{imports}\n\n\ndef test_planted() -> None:\n    {body}\n".lstrip("\n")


PLANTED = "tests/test_modes_planted.py"  # a name that `numerical` runs, too
PAGE = "docs/troubleshooting.md"
CODE = "workbench/signals/gusts.py"
ONLY = dict.fromkeys((f.relative_to(ROOT).as_posix() for f in (ROOT / "tests").glob("test_*.py")), lambda _: "")
ONLY |= {PLANTED: add(one_test("assert True"))}
FAILS = {PLANTED: lambda _: one_test("assert sum([1, 1]) == 3")}


def page(name: str, words: str, says: str) -> Check:
    """A fault in a page that the build of the documentation must refuse."""
    return Check(f"docs: {name}", ("test", "docs"), {PAGE: add(f"\n{words}\n")}, says)


def planted(name: str, body: str, says: str, imports: str = "") -> Check:
    """A test that must end the run."""
    return Check(f"tests: {name}", ("test", PLANTED), {PLANTED: lambda _: one_test(body, imports=imports)}, says, ONLY)


def tested(name: str, tests: str, faults: Mapping[str, Change], says: str) -> Check:
    """A fault that one of the project's tests is there for."""
    return Check(f"helpers: {name}", ("test", tests), faults, says)


def another_byte(text: str) -> str:
    """Change one byte of an archive."""
    return text[:40] + chr(ord(text[40]) ^ 1) + text[41:]


def a_result(text: str) -> str:
    """Give a cell of a notebook a number, as if it had run."""
    return text.replace('"execution_count": null', '"execution_count": 7', 1)


CHECKS = (
    Check("lint: an import that is not used", ("test", "lint"), {CODE: add("\n\nimport json\n")}, r"F401.*\n.*gusts"),
    Check("lint: in a test", ("test", "lint"), {"tests/fakes.py": add("\n\nx = lambda: 1\n")}, r"E731.*\n.*fakes"),
    Check(
        "lint: a line that is not formatted",
        ("test", "lint"),
        {CODE: add('\n\nX = {  "a": 1 }\n')},
        r"reformatted\n.*gusts",
    ),
    Check(
        "lint: JavaScript",
        ("test", "lint"),
        {"workbench/ui/static/api.js": add("\nnotThere();\n")},
        r"api\.js[^$]*no-undef",
    ),
    Check("types: a wrong one", ("test", "types"), {CODE: add('\n\nX: int = "a"\n')}, r"gusts.*\[assignment\]"),
    Check(
        "types: in a test", ("test", "types"), {"tests/fakes.py": add('\n\nX: int = "a"\n')}, r"fakes.*\[assignment\]"
    ),
    Check("types: none", ("test", "types"), {CODE: add("\n\ndef f(x):\n    return x\n")}, r"gusts.*\[no-untyped-def\]"),
    page("a link to no page", "[x](nowhere.md)", "nowhere.md"),
    page("a link to no heading", "[x](index.md#nowhere)", "nowhere"),
    page("a reference to no name", "matrices [first][second]", "second"),
    page("a formula that nothing draws", r"so that $\nosuchthing{a}$", "nosuchthing"),
    page("a picture from elsewhere", "![x](https://example.org/a.png)", "stand alone"),
    page("a picture that is not there", "![x](pictures/nowhere.png)", "nowhere.png"),
    Check("docs: a page that nothing leads to", ("test", "docs"), {"docs/lost.md": add("# Lost\n")}, "lost.md"),
    Check(
        "docs: a heading without its page",
        ("test", "docs"),
        {"properdocs.yml": swap("  - Gallery: gallery.md", "  - Gallery: gone.md")},
        "gone.md",
    ),
    Check(
        "docs: no search without a server",
        ("test", "docs"),
        {"properdocs.yml": swap("  - offline", "  # offline")},
        "searched",
    ),
    Check("tests: one fails, all else passes", ("test",), FAILS, "test_planted.*3", ONLY),
    planted("a process of the tests crashes", "os.abort()", "crashed.*test_planted", "import os"),
    planted(
        "one waits for ever",
        "time.sleep(60)",
        "(?i)timeout",
        "import time\nimport pytest\npytestmark = pytest.mark.timeout(2)",
    ),
    planted("a warning", 'warnings.warn("careless", UserWarning, stacklevel=1)', "careless", "import warnings"),
    planted("a mark that is not declared", "pass", "nowhere", "import pytest\npytestmark = pytest.mark.nowhere"),
    planted("a module that cannot be imported", "pass", "No module named 'nowhere'", "import nowhere"),
    planted("one that was to fail passes", "pass", "XPASS", "import pytest\npytestmark = pytest.mark.xfail"),
    planted("none at all", "pass", "no tests ran", "__test__ = False"),
    tested(
        "a test that is not collected",
        "tests/test_collected.py",
        {"tests/fakes.py": add("\n\ndef test_lost() -> None:\n    assert False\n")},
        "fakes.*test_lost",
    ),
    tested(
        "a misspelt test",
        "tests/test_collected.py",
        {"tests/test_gusts.py": add("\n\ndef tset_lost() -> None:\n    assert False\n")},
        "test_gusts.*tset_lost",
    ),
    tested(
        "a page shows another number",
        "tests/test_docs_examples.py::test_examples_show_what_the_page_says[methods/onset.md]",
        {"docs/methods/onset.md": swap("onset at 0.7534 Hz", "onset at 0.7634 Hz")},
        "onset.md",
    ),
    tested(
        "a tutorial shows another number",
        "tests/test_docs_tutorials.py::test_the_commands_show_what_the_page_says[tutorials/actuator-specification.md]",
        {"docs/tutorials/actuator-specification.md": swap("-0.74302    ≥", "-0.74402    ≥")},
        "actuator-specification.md",
    ),
    tested(
        "a page quotes a message that nobody says",
        "tests/test_docs.py",
        {PAGE: add("\n*The model has eaten its own tail.*\n")},
        "eaten its own tail",
    ),
    tested(
        "the example of a docstring shows another number",
        "tests/test_docstring_examples.py::test_example_of_a_docstring[gust]",
        {CODE: swap("        0.856\n", "        0.857\n")},
        "0.857",
    ),
    tested(
        "a notebook fails",
        "tests/test_examples.py::test_a_notebook_runs_to_its_end[1_foreign_fmu]",
        {"examples/1_foreign_fmu.ipynb": swap("- 5.0) < 0.1", "- 6.0) < 0.1")},
        "AssertionError[^$]*1_foreign_fmu",
    ),
    tested(
        "a notebook with results",
        "tests/test_examples.py::test_a_notebook_is_committed_without_results",
        {"examples/1_foreign_fmu.ipynb": a_result},
        "1_foreign_fmu",
    ),
    tested(
        "the algorithm of CONTRIBUTING.md fails",
        "tests/test_contributing.py",
        {"CONTRIBUTING.md": swap("Constant(held + 1.0)", "Constant(held + 2.0)")},
        "test_the_algorithm_runs",
    ),
    tested(
        "an import goes up",
        "tests/test_layers.py",
        {"workbench/core/values/conversion.py": add("\nfrom workbench.point.lin import request\n")},
        "core.*point.lin",
    ),
    tested(
        "two files name each other, one for a type",
        "tests/test_layers.py",
        {"workbench/fmi/access.py": add("\nif TYPE_CHECKING:\n    from workbench.fmi.instance import Instance\n")},
        "fmi.access.*fmi.instance|fmi.instance.*fmi.access",
    ),
    tested(
        "a parameter is not documented",
        "tests/test_public_api.py",
        {CODE: swap("        value: height of the gust, in the middle.\n", "")},
        "gust.*value",
    ),
    Check(
        "numerical: a test fails on another processor only",
        ("numerical",),
        {PLANTED: lambda _: one_test('assert os.environ.get("OPENBLAS_CORETYPE") != "Prescott"', imports="import os")},
        "test_planted",
        ONLY,
    ),
    Check(
        "numerical: its tests have another name now",
        ("numerical",),
        {"scripts/dev.py": swap('"modes", ', '"nodes", ')},
        "test_nodes",
        ONLY,
    ),
    Check(
        "figures: one is missed",
        ("numerical",),
        {"scripts/reproduce/targets.toml": swap("value = 1.7501\n", "value = 1.7601\n")},
        "example-2-1-working-point|1\\.7601",
        ONLY,
    ),
    Check(
        "evidence: errors of frequency responses are stated too small",
        ("evidence", "nfr", "--nonlinear", "--cases", "6"),
        {"workbench/response/nfr/error.py": swap("return relative_to_true(tr", "return 1e-3 * relative_to_true(tr")},
        r"covers the truth +\d{1,2}\.",
    ),
    Check(
        "build: a byte of an FMU",
        ("build", "--check"),
        {"fmus/fmi2/FirstOrderLag.fmu": another_byte},
        "fmi2/FirstOrderLag.fmu",
    ),
    Check(
        "install: a package that is not locked",
        ("install",),
        {"requirements.lock": swap("\nsix==1.17.0\n", "\n")},
        r"six==.*not in requirements\.lock",
    ),
    Check(
        "install: a version that there is not",
        ("install",),
        {"requirements.lock": swap("\nsix==1.17.0\n", "\nsix==0.0.1\n")},
        r"six==0\.0\.1",
    ),
)


def main() -> int:
    """Try the checks that the command line names, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="beginnings of names; by default all")
    parser.add_argument("--list", action="store_true", help="only show the names")
    arguments = parser.parse_args()
    chosen = [c for c in CHECKS if not arguments.names or c.name.startswith(tuple(arguments.names))]
    if not chosen:
        parser.error(f"no check begins with {', '.join(arguments.names)}")
    if arguments.list:
        print("\n".join(c.name for c in chosen))
        return 0
    with tempfile.TemporaryDirectory(prefix="workbench-checks-") as folder:
        copy = Path(folder) / "copy"
        copied(copy)
        blind = [c.name for c in chosen if not noticed(c, copy)]
    print(f"{len(chosen) - len(blind)} of {len(chosen)} faults were noticed")
    return 1 if blind else 0


def noticed(check: Check, copy: Path) -> bool:
    """Whether a command passes without the fault, and fails with it and names it."""
    with changed(check.beside or {}, copy):
        begins = passes(check.command, tuple((check.beside or {}).items()), copy)
        with changed(check.faults, copy):
            done = ran(check.command, copy)
    named = re.search(check.says, done.stdout) is not None
    verdict = "noticed" if begins and done.returncode and named else "NOT NOTICED"
    print(f"{verdict:<12}{check.name}", flush=True)
    if verdict != "noticed":
        why = "it ended well" if not done.returncode else "it does not name the fault"
        print(f"            {why if begins else 'it fails without the fault, too'}: dev.py {' '.join(check.command)}")
        print("\n".join(f"            | {line}" for line in done.stdout.splitlines()[-15:]), flush=True)
    return verdict == "noticed"


_passed: dict[object, bool] = {}


def passes(command: tuple[str, ...], beside: object, copy: Path) -> bool:
    """Whether a command passes where nothing is planted; found out once."""
    key = command, beside
    if key not in _passed:
        _passed[key] = ran(command, copy).returncode == 0
    return _passed[key]


def ran(command: Sequence[str], copy: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of the copy's `dev.py`; all that it says is in `stdout`."""
    words = [sys.executable, "scripts/dev.py", *command]
    return subprocess.run(words, cwd=copy, check=False, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


@contextmanager
def changed(changes: Mapping[str, Change], copy: Path) -> Iterator[None]:
    """Change files of the copy for as long as it takes."""
    files = {copy / name: change for name, change in changes.items()}
    before = {file: file.read_bytes() if file.exists() else None for file in files}
    for file, change in files.items():
        # `surrogateescape`: bytes of an archive survive.
        file.write_bytes(
            change((before[file] or b"").decode("utf-8", "surrogateescape")).encode("utf-8", "surrogateescape")
        )
    try:
        yield
    finally:
        for file, content in before.items():
            file.unlink() if content is None else file.write_bytes(content)


def copied(copy: Path) -> None:
    """Copy the checkout as it is now, with the compiled kernel, and an environment that leads to this one."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.splitlines()
    kernels = (p.relative_to(ROOT).as_posix() for p in (ROOT / "workbench/kernel/lib").rglob("*") if p.is_file())
    for name in (*listed, *kernels):
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    for name in (".mypy_cache", "tests/js/node_modules"):
        if (ROOT / name).exists():
            shutil.copytree(ROOT / name, copy / name, symlinks=True)
    lead_here(copy)


def lead_here(copy: Path) -> None:
    """Make an environment in which the copy is found first, and then all that is installed in this one."""
    venv.create(copy / ".venv", with_pip=False, symlinks=os.name != "nt")
    site = next(Path(p) for p in sys.path if p.endswith("site-packages"))
    there = copy / ".venv" / site.relative_to(sys.prefix)
    (there / "here.pth").write_text(f"{copy}\nimport site; site.addsitedir({str(site)!r})\n", encoding="utf-8")
    for program in Path(sys.executable).parent.iterdir():  # `python -m ruff` looks for its program beside Python
        if not (copy / ".venv" / site_bin() / program.name).exists():
            shutil.copy2(program, copy / ".venv" / site_bin() / program.name)
    if (Path(sys.prefix) / "foreign").exists():
        shutil.copytree(Path(sys.prefix) / "foreign", copy / ".venv" / "foreign")
    stamp = "from scripts.environment import Environment as E; E().stamp()"
    subprocess.run([sys.executable, "-c", stamp], cwd=copy, check=True)


def site_bin() -> str:
    """Where programs lie in an environment."""
    return Path(sys.executable).parent.name


if __name__ == "__main__":
    sys.exit(main())
