"""Files that ship with the workbench, a folder for each kind: inside the package, or beside it in a checkout."""

from __future__ import annotations

from pathlib import Path

from workbench.errors import InputError, close_names, suggest

__all__ = ["bundled_files", "find_bundled"]

_PACKAGE = Path(__file__).resolve().parents[2]


def bundled_files(folder: str, suffix: str = ".toml") -> dict[str, Path]:
    """Return the bundled files of one kind, name → file, sorted.

    Args:
        folder: such as "systems" or "fmus/fmi2".
        suffix: of the files.
    """
    roots = (_PACKAGE.parent / folder, _PACKAGE / folder)  # what lies inside the package counts
    result = {path.stem: path for root in roots for path in root.glob(f"*{suffix}")}
    return dict(sorted(result.items()))


def find_bundled(name: str, files: dict[str, Path], what: str) -> Path:
    """Return the file of `kind:NAME`.

    Args:
        name: as the user wrote it.
        files: the known ones, name → file.
        what: for the message, such as "system".

    Raises:
        InputError: no such name; the message suggests near ones, or lists the known ones.
    """
    stem = name.partition(":")[2]
    if stem not in files:
        of_a_word = [n for n in files if "_" not in stem and close_names(stem, n.split("_"))]
        near = dict.fromkeys([*close_names(stem, files), *of_a_word])
        words = f"did you mean {', '.join(near)}?" if near else suggest(stem, files)
        raise InputError(f"{name}: no bundled {what} of that name; {words}")
    return files[stem]
