"""Make a release of the commit that is checked out: `python scripts/dev.py release [--out FOLDER]`.

1. A source archive, and from it a wheel for each platform with the kernel compiled inside; everything twice, in
   different folders, in different time zones, the second time with an empty compiler cache. The files must be the same,
   byte for byte. What is not committed is not in them.
2. The native code of each wheel must be what its platform tag promises (`natives.py`).
3. The wheel for this machine is installed in an empty environment, dependencies as wheels only, and runs there with an
   empty PATH: neither installing nor running finds a compiler.
4. A bill of materials (CycloneDX) of that environment, the release's files, the C sources and the compiler (`bom.py`).
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import venv
from collections.abc import Mapping, Sequence
from pathlib import Path

from hatch_build import PLATFORM
from scripts.release.bom import write_bom
from scripts.release.natives import faults
from workbench.build.toolchain import PLATFORMS, host_only

ROOT = Path(__file__).resolve().parents[2]
TRIALS = (
    ("--help",),
    ("info", "fmu:Rudder"),
    ("trim", "fmu:Rudder", "--u0", "delC=2", "--float", "p1,p2"),
)


class ReleaseError(Exception):
    """The release cannot be made; `str(error)` is one line that says why."""


def main() -> int:
    """Make the release and return the exit code."""
    parser = argparse.ArgumentParser(prog="dev.py release", description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--out", type=Path, default=ROOT / "dist", help="folder for the files; those of an earlier release in it go"
    )
    out = parser.parse_args().out.resolve()
    try:
        with tempfile.TemporaryDirectory(prefix="workbench-release-") as folder:
            release(Path(folder), out)
    except ReleaseError as error:
        print(f"dev.py release: {error}", file=sys.stderr)
        return 1
    return 0


def release(folder: Path, out: Path) -> None:
    """Make all files in `folder`, check them, and put them into `out`.

    Raises:
        ReleaseError: a check failed; `out` is as it was.
    """
    if not host_only():
        raise ReleaseError(
            "there is no wheel for this machine, so that none can be tried; use one of the five platforms"
        )
    changes = _git("status", "--porcelain")
    if changes:
        raise ReleaseError(
            f"not committed: {', '.join(line.split(maxsplit=1)[-1] for line in changes.splitlines())}; commit or remove"
        )
    commit, epoch = _git("log", "-1", "--format=%H %ct").split()
    say(f"building commit {commit[:10]} twice, times as of {epoch} (SOURCE_DATE_EPOCH)")
    files = build(folder / "one", commit, epoch, TZ="UTC")
    again = build(folder / "the second time", commit, epoch, TZ="Asia/Kolkata", XDG_CACHE_HOME=str(folder / "cache"))
    differing = different(files, again)
    if differing:
        raise ReleaseError(f"not reproducible, two builds differ: {', '.join(differing)}")
    say("both builds are the same to the last bit")
    wrong = [fault for platform in PLATFORMS for fault in faults(wheel_for(files, platform.wheel), platform)]
    if wrong:
        raise ReleaseError("; ".join(wrong))
    say("the native code in each wheel is what its tag promises")
    python = install_alone(wheel_for(files, host_only()[0].wheel), folder / "empty")
    for trial in TRIALS:
        _call([python, "-m", "workbench", *trial], folder, {"PATH": ""}, show=False)
        say(f"with an empty PATH: workbench {' '.join(trial)}")
    bom = write_bom(files, folder / "the second time" / "source", python, epoch=int(epoch))
    out.mkdir(parents=True, exist_ok=True)
    for old in out.glob("fmi_workbench-*"):
        old.unlink()
    for file in [*files, bom]:
        shutil.copy(file, out)
        print(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}")
    say(f"ready in {out}")


def build(folder: Path, commit: str, epoch: str, **settings: str) -> list[Path]:
    """Make the source archive and, from it, the wheels; return them.

    Args:
        folder: where all is done; it is made.
        commit: what to build.
        epoch: time of the commit [s], which the files in the archives get.
        settings: of the environment.
    """
    tree, made, source = folder / "tree", folder / "made", folder / "source"
    tree.mkdir(parents=True)
    _git("archive", "--format=tar", "--output", str(folder / "tree.tar"), commit)
    unpack(folder / "tree.tar", tree)
    common = {**settings, "SOURCE_DATE_EPOCH": epoch}
    hatchling: list[str | Path] = [sys.executable, "-m", "hatchling", "build", "--directory", made]
    _call([*hatchling, "--target", "sdist"], tree, common)
    (archive,) = made.iterdir()
    unpack(archive, folder)
    (folder / archive.name.removesuffix(".tar.gz")).rename(source)
    for platform in PLATFORMS:
        _call([*hatchling, "--target", "wheel"], source, {**common, PLATFORM: platform.name})
    return sorted(made.iterdir())


def different(files: Sequence[Path], again: Sequence[Path]) -> list[str]:
    """Return the names of the files that are not the same, byte for byte, in both builds."""
    one, two = ({file.name: file.read_bytes() for file in build} for build in (files, again))
    return sorted(name for name in one.keys() | two.keys() if one.get(name) != two.get(name))


def wheel_for(files: Sequence[Path], tag: str) -> Path:
    """Return the one wheel with this platform tag.

    Raises:
        ReleaseError: there is none.
    """
    for file in files:
        if file.name.endswith(f"-{tag}.whl"):
            return file
    raise ReleaseError(f"no wheel for {tag} was made")


def install_alone(wheel: Path, folder: Path) -> Path:
    """Install a wheel and what it needs, in locked versions, in an empty environment, where nothing can be compiled.

    Returns:
        Its Python.
    """
    venv.create(folder, with_pip=False)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pip: list[str | Path] = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "--quiet",
        "--disable-pip-version-check",
        "install",
    ]
    locked = ("--constraint", ROOT / "requirements.lock")
    _call([*pip, "--only-binary=:all:", *locked, wheel], folder, {"PATH": ""})
    return python


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a tar archive."""
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")


def say(line: str) -> None:
    """Tell how far it is."""
    print(line, flush=True)


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise ReleaseError(
            f"a release is made of a commit, in a git checkout; git {arguments[0]}: {done.stderr.strip()}"
        )
    return done.stdout.strip()


def _call(command: Sequence[str | Path], folder: Path, settings: Mapping[str, str], *, show: bool = True) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=folder, env=environment | dict(settings), capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        line = " ".join(str(part) for part in command)
        raise ReleaseError(f"failed ({done.returncode}): {line}\n{done.stdout}{done.stderr}")
    if show and done.stdout.strip():
        say(f"  {Path(done.stdout.strip().splitlines()[-1]).name}")


if __name__ == "__main__":
    sys.exit(main())
