#!/usr/bin/env python3
"""Everything a developer or newcomer starts: install, demo, test, build, release.

    python3 scripts/dev.py demo       measure the bundled rudder, print the table, draw the Bode picture
    python3 scripts/dev.py test       lint, types, documentation, tests (--quick: those that take four minutes), or only
                                      the named ones: lint, types, docs, tests, tests/test_loop.py …
    python3 scripts/dev.py all        test, numerical, build --check, evidence, reproduce: what CI does
    python3 scripts/dev.py reproduce  the published figures, measured now (CHAPTER …, --json PATH, --report PATH)
    python3 scripts/dev.py evidence   how often promises are kept over random models, in short (NAME …: one in full)
    python3 scripts/dev.py bench      what users wait for, beside its peers (NAME …, --quick, --against CHECKOUT)
    python3 scripts/dev.py upgrade    move requirements.lock to the newest versions (of PACKAGE …), if all of that holds
    python3 scripts/dev.py checks     plant a fault for each check of `all` and see that it is noticed
    python3 scripts/dev.py numerical  the numerical tests and published figures in the arithmetic of another processor
    python3 scripts/dev.py mutants    change the numerical code: which changes does no test notice? (PATH …)
    python3 scripts/dev.py faults     plant faults: which ones do the published figures notice?
    python3 scripts/dev.py build      rebuild the bundled FMUs from modelica_src/ (--check: only compare)
    python3 scripts/dev.py release    source archive, wheels of all platforms, bill of materials into dist/ (--out)
    python3 scripts/dev.py install    make .venv with the project in it (the others do it when needed)

All versions are those of requirements.lock; `test --newest` and `test --lowest` use the newest and the lowest that
pyproject.toml admits. Standard library only; Linux, macOS, Windows. Needs Python 3.11 or newer with venv and pip, and
a package registry; no compiler.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from scripts.environment import JAVASCRIPT, LOCK, ROOT, Environment, InstallError, move_eslint, moved, with_eslint

LOCKED, NEWEST, LOWEST = (
    Environment(),
    Environment(".venv-newest", resolution="highest"),
    Environment(".venv-lowest", resolution="lowest"),
)
DEMO = ROOT / "demo"

# Whose results depend on the order in which BLAS adds, as it takes other paths on other processors: where ranks, orders
# and eigenvalues are decided. What the kernel computes, and where Newton's method ends, do not depend on it.
NUMERICAL = (
    *("absolute", "core_poles", "feed_forward_aircraft", "fit", "identified", "identify", "lin_", "loop.py"),
    *("modes", "reduction", "spectra", "subspace", "trim", "validate"),
)
# And of the published figures: linear models, identification, orders; not what is simulated.
NUMERICAL_FIGURES = ("3", "6", "7", "feed-forward-orders", "feed-forward-cancelled", "feed-forward-mirrored")

# The oldest x86 processor that OpenBLAS knows: 128-bit vectors without fused multiplication, so that it differs most
# from what a present machine takes by itself.
OTHER_PROCESSOR = "Prescott"

# Two test processes at most: many tests have worker processes of their own. One that crashes ends the run, with the
# name of the test: pytest-xdist may otherwise wait for ever for the process that it starts in its place.
PROCESSES = ("--numprocesses", str(min(2, os.cpu_count() or 1)), "--dist", "loadfile", "--max-worker-restart", "0")
PYTEST = ("pytest", "-q", *PROCESSES)
# How long each test took, which `--quick` chooses by: as many as take four minutes in two processes.
LAST_RUN = ROOT / "build-cache" / "tests.xml"
QUICK = 2 * 220.0  # [s]

# What `test` does, in this order: what fails soonest first. Where ProperDocs is `--quiet`, `--strict` counts nothing.
PARTS = ("lint", "types", "docs", "tests")
LINT = (("ruff", "check", "."), ("ruff", "format", "--check", "."))
ASIDE = {"types": ("mypy",), "docs": ("properdocs", "build", "--strict")}  # one process each
FIGURES, EVIDENCE, BENCH = ("scripts.reproduce",), ("scripts.evidence",), ("scripts.bench",)
OWN_WORDS = ("reproduce", "evidence", "bench")  # commands that read the words behind their names

# Compiles the inner loop where its C sources have changed since; an installation compiles it, too. And the modules:
# many processes that start at once would all do it.
COMPILE = """
from compileall import compile_dir
from pathlib import Path
from workbench.build.toolchain import compile_kernel, host_only
compile_kernel(Path("workbench/kernel"), host_only())
for folder in ("workbench", "tests"):
    compile_dir(folder, quiet=1)
