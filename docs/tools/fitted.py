"""Write into each model's README which published figures its data were chosen to give.

python -m docs.tools.fitted
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from scripts.reproduce.targets import read_targets

__all__ = ["fitted_section", "fitted_section_of"]

_HEADING = "## Fitted to the source report"
_SECTION = re.compile(rf"^{_HEADING}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_FOLDER = Path(__file__).resolve().parents[2] / "modelica_src"
_WORDS = """That these are met says that the fit still holds, not that the model is right; written by
`python -m docs.tools.fitted` from the data file of `dev.py reproduce`."""


def fitted_section(model: str) -> str:
    """Return the section of a model's README; empty where nothing was fitted.

    Args:
        model: name of the bundled model.
    """
    found: dict[str, list[str]] = {}
    for target in read_targets().values():
        if target.fmu == model and target.fitted_by is not None:
            found.setdefault(target.fitted_by, []).append(f"`{target.name}`")
    if not found:
        return ""
    rows = "\n".join(f"| {chosen} | {', '.join(names)} |" for chosen, names in found.items())
    return f"{_HEADING}\n\n{_WORDS}\n\n| what was chosen | targets |\n|---|---|\n{rows}\n"


def fitted_section_of(text: str) -> str:
    """Return the section that a README has; empty where it has none.

    Args:
        text: of the README.
    """
    found = _SECTION.search(text)
    return "" if found is None else f"{found[0].rstrip()}\n"


def main() -> int:
    """Write all of them."""
    for readme in sorted(_FOLDER.glob("*/README.md")):
        text = readme.read_text(encoding="utf-8")
        bare, section = _SECTION.sub("", text).rstrip(), fitted_section(readme.parent.name)
        new = f"{bare}\n\n{section}" if section else f"{bare}\n"
        if new != text:
            readme.write_text(new, encoding="utf-8")
            sys.stdout.write(f"{readme.relative_to(_FOLDER)}: written\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
