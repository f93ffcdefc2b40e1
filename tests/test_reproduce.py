"""The published figures: what is quick is measured here, and that the check can fail."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from scripts.reproduce import reproduce
from scripts.reproduce.__main__ import reproduce_command
from scripts.reproduce.measurement import Measured, Measurement
from scripts.reproduce.registry import experiments
from scripts.reproduce.result import ReproduceResult, TargetList, TargetResult
from scripts.reproduce.run import _runner
from scripts.reproduce.targets import MET, MISSED, NOT_REACHABLE, parse_targets, read_targets
from workbench.cli.app import run
from workbench.errors import InputError, SimulationError
from workbench.jobs.options import Workers

HERE = Workers(in_process=True)
# Measured by no other test, and in well under a second each.
QUICK = (
    "hybrid", "lag", "law-mean", "law-fundamental", "quantiser",
    "rudder-10hz-ratio", "rudder-errcrit", "rudder-gear", "rudder-trim", "rudder-lin",
    "rudder-default", "rudder-step", "law-failed", "8.1", "unstable-pair", "describing-function",
)  # fmt: skip
Changed = Callable[[str, Callable[[], Measurement]], None]


@pytest.fixture
def change(monkeypatch: pytest.MonkeyPatch) -> Changed:
    """Put another measurement in the place of an experiment's own."""

    def put(name: str, measure: Callable[[], Measurement]) -> None:
        known = dict(experiments())
        known[name] = replace(known[name], measure=measure)
        for module in ("run", "work"):
            monkeypatch.setattr(f"scripts.reproduce.{module}.experiments", lambda: MappingProxyType(known))

    return put


def values(**changes: Measured) -> Mapping[str, Measured]:
    found: dict[str, Measured] = {"rate-crossings": 5.0, "rate-gains-negative": 0.0, "rate-gains-positive": 0.0}
    return {**found, **{name.replace("_", "-"): value for name, value in changes.items()}}


# -- measured ------------------------------------------------------------------------------------------


def test_quick_targets_are_met() -> None:
    result = reproduce(QUICK, workers=HERE)
    assert [(o.target.name, o.reason) for o in result.outcomes if not o.passed] == []
    assert len(result.outcomes) > 25


def test_worker_processes_measure_the_same_as_this_one() -> None:
    seen: list[tuple[str, int, int]] = []
    words = ["example-2-3", "hysteresis", "fig9"]
    there = reproduce(words, workers=Workers(jobs=2, timeout=60.0), progress=lambda *told: seen.append(told))
    here = reproduce(words, workers=HERE)
    assert [o.to_dict() for o in there.outcomes] == [o.to_dict() for o in here.outcomes]
    assert (there.jobs, here.jobs) == (2, 1)
    assert sorted(done for _, done, _ in seen) == [1, 2, 3]
    assert {total for _, _, total in seen} == {3}
    assert {name for name, _, _ in seen} == {"example 2-3", "hysteresis", "example 2-4"}


def test_what_the_source_report_contradicts_is_not_reachable_and_says_why() -> None:
    result = reproduce(["example-2-3"], workers=HERE)
    printed = result.outcome("example-2-3-slopes")
    assert (printed.passed, printed.verdict) == (False, NOT_REACHABLE)
    assert printed.reason is not None
    assert "0.7213939" in printed.reason  # what was measured
    assert "contradict the printed matrices" in printed.reason
    assert result.missed == ()
    # The reason can be checked: by the printed matrices the slopes are the measured ones.
    assert isinstance(printed.measured, tuple)
    matrices = [0.62118 / 0.6407, 0.490115 / 0.6794, 0.315277 / 0.43]
    assert printed.measured == pytest.approx(matrices, rel=2e-6)
    with pytest.raises(KeyError):
        result.outcome("nonsense")


@pytest.mark.parametrize("module", ["chapter3", "chapter4", "chapter4_rudder"])
def test_pictures_belong_to_figures_that_can_be_asked_for(module: str) -> None:
    targets = read_targets()
    for experiment in import_module(f"scripts.reproduce.{module}").EXPERIMENTS:
        named = {n for name in experiment.targets for n in targets[name].figures}
        for picture in experiment.measure().pictures:
            assert set(picture.figures) <= named, experiment.name


# -- the check can fail ----------------------------------------------------------------------------------