"""


def main() -> int:
    """Run the command given on the command line and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, function in COMMANDS.items():
        help_ = (function.__doc__ or "").splitlines()[0]
        commands.add_parser(name, help=help_, add_help=name not in OWN_WORDS)
    words = f"{', '.join(PARTS)}, or files with tests; by default all"
    commands.choices["test"].add_argument("parts", nargs="*", metavar="PART", help=words)
    versions = commands.choices["test"].add_mutually_exclusive_group()
    versions.add_argument(
        "--newest", action="store_true", help="with the newest versions, whatever requirements.lock says"
    )
    versions.add_argument("--lowest", action="store_true", help="the tests with the lowest versions of pyproject.toml")
    commands.choices["upgrade"].add_argument("packages", nargs="*", metavar="PACKAGE", help="by default all")
    commands.choices["checks"].add_argument("names", nargs="*", metavar="CHECK", help="by default all")
    commands.choices["test"].add_argument(
        "--quick", action="store_true", help="leave out the tests that took longest in the last whole run: four minutes"
    )
    commands.choices["build"].add_argument("--check", action="store_true", help="compare with fmus/, change nothing")
    commands.choices["release"].add_argument("--out", type=Path, default=ROOT / "dist", help="folder for the files")
    commands.choices["mutants"].add_argument("paths", nargs="*", help="files or folders; by default the numerical ones")
    commands.choices["mutants"].add_argument("--count", type=int, default=300, help="how many changes are tried")
    commands.choices["mutants"].add_argument("--record", action="store_true", help="first record which tests run what")
    commands.choices["faults"].add_argument("areas", nargs="*", help="nfr, lin, reduction, …; by default all")
    arguments, rest = parser.parse_known_args()
    if arguments.command in OWN_WORDS:
        arguments.words = rest
    elif rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    if sys.version_info < (3, 11):  # noqa: UP036 - it is run by whatever Python the newcomer has
        return _complain(f"needs Python 3.11 or newer, this is {sys.version.split()[0]}")
    try:
        options = {name: value for name, value in vars(arguments).items() if name != "command"}
        return COMMANDS[arguments.command](**options)
    except subprocess.CalledProcessError as error:
        return _complain(f"failed ({error.returncode}): {shlex.join(map(str, error.cmd))}")
    except InstallError as error:
        return _complain(str(error))
    except KeyboardInterrupt:
        return 130


def install() -> int:
    """Make .venv and install the project in it, editable, with everything tests and builds need."""
    LOCKED.ensure()
    return 0


def demo() -> int:
    """Measure the bundled rudder actuator at several amplitudes and draw its Bode picture."""
    LOCKED.ensure(tools=False)
    DEMO.mkdir(exist_ok=True)
    picture = DEMO / "rudder.png"
    command = [
        *("workbench", "nfr", "fmu:Rudder", "--input", "delC", "--output", "del"),
        *("--band", "0.5:20", "--amplitude", "0.25,1,4", "--plot", str(picture.relative_to(ROOT))),
    ]
    print(f"$ {shlex.join(command)}\n", flush=True)
    code = subprocess.call([LOCKED.python, "-m", *command], cwd=ROOT)
    if code == 0:
        print(
            f"\nThe Bode picture is {picture}\nThe command above, run with {LOCKED.bin / 'workbench'}, did all of it."
        )
    return code


def test(parts: Sequence[str], *, quick: bool, newest: bool, lowest: bool) -> int:
    """Check lint, format and types, build the documentation, run the tests; what fails in seconds comes first.

    Args:
        parts: of these, or files with tests; by default all.
        quick: leave out the tests that took longest in the last whole run.
        newest: with the newest versions that pyproject.toml admits.
        lowest: with the lowest ones, by default the tests only: old tools and types are not ours to check.
    """
    place = NEWEST if newest else LOWEST if lowest else LOCKED
    if place is not LOCKED:
        place.resolve()
    return _test(parts or (("tests",) if lowest else PARTS), place, quick=quick)


def _test(parts: Sequence[str], place: Environment, *, quick: bool = False) -> int:
    files = [part for part in parts if part not in PARTS]
    absent = [file for file in files if not (ROOT / file.partition("::")[0]).exists()]
    if absent:
        return _complain(f"{absent[0]}: no such file; there are the parts {', '.join(PARTS)}, and files with tests")
    _ensure_installed(place)
    if "lint" in parts:
        for module in LINT:
            _module(module, place)
        _lint_javascript()
    _aside([module for part, module in ASIDE.items() if part in parts], place)
    if "tests" in parts or files:
        _tests(files, place, quick=quick)
    return 0


