"""Compare the JSON keys of every record with those of an earlier version.

    python scripts/json_keys.py keys.json            compare; lost keys end with 1
    python scripts/json_keys.py keys.json --write    write what this version has

The records are those of the examples in docs/reference/json.md. A key is its path, with [] for any element of a list;
values are not looked at. The earlier version writes its keys from its own checkout:
`git worktree add ../before v0.1; cp scripts/json_keys.py ../before/scripts; …`.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from docs.tools.examples import run_page  # noqa: E402
from docs.tools.given import provide  # noqa: E402


def keys(value: Any, path: str = "") -> Iterator[str]:
    """Yield the paths of all keys."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield f"{path}.{key}".lstrip(".")
            yield from keys(inner, f"{path}.{key}".lstrip("."))
    elif isinstance(value, list):
        for inner in value:
            yield from keys(inner, f"{path}[]")


def found() -> dict[str, list[str]]:
    """Run the examples in a folder of their own; return name of the record → keys."""
    page = (ROOT / "docs" / "reference" / "json.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        provide(page, folder)
        run_page(page, folder)
        records = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(folder.glob("*.json"))}
    return {name: sorted(set(keys(record))) for name, record in records.items()}


def main() -> int:
    """Write or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    now = found()
    if arguments.write:
        arguments.file.write_text(json.dumps(now, indent=1), encoding="utf-8")
        return 0
    lost = 0
    for name, known in json.loads(arguments.file.read_text(encoding="utf-8")).items():
        here = now.get(name, [])
        gone, new = sorted(set(known) - set(here)), sorted(set(here) - set(known))
        lost += len(gone)
        for title, listed in (("lost", gone), ("new", new)):
            if listed:
                print(f"{name}\n  {title}: {', '.join(listed)}")
    print(f"{lost} keys lost")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
