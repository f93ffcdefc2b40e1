"""Pages of the Python interface: every public name of `workbench`, grouped by where it lives."""

from __future__ import annotations

import workbench as wb
from workbench.core.records.lazy import homes_in

__all__ = ["grouped_names", "python_page", "python_pages"]

# The first prefix that fits a name's home decides.
_GROUPS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("models", "Models, sessions, signals", ("model", "session", "signals", "system.load", "jobs", "fmi")),
    ("errors", "Errors", ("errors", "response.simulate.divergence")),
    (
        "loops",
        "Loops, limit cycles, control",
        (
            "loops.loop", "loops.robust", "loops.describing", "loops.nyquist", "limit_cycles", "response.branches",
            "response.compare.", "point.modes", "point.reduction", "core.values.closed_loop",
        ),
    ),
    ("response", "Time histories and frequency response", ("response.simulate", "response.nfr")),
    (
        "linear",
        "Operating points and linear models",
        ("point.trim", "core.values.operating_point", "point.lin", "response.compare_linear"),
    ),
    ("identification", "Identification", ("data", "identification")),
    ("systems", "Systems", ("system", "health.blocks", "health.delays", "loops.onset")),
    ("studies", "Studies, reports, health", ("study", "show", "health.check", "health.info")),
    ("building", "Building FMUs", ("build",)),
    ("further", "Further names", ("core", "requests")),
)  # fmt: skip


def grouped_names() -> dict[tuple[str, str], list[str]]:
    """Return (page, title) → the public names on it, functions before classes; every name once."""
    pages: dict[tuple[str, str], list[str]] = {(page, title): [] for page, title, _ in _GROUPS}
    homes = homes_in(f"{wb.__file__}i")
    for name in sorted(homes, key=lambda n: (n[0].isupper(), n)):
        home = homes[name].removeprefix("workbench.")
        key = next(((p, t) for p, t, prefixes in _GROUPS if home.startswith(prefixes)), None)
        if key is None:
            raise ValueError(f"docs/tools/python_pages.py: _GROUPS has no page for {name}; add '{home}' to one")
        pages[key].append(name)
    return {key: names for key, names in pages.items() if names}


def python_pages() -> dict[str, str]:
    """Return page → title, of the pages that have names."""
    return {page: title for page, title in grouped_names()}  # noqa: C416 - the keys are pairs


def python_page(page: str) -> str:
    """Return the Markdown of one page."""
    (title, names) = next((t, names) for (p, t), names in grouped_names().items() if p == page)
    return "\n".join([f"# {title}", "", *(f"::: workbench.{name}\n" for name in names)])
