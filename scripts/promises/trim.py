"""How often a trim's verdict is right: random models of fifteen kinds whose equilibria are known, or that have none.

The kinds are those of tests/trim_cases.py: none, one, several, families, bounds, sizes from 1e-9 to 1e9, stiff ones.
"""

from __future__ import annotations

from tests.trim_cases import cases as models
from tests.trim_cases import judged


def run(*, cases: int = 450, seed: int = 7) -> int:
    """Print wrong verdicts; return 1 if there are any.

    Args:
        cases: models.
        seed: of the first.
    """
    wrong = [words for case in models(cases, seed) if (words := judged(case))]
    print("\n".join([*wrong, f"{len(wrong)} of {cases} verdicts are wrong"]))
    return int(bool(wrong))
