"""Fuzz the readers for so many seconds each; print executions and findings.

    scripts/fuzz.py 300 [--only csv,study] [--seed 1]

A reader must read, or raise the workbench's own error in one line; what it reads must be the same once it is written
and read again (records, systems, tables). What else it does is a finding, as is a reading of
more than 5 s, or of more than 2 GB of memory.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from hypothesis import HealthCheck, Phase, given, seed, settings  # noqa: E402

from tests.fuzzed import READERS, Reader, finding  # noqa: E402

SLOW = 5.0  # [s]
MEMORY = 2 << 30  # [byte]
BATCH = 500


def fuzz(reader: Reader, seconds: float, first: int) -> tuple[int, Counter[str], dict[str, bytes]]:
    """Return the number of executions, how often each finding was made, and what leads to it."""
    count, found, causes = 0, Counter[str](), dict[str, bytes]()
    end = 0.0

    def once(data: bytes) -> None:
        nonlocal count
        if time.monotonic() > end:
            return
        begin = time.monotonic()
        what = finding(reader, data)
        if not what and time.monotonic() > begin + SLOW:
            what = f"took {time.monotonic() - begin:.0f} s"
        count += 1
        if what:
            found[what] += 1
            causes.setdefault(what, data)

    for sound in reader.seeds():
        finding(reader, sound)  # loads what it needs
    batch = settings(
        max_examples=BATCH,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        seed(first)(batch(given(reader.bytes())(once)))()
        first += 1
    return count, found, causes


def main() -> None:
    """Fuzz what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("seconds", type=float, help="for each reader")
    parser.add_argument("--only", type=lambda text: text.split(","), default=list(READERS), help="readers")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the files that lead to findings")
    asked = parser.parse_args()
    if sys.platform != "win32":
        import resource  # noqa: PLC0415 - not on Windows

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    wrong = 0
    for name in asked.only:
        count, found, causes = fuzz(READERS[name], asked.seconds, asked.seed)
        print(f"{name}: {count} executions, {len(found)} findings", flush=True)
        for k, (what, times) in enumerate(found.most_common()):
            print(f"    {times} × {what}", flush=True)
            if asked.keep is not None:
                asked.keep.mkdir(parents=True, exist_ok=True)
                (asked.keep / f"{name.replace(' ', '-')}-{k}").write_bytes(causes[what])
        wrong += len(found)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