def test_a_wrong_measurement_is_missed_and_the_exit_code_says_so(
    change: Changed, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    change("rate feedback", lambda: Measurement(values(rate_crossings=6.0)))
    out = tmp_path / "out.json"
    assert reproduce_command(["fig51", "--in-process", "--json", str(out)]) == 1
    assert "rate-crossings: 5 asked for; 6 measured, outside 5 (exact)" in capsys.readouterr().out
    found = json.loads(out.read_text(encoding="utf-8"))
    assert {t["name"]: t["passed"] for t in found["targets"]} == {
        "rate-crossings": False, "rate-gains-negative": True, "rate-gains-positive": True
    }  # fmt: skip
    assert found["passed"] is False


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (math.nan, "nan measured, outside 5"),
        ([5.0, 6.0], "5, 6 measured, outside 5"),
        ([], "0 numbers measured"),
    ],
)
def test_no_number_is_a_miss(change: Changed, wrong: Measured, reason: str) -> None:
    change("rate feedback", lambda: Measurement(values(rate_crossings=wrong)))
    (found,) = reproduce(["rate-crossings"], workers=HERE).outcomes
    assert found.verdict == MISSED
    assert reason in str(found.reason)


def test_a_target_that_is_forgotten_is_a_miss(change: Changed) -> None:
    change("rate feedback", lambda: Measurement({}))
    result = reproduce(["fig51"], workers=HERE)
    assert len(result.missed) == 3
    assert result.missed[0].reason == "experiment 'rate feedback' did not measure it"


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (SimulationError("the step became too small", time=1.5), "the step became too small (at t = 1.5 s)"),
        (ValueError("math\ndomain"), "ValueError: math domain"),
    ],
)
def test_an_experiment_that_fails_does_not_cost_the_others(change: Changed, error: Exception, reason: str) -> None:
    def fail() -> Measurement:
        raise error

    change("example 2-3", fail)
    result = reproduce(["3.3"], workers=HERE)
    verdicts = {o.target.name: o.verdict for o in result.outcomes}
    assert {n for n, v in verdicts.items() if v == MISSED} == {n for n in verdicts if n.startswith("example-2-3-")}
    assert verdicts["hysteresis"] == MET
    assert result.outcome("example-2-3-c").reason == reason
    # A reason in the data file does not excuse a measurement that failed.
    assert verdicts["example-2-3-slopes"] == MISSED


def test_what_was_measured_before_an_interrupt_is_kept(change: Changed, tmp_path: Path) -> None:
    def interrupt() -> Measurement:
        raise KeyboardInterrupt

    change("example 2-5", interrupt)  # the experiments of this chapter run in their order
    out = tmp_path / "out.json"
    assert reproduce_command(["3.3", "--in-process", "--json", str(out)]) == 130
    found = json.loads(out.read_text(encoding="utf-8"))
    passed = {t["name"] for t in found["targets"] if t["passed"]}
    assert "example-2-1-c" in passed
    assert "hysteresis" not in passed
    assert {t["reason"] for t in found["targets"] if t["measured"] is None} == {"interrupted before it was measured"}


def test_a_process_that_dies_costs_its_targets() -> None:
    """Longer than the time limit: the process is ended, and the target missed."""
    result = reproduce(["rate-crossings"], workers=Workers(jobs=1, timeout=0.05))
    (found,) = result.outcomes
    assert (found.verdict, found.measured) == (MISSED, None)
    assert "0.05 s" in str(found.reason)


EXPLAINED = """
[a]
chapter = "3"
what = "w"
basis = "predicted"
high = 1
{why} = "because"
instead = {{low = 2, high = 3, why = "theory"}}
"""


def explained(why: str, measured: float | None) -> TargetResult:
    return TargetResult(parse_targets(EXPLAINED.format(why=why), "file")["a"], "e", measured)


def test_a_reason_counts_only_where_what_is_measured_instead_is_measured() -> None:
    found = [explained("reason", x) for x in (0.5, 2.5, 3.5, math.nan, None)]
    assert [o.verdict for o in found] == [MET, NOT_REACHABLE, MISSED, MISSED, MISSED]
    assert [o.known for o in found] == [False] * 5
    assert found[0].reason is None
    assert found[1].reason == "2.5 measured; because"
    assert "outside 2 … 3, which is to be measured instead: theory" in str(found[2].reason)
    assert replace(found[1], remark="seen").reason == "2.5 measured; because; seen"


def test_a_shortfall_is_a_miss_that_is_known_while_it_stays_as_it_is() -> None:
    found = [explained("shortfall", x) for x in (0.5, 2.5, 3.5, None)]
    assert [o.verdict for o in found] == [MET, MISSED, MISSED, MISSED]
    assert [o.known for o in found] == [False, True, False, False]


@pytest.mark.parametrize("code", [0, 1])
def test_a_known_miss_alone_is_exit_code_0(change: Changed, code: int, tmp_path: Path) -> None:
    name = "figure-31-phase-half-hz"
    target = read_targets()[name]
    assert target.instead is not None
    edge = np.asarray(target.instead.high)
    change("widths of figure 31", lambda: Measurement({name: edge * 1.001 if code else edge}))
    out = tmp_path / "out.json"
    assert reproduce_command([name, "--in-process", "--json", str(out)]) == code
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["targets"][0]["verdict"] == MISSED
    assert found["targets"][0]["known"] == found["passed"] == (code == 0)
    assert found["counts"]["predicted"] == {MET: 0, MISSED: 1, NOT_REACHABLE: 0}