def _aside(modules: Sequence[Sequence[str]], place: Environment) -> None:
    """Run modules that have one process each beside each other, and show what each said when it ends."""
    with ThreadPoolExecutor(len(ASIDE)) as pool:
        results = [pool.submit(_module, module, place, show=False, check=False) for module in modules]
        for result in as_completed(results):
            print(result.result().stdout, end="", flush=True)
    for result in results:
        result.result().check_returncode()


def _tests(files: Sequence[str], place: Environment, *, quick: bool) -> None:
    """Run the tests: all, or those in files; keep how long they took, if all have run in their usual versions."""
    new = LAST_RUN.with_suffix(".new")
    result = _module(
        (*PYTEST, *(("--quick", str(QUICK)) if quick else ("--junitxml", str(new))), *files), place, check=False
    )
    if not (quick or files) and place is LOCKED and result.returncode in {0, 1}:  # it came to its end
        new.replace(LAST_RUN)
    result.check_returncode()


def _module(
    module: Sequence[str], place: Environment, *, show: bool = True, check: bool = True, **settings: str
) -> subprocess.CompletedProcess[str]:
    """Run a module of the environment, or have its words in the result, which says whether it failed."""
    words = f"$ {shlex.join(module)}\n"
    if show:
        print(words, end="", flush=True)
    result = _run([place.python, "-m", *module], show=show, check=check, **settings)
    if not show:
        result.stdout = words + result.stdout
    return result


def _lint_javascript() -> None:
    """Check the modules of the browser workbench, where there is npm."""
    eslint = with_eslint()
    if eslint is None:
        print("NOT DONE: npm is not installed, so the JavaScript is not linted", flush=True)
        return
    print("$ eslint workbench/ui/static tests/js", flush=True)
    settings = JAVASCRIPT / "eslint.config.mjs"
    _run(["node", eslint, "--config", settings, "workbench/ui/static", *sorted(JAVASCRIPT.glob("*.mjs"))])


def numerical(*, place: Environment = LOCKED) -> int:
    """Run the numerical tests and measure the figures that depend on it in the arithmetic of another processor."""
    _ensure_installed(place)
    found = {name: sorted((ROOT / "tests").glob(f"test_{name}*")) for name in NUMERICAL}
    idle = [name for name, files in found.items() if not files]
    if idle:
        return _complain(f"no file tests/test_{idle[0]}* is left; mend NUMERICAL in scripts/dev.py")
    files = sorted({str(file.relative_to(ROOT)) for files in found.values() for file in files})
    print(f"with OPENBLAS_CORETYPE={OTHER_PROCESSOR}:", flush=True)
    for module in ((*PYTEST, *files), (*FIGURES, *NUMERICAL_FIGURES)):
        _module(module, place, OPENBLAS_CORETYPE=OTHER_PROCESSOR)
    return 0


def everything(*, place: Environment = LOCKED) -> int:
    """Check all that must hold before a change is accepted."""
    for check in (partial(_test, PARTS), partial(numerical), partial(build, check=True)):
        code = check(place=place)
        if code != 0:
            return code
    _module(EVIDENCE, place)
    _module(FIGURES, place)  # a miss that is not known ends with exit code 1
    return 0


def upgrade(packages: Sequence[str] = ()) -> int:
    """Move the locked versions to the newest, and keep the move if everything holds.

    Args:
        packages: whose versions move; by default all.
    """
    locks = (LOCK, JAVASCRIPT / "package.json", JAVASCRIPT / "package-lock.json")
    before = {file: file.read_bytes() for file in locks}
    kept = False
    try:
        NEWEST.resolve(start=LOCK.read_text(encoding="utf-8"), packages=packages)
        if not packages:
            move_eslint()
        lines = moved(LOCK.read_text(encoding="utf-8"), NEWEST.lock.read_text(encoding="utf-8"))
        print("\n".join(lines) or "no Python package moves", flush=True)
        kept = everything(place=NEWEST) == 0
    finally:
        if not kept:
            for file, content in before.items():
                file.write_bytes(content)
            print("all versions are as they were", flush=True)
    if not kept:
        return 1
    LOCK.write_bytes(NEWEST.lock.read_bytes())
    print(
        f"moved {LOCK.name}; tried with Python {sys.version.split()[0]} only: run `test` with the others, then commit"
    )
    return 0


def checks(names: Sequence[str] = ()) -> int:
    """Plant a fault for each check, in a copy, and see that the check fails and names it.

    Args:
        names: of the checks; by default all.
    """
    _ensure_installed()
    return subprocess.call([LOCKED.python, "scripts/checks.py", *names], cwd=ROOT)


