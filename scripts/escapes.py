"""What a process reaches outside, as it is and confined (`--confine`): a table, one line an attempt.

    python -m scripts.escapes [--user NAME]

An attempt that is refused to a process that is not confined says nothing about the wall and is not counted.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.escapes import outcomes

__all__ = ["main"]


def main() -> int:
    """Print the table; return 1 if something came through."""
    asked = argparse.ArgumentParser(description="What a process reaches outside, as it is and confined.")
    asked.add_argument("--user", help="become this user first (needs root)")
    asked.add_argument("--json", action="store_true", help="print name → [as it is, confined]")
    options = asked.parse_args()
    for module in ("tests.escape_attempts", "tests.escape_processes"):
        importlib.import_module(module)
    if options.user:
        _become(options.user)
    free, held = dict(outcomes(confined=False)), dict(outcomes(confined=True))
    through = [name for name, what in held.items() if what.startswith("reached")]
    if options.json:
        sys.stdout.write(json.dumps({name: [free[name], held[name]] for name in free}) + "\n")
        return bool(through)
    for name, what in held.items():
        sys.stdout.write(f"{name:<45} {free[name][:45]:<47} {what[:60]}\n")
    possible = [name for name, what in free.items() if what.startswith("reached")]
    sys.stdout.write(
        f"\nas user {os.getuid()}: {len(held)} attempts; {len(possible)} come through unconfined,"
        f" {len(through)} confined{': ' * bool(through)}{', '.join(through)}\n"
    )
    return bool(through)


def _become(name: str) -> None:
    import pwd  # noqa: PLC0415 - not on Windows

    user = pwd.getpwnam(name)
    os.setgroups([])
    os.setresgid(user.pw_gid, user.pw_gid, user.pw_gid)
    os.setresuid(user.pw_uid, user.pw_uid, user.pw_uid)


if __name__ == "__main__":
    sys.exit(main())