def test_no_executor_and_no_pictures_from_a_cluster(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as threads, pytest.raises(InputError, match="no executor"):
        reproduce(["hysteresis"], workers=Workers(executor=threads))
    with pytest.raises(InputError, match="leave --pictures out"):
        _runner(Workers(scheduler="tcp://nowhere:1"), tmp_path)


# -- what comes out --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def few() -> ReproduceResult:
    return reproduce(["3.3.1", "3.3.3"], drawings=True, workers=HERE)


def test_json(few: ReproduceResult) -> None:
    found = json.loads(json.dumps(few.to_dict(), allow_nan=False))
    assert found["selection"] == ["3.3.1", "3.3.3"]
    for target in found["targets"]:
        assert {"name", "chapter", "target", "measured", "tolerance", "passed", "reason"} <= set(target)
        assert (target["reason"] is None) == target["passed"]
    first = found["targets"][0]
    assert (first["name"], first["target"], first["tolerance"]) == (
        "example-2-1-c", [0.132825, 0.0], {"absolute": 5.1e-7}
    )  # fmt: skip
    assert [p["figures"] for p in found["pictures"]] == [[1, 2], [3], [7, 8]]


def test_page(few: ReproduceResult, tmp_path: Path) -> None:
    few.report(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert text.count("<svg") >= 3
    for outcome in few.outcomes:
        assert outcome.target.name in text
    assert "Not reachable, and why" in text
    assert "Figures 1, 2 of the source report" in text
    identifiers = re.findall(r'\bid="([^"]+)"', text)
    assert len(identifiers) == len(set(identifiers))
    assert not re.search(r'(src|href)="https?:', text.replace("xlink:href", ""))
    with pytest.raises(InputError, match=r"\.html"):
        few.report(tmp_path / "page.txt")


# -- the command -------------------------------------------------------------------------------------------


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "pictures"
    files = ["--report", str(tmp_path / "p.html"), "--csv", str(tmp_path / "t.csv"), "--pictures", str(folder)]
    assert reproduce_command(["figure", "3", "hysteresis", "--in-process", "--json", "-", *files]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["command"] == "reproduce"
    assert {t["name"] for t in found["targets"]} > {"hysteresis", "example-2-1-c"}
    written = sorted(p.name for p in folder.iterdir())
    names = ["figure_12_13_hysteresis_1.png", "figure_1_2_example_2_1_1.png", "figure_3_example_2_1_2.png"]
    assert written == names
    assert all((folder / name).stat().st_size > 10_000 for name in written)
    assert "source report" in (tmp_path / "p.html").read_text(encoding="utf-8")
    assert (tmp_path / "t.csv").read_text(encoding="utf-8").startswith("name,chapter")


def test_the_package_says_where_it_went(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["reproduce", "3.3"]) == 2
    assert capsys.readouterr().err == (
        "workbench: reproduce is now python scripts/dev.py reproduce, in the project's source\n"
    )


def test_its_lines_and_usage_are_those_of_the_script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.html"
    assert reproduce_command(["hysteresis", "--in-process", "--report", str(page)]) == 0
    assert f"python scripts/dev.py reproduce hysteresis --in-process --report {page}" in page.read_text("utf-8")
    assert reproduce_command(["--help"]) == 0
    assert "python scripts/dev.py reproduce [OPTIONS]" in capsys.readouterr().out


def test_list_measures_nothing(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scripts.reproduce.run.perform", None)
    assert reproduce_command(["--list", "fig53"]) == 0
    printed = capsys.readouterr().out
    assert "position-gains" in printed
    assert "8 Aeroelastic aircraft" in printed


def test_without_words_all_targets_are_listed_and_read_back(tmp_path: Path) -> None:
    out = tmp_path / "targets.json"
    assert reproduce_command(["--list", "--json", str(out)]) == 0
    assert TargetList.read(out).targets == tuple(read_targets().values())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cycle-rat"], "did you mean cycle-rate"),
        (["fig", "99"], "figure 99"),
        (["--list", "--pictures", "folder"], "--list measures nothing"),
        (["hysteresis", "--jobs", "0"], "jobs: 0 is too few"),
        (["hysteresis", "--report", "page.txt"], "must end in .html"),
        (["hysteresis", "--in-process", "--pictures", "/dev/null"], "pictures cannot be written there"),
    ],
)
def test_command_refuses_in_one_line(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduce_command([*arguments]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1
    assert words in error[0]
