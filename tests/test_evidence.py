"""`scripts/evidence.py`: its options are the parameters of what it runs, and a broken promise ends with 1."""

from __future__ import annotations

from typing import Self

import pytest

from scripts import evidence
from scripts.promises.trial import Trial, held, kept


@pytest.mark.parametrize("name", evidence.SHORT)
def test_every_promise_has_cases_and_a_seed_and_a_short_form_that_it_takes(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        evidence.main([name, "--help"])
    said = capsys.readouterr().out
    assert ended.value.code == 0
    assert "--cases" in said
    assert "--seed" in said
    for form in evidence.SHORT[name]:
        assert all(f"--{key.replace('_', '-')}" in said for key in form)


class InTurn:
    """In place of a pool of processes."""

    map = map

    def __init__(self, processes: int) -> None:
        assert processes >= 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def test_options_reach_what_is_run_and_its_verdict_the_shell(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*, cases: int = 5, blind: bool = False) -> int:
        """Return whether too few hold.

        Args:
            cases: plants.
            blind: without help.
        """
        seen.append((cases, blind))
        return int(cases < 3)

    seen: list[tuple[int, bool]] = []
    monkeypatch.setattr(evidence, "run_of", lambda _: run)
    assert evidence.main(["nfr", "--cases", "2", "--blind"]) == 1
    assert evidence.main(["nfr"]) == 0
    assert seen == [(2, True), (5, False)]
    monkeypatch.setattr(evidence, "SHORT", {"good": ({"cases": 3},), "bad": ({"cases": 1, "blind": True},)})
    monkeypatch.setattr(evidence, "ProcessPoolExecutor", InTurn)
    assert evidence.main([]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "not kept: bad"
    assert seen[2:] == [(3, False), (1, True)]


def test_a_promise_of_95_percent_is_kept_by_19_of_20_and_by_no_less() -> None:
    good, bad, far = (Trial("settled", 1e-3, true, 3) for true in (1e-4, 2e-3, 0.02))
    assert held([good] * 19 + [bad])
    assert not held([good] * 18 + [bad] * 2)
    assert not held([good] * 17 + [bad])
    assert kept([good] * 19 + [bad])
    assert not kept([good] * 19 + [far])
    assert kept([good, Trial("averaged", 1e-3, 0.02, 3)])  # an average promises neither