def mutants(paths: Sequence[str] = (), count: int = 300, *, record: bool = False) -> int:
    """Change the numerical code in many places, one at a time, and see which changes no test notices.

    Args:
        paths: files or folders; by default the numerical rooms.
        count: how many changes are tried; which ones follows from the commit.
        record: whether to find out again which tests run which lines.
    """
    _ensure_installed()
    again = ["--record"] if record else []
    return subprocess.call([LOCKED.python, "scripts/mutants.py", "--count", str(count), *again, *paths], cwd=ROOT)


def faults(areas: Sequence[str] = ()) -> int:
    """Plant the faults of scripts/faults.toml, one at a time, and see which ones the published figures notice.

    Args:
        areas: of the faults; by default all.
    """
    _ensure_installed()
    return subprocess.call([LOCKED.python, "scripts/plant_faults.py", *areas], cwd=ROOT)


def reproduce(words: Sequence[str] = ()) -> int:
    """Measure the published figures now, all or those of a chapter, and compare.

    Args:
        words: chapters, figures, targets, and options: `--help` shows them.
    """
    return _own_words(FIGURES, words)


def evidence(words: Sequence[str] = ()) -> int:
    """Count how often promises are kept over random models whose truth is known.

    Args:
        words: which, and its options: `NAME --help` shows them; by default the short form of all.
    """
    return _own_words(EVIDENCE, words)


def bench(words: Sequence[str] = ()) -> int:
    """Measure what users wait for, beside its peers or beside another checkout; BLAS has its usual threads.

    Args:
        words: which benches, and options: `--help` shows them.
    """
    return _own_words(BENCH, words, {})


def _own_words(
    module: Sequence[str], words: Sequence[str], usual: Mapping[str, str] = {"OPENBLAS_NUM_THREADS": "1"}
) -> int:
    """Run a module of the project from where this was called: files are named from there."""
    _ensure_installed()
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    settings = {**usual, **os.environ, "PYTHONPATH": path}
    return subprocess.call([LOCKED.python, "-m", *module, *words], env=settings)


def build(*, check: bool = False, place: Environment = LOCKED) -> int:
    """Rebuild the bundled FMUs from modelica_src/ into fmus/.

    Args:
        check: build elsewhere and compare with what is committed, byte for byte.
        place: environment to use.
    """
    _ensure_installed(place)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) if check else ROOT / "fmus"
        before = _fmus(ROOT / "fmus")
        _run([place.python, "-m", "workbench", "build", "modelica_src", "--out", target])
        after = _fmus(target)
        differing = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    if check and differing:
        return _complain(f"differ from a rebuild: {', '.join(differing)}; run scripts/dev.py build and commit")
    print("changed: " + ", ".join(differing) if differing else "the FMUs are as they were")
    return 0


def release(out: Path = ROOT / "dist") -> int:
    """Make a reproducible source archive, a wheel for each platform, and their bill of materials.

    Args:
        out: folder for the files.
    """
    _ensure_installed()
    return subprocess.call([LOCKED.python, "-m", "scripts.release", "--out", str(out.resolve())], cwd=ROOT)


def _fmus(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all FMUs in a folder by their name in it."""
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.glob("fmi*/*.fmu")}


def _ensure_installed(place: Environment = LOCKED) -> None:
    place.ensure()
    _run([place.python, "-c", COMPILE])


def _run(
    command: Sequence[str | Path], *, show: bool = True, check: bool = True, **settings: str
) -> subprocess.CompletedProcess[str]:
    # Small matrices gain nothing from several BLAS threads, which wait for each other on a busy machine.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", "1")}
    environment |= settings
    # What is compiled is kept, tests as pytest rewrites them, too: each of the many processes would do it anew.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    words = [str(part) for part in command]
    out, err = (None, None) if show else (subprocess.PIPE, subprocess.STDOUT)
    return subprocess.run(words, cwd=ROOT, check=check, env=environment, text=True, stdout=out, stderr=err)


def _complain(message: str) -> int:
    print(f"dev.py: {message}", file=sys.stderr)
    return 1


COMMANDS: dict[str, Callable[..., int]] = {
    "install": install,
    "demo": demo,
    "test": test,
    "numerical": numerical,
    "all": everything,
    "upgrade": upgrade,
    "checks": checks,
    "mutants": mutants,
    "faults": faults,
    "reproduce": reproduce,
    "evidence": evidence,
    "bench": bench,
    "build": build,
    "release": release,
}

if __name__ == "__main__":
    sys.exit(main())
