"""Baselines: a record beside one kept before, with the errors that both state."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import workbench as wb
from tests.hostile_fmus import build_hostile
from tests.record_examples import Maker
from workbench.cli.app import run
from workbench.core.records.record import Record
from workbench.core.values.arrays import Complex, Floats
from workbench.study.picture import plot_baseline
from workbench.study.requirements import read_requirement
from workbench.study.requirements.base import Compliance, NotMeasured
from workbench.study.requirements.baseline import Baseline

F = 1.0 / (2.0 * math.pi)  # corner of 1/(s + 1) [Hz]


def baseline(**options: Any) -> Baseline:  # noqa: ANN401
    made = read_requirement({"name": "r", "analysis": "a", "kind": "baseline", **options}, "here")
    assert isinstance(made, Baseline)
    return made


def find(now: dict[str, Any], before: dict[str, Any], **options: Any) -> Compliance:  # noqa: ANN401
    return baseline(**options).find([now, before])


def history(time: Floats, **signals: Floats) -> dict[str, Any]:
    record = wb.SimulationResult(
        model="m", interface="me", solver="gear", time=time, signals=signals, units=dict.fromkeys(signals, "m")
    )
    return {"command": "simulate", **record.to_dict()}


def measured(
    tau: float = 1.0,
    *,
    frequencies: tuple[float, ...] = (0.3 * F, F, 4.0 * F),
    **options: Any,  # noqa: ANN401
) -> dict[str, Any]:
    with wb.load("fmu:FirstOrderLag", start_values={"tau": tau}, **options) as lag:
        found = wb.nfr(lag, "u", "y", frequencies=frequencies, amplitudes=[1.0], in_process=True)
    return {"command": "nfr", **found.to_dict()}


def truth(tau: float, frequency: Floats) -> Complex:
    return np.asarray(1.0 / (1.0 + 2j * np.pi * frequency * tau), dtype=np.complex128)


@pytest.fixture(scope="module")
def lag() -> dict[str, Any]:
    return measured(tolerance=1e-6)


# -- measured responses -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options", [{"tolerance": t, "solver": s} for t in (1e-3, 1e-5, 1e-9) for s in ("gear", "vkm")]
)
def test_a_response_measured_otherwise_is_the_same(lag: dict[str, Any], options: dict[str, Any]) -> None:
    found = find(measured(**options), lag)
    assert found.passed, found.words


def test_a_change_is_found_where_it_is_more_than_the_errors(lag: dict[str, Any]) -> None:
    """1/(tau s + 1): by how much a change moves the response is known in closed form."""
    frequency = np.array(lag["frequency_hz"])
    below = above = 0
    for change in (1e-9, 1e-8, *(10.0**k for k in np.arange(-7.0, -1.2, 0.4))):
        now = measured(1.0 + change, tolerance=1e-6)
        bar = sum(np.array(r["error"][0]) * r["gain"][0] for r in (now, lag))
        moved = float(np.max(np.abs(truth(1.0 + change, frequency) - truth(1.0, frequency)) / bar))
        found = find(now, lag)
        if moved > 2.0:  # what both are wrong by hides at most one error bar
            above += 1
            assert not found.passed, (change, moved, found.words)
        elif moved < 1e-2:
            below += 1
            assert found.passed, (change, moved, found.words)
    assert above >= 5
    assert below >= 1


def test_records_within_their_errors_never_differ_and_three_error_bars_always_do(lag: dict[str, Any]) -> None:
    random = np.random.default_rng(3)

    def scattered(true: Complex, share: Floats, by: float) -> dict[str, Any]:
        """A record whose values are wrong by `by` times what it states."""
        seen = true + by * share * np.abs(true) * np.exp(2j * np.pi * random.random(3))
        phase = np.degrees(np.angle(seen))
        return {**lag, "gain": [np.abs(seen).tolist()], "phase_deg": [phase.tolist()], "error": [share.tolist()]}

    found = 0
    for _ in range(120):
        true = random.normal(size=3) + 1j * random.normal(size=3)
        one, two = (10.0 ** random.uniform(-6, -0.5, 3) for _ in range(2))
        before = scattered(true, one, random.uniform(0.0, 1.0))
        assert find(scattered(true, two, random.uniform(0.0, 1.0)), before).passed
        moved = true * np.where(np.arange(3) == random.integers(3), 1.0 + 4.0 * (one + two), 1.0)
        after = scattered(moved, two, random.uniform(0.0, 1.0))
        bars = sum(np.array(r["gain"][0]) * e / (1.0 - e) for r, e in ((before, one), (after, two)))
        if np.any(np.abs(moved - true) > 3.0 * bars):
            found += 1
            assert not find(after, before).passed
    assert found > 40


def test_a_frequency_of_the_baseline_that_is_not_measured_is_not_met(lag: dict[str, Any]) -> None:
    with pytest.raises(NotMeasured, match="2 of 3 places of the baseline were not measured, the first at"):
        find(measured(frequencies=(F, 2.0 * F)), lag)
    with pytest.raises(NotMeasured, match="was measured at no Hz of the baseline"):
        find(measured(frequencies=(2.0 * F,)), lag)
    lost = {**lag, "gain": [[None, *lag["gain"][0][1:]]], "failed": [failed_at(lag["frequency_hz"][0])]}
    with pytest.raises(NotMeasured, match="has a value in the baseline, but none now: the pump ran dry"):
        find(lost, lag)
    assert find(lag, lost).passed


def failed_at(frequency: float) -> dict[str, Any]:
    return {"frequency_hz": frequency, "amplitude": 1.0, "reason": "the pump ran dry", "kind": None}


# -- time histories -----------------------------------------------------------------------------


def wave(time: Floats, size: float, jump_at: float) -> Floats:
    smooth = np.sin(2.0 * np.pi * time) + 0.3 * np.cos(7.0 * time + 1.0)
    return size * (smooth + np.where(time < jump_at, 0.0, 2.0))


def sampled(random: np.random.Generator, size: float, *, jump_at: float = 1.0, off: float = 0.0) -> dict[str, Any]:
    """A wave with a jump, whose left and right limit are two rows, on a grid of its own."""
    inner = np.sort(random.uniform(0.0, 2.0, random.integers(60, 400)))
    time = np.sort(np.concatenate([[0.0, 2.0, jump_at, jump_at], inner[np.abs(inner - jump_at) > 1e-3]]))
    value = wave(time, size, jump_at)
    value[np.searchsorted(time, jump_at)] -= 2.0 * size
    return history(time, y=value + off)


def test_histories_on_other_grids_are_the_same_and_a_change_is_found() -> None:
    random = np.random.default_rng(4)
    for _ in range(150):
        size = 10.0 ** random.uniform(-3, 3)
        before = sampled(random, size)
        same = find(sampled(random, size), before, tolerance=1e-6 * size)
        assert same.passed, same.words
        assert find(sampled(random, size, off=1e-6 * size), before, relative=1e-5).passed
        assert not find(sampled(random, size, off=0.3 * size), before, relative=1e-2).passed


def test_what_happens_between_the_rows_of_the_baseline_is_seen() -> None:
    coarse, fine = np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 101)
    spike = np.where(np.arange(101) == 55, 1.0, 0.0)
    assert find(history(fine, y=fine), history(coarse, y=coarse), tolerance=1e-9).passed
    assert find(history(fine, y=fine + spike), history(coarse, y=coarse), tolerance=0.1).value == pytest.approx(10.0)


def test_an_event_may_shift_by_so_much() -> None:
    random = np.random.default_rng(5)
    before, later = sampled(random, 1.0), sampled(random, 1.0, jump_at=1.01)
    found = find(later, before, tolerance=1e-3)
    assert not found.passed
    assert "y at 1.0" in found.where
    assert find(later, before, tolerance=0.15, shift=0.02).passed
    assert not find(later, before, tolerance=0.15, shift=0.005).passed


def test_the_worst_place_is_told_and_marked() -> None:
    time = np.linspace(0.0, 1.0, 101)
    bump = np.where(np.arange(101) == 37, 0.5, 0.0)
    results = history(time, y=np.sin(time) + bump), history(time, y=np.sin(time))
    asked = baseline(tolerance=0.1)
    found = asked.find(results)
    assert found.value == pytest.approx(5.0)
    assert found.where == "y at 0.37 s: off by 0.5 m, error bar 0.1 m"
    figure = plot_baseline(asked.compared(results)[0], title="t")
    marks = [line for line in figure.axes[0].lines if line.get_label() == "worst place"]
    assert [float(np.asarray(m.get_xdata())[0]) for m in marks] == pytest.approx([0.37])


# -- other records ------------------------------------------------------------------------------


def test_a_linear_model_is_compared_by_its_response_whatever_its_states_are() -> None:
    with wb.load("fmu:FirstOrderLag") as lag:
        lin = {"command": "lin", **wb.lin(lag, in_process=True).to_dict()}
    scaled = {**lin, "B": [[4.0 * lin["B"][0][0]]], "C": [[0.25 * lin["C"][0][0]]]}
    assert find(scaled, lin, relative=1e-12).passed
    other = {**lin, "C": [[1.001 * lin["C"][0][0]]]}
    assert find(other, lin, relative=0.5e-3).value == pytest.approx(2.0, rel=1e-6)
    with pytest.raises(NotMeasured, match=r"y/u at .* Hz is not known, its record states none: .* tolerance \(without"):
        find(lin, lin)


def test_rounding_is_no_change_of_a_linear_model_and_the_worst_place_is_where_there_is_a_response() -> None:
    """By symmetry the rudder does not move with supply pressure and bypass: what is there is rounding."""
    with wb.load("fmu:Rudder") as rudder:
        lin = {"command": "lin", **wb.lin(rudder, in_process=True).to_dict()}
    random = np.random.default_rng(6)
    for _ in range(20):
        rounded = {n: np.array(lin[n]) for n in "ABC"}
        rounded = {n: m * (1.0 + np.finfo(float).eps * random.integers(-1, 2, m.shape)) for n, m in rounded.items()}
        found = find({**lin, **{n: m.tolist() for n, m in rounded.items()}}, lin, relative=1e-12)
        assert found.passed, found.words
    slower = {**lin, "A": [[0.95 * a if k == 2 else a for a in row] for k, row in enumerate(lin["A"])]}
    (worst,) = (d for d in baseline(only=["del/delC"], relative=1e-6).compared([slower, lin]))
    assert not find(slower, lin, relative=1e-6).passed
    assert abs(worst.theirs.value[worst.worst]) > 1e-12 * np.abs(worst.theirs.value).max(), worst.where


@pytest.mark.parametrize(
    ("command", "kind", "path"),
    [
        ("trim", wb.TrimResult, ["operating_point", "x", 0]),
        ("bla", wb.BlaResult, ["response", 0, 1, 0]),
        ("limit-cycle", wb.LimitCycleResult, ["limit_cycles", 1, "frequency_hz"]),
        ("loop", wb.LoopResult, ["measured", 0, "points", 1, "value", 1]),
        ("loop", wb.LoopResult, ["linear", "margins", "disk_margin", "alpha"]),
    ],
)
def test_each_record_is_itself_and_a_number_that_moves_is_found(
    command: str, kind: type[Record], path: list[str | int]
) -> None:
    record = {"command": command, **Maker(empty=False).record(kind).to_dict()}
    assert find(record, record, tolerance=1e-9).value == 0.0
    moved = json.loads(json.dumps(record))
    moved.pop("x", None)  # a trim's file holds its point twice
    inner = moved
    for step in path[:-1]:
        inner = inner[step]
    last = path[-1] if isinstance(inner, list) or path[-1] in inner else next(iter(inner))
    inner[last] += 1e3
    assert not find(moved, record, tolerance=1e-9).passed


def test_numbers_at_a_path_of_any_command() -> None:
    before = {"command": "modes", "rows": [1.0, 2.0]}
    assert find({**before, "rows": [1.0, 2.01]}, before, path="rows", tolerance=0.02).value == pytest.approx(0.5)
    with pytest.raises(NotMeasured, match=r"the result has rows\[2\], the baseline has not"):
        find({**before, "rows": [1.0, 2.0, 3.0]}, before, path="rows", tolerance=0.02)
    assert "give their path" in said_by_check("modes")


def said_by_check(command: str) -> str:
    try:
        baseline().check("here", [command])
    except wb.InputError as error:
        return str(error)
    return ""


TIME = np.linspace(0.0, 1.0, 11)
KEPT = history(TIME, y=TIME, z=TIME)


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (history(TIME, y=TIME), "the baseline has z, the result has not"),
        (history(TIME, y=TIME, z=TIME, q=TIME), "the result has q, the baseline has not"),
        ({**KEPT, "units": {"y": "m", "z": "mm"}}, "z is in mm now, in m in the baseline"),
        (history(TIME[:6], y=TIME[:6], z=TIME[:6]), "y was measured from 0 to 0.5 s, in the baseline from 0 to 1 s"),
        ({"command": "trim"}, "the baseline is a result of simulate, this one of trim"),
    ],
)
def test_what_cannot_be_compared_is_said_in_a_line(now: dict[str, Any], said: str) -> None:
    with pytest.raises(NotMeasured) as error:
        find(now, KEPT, tolerance=1.0)
    assert str(error.value) == said


# -- from the file to the verdict ---------------------------------------------------------------


def test_the_bundled_records_hold(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    assert run(["run", "study:rudder_baselines", "--no-store", "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))["requirements"]
    assert {r["kind"] for r in found} == {"baseline"}
    assert len(found) == 4


def test_what_crashed_is_no_baseline_and_is_measured_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    build_hostile(tmp_path, "segfault")
    study = tmp_path / "s.toml"
    study.write_text(
        """
        models.bad = "segfault.fmu"
        analyses.response = {command = "nfr", model = "bad", input = "u", output = "y", freq = [1], amplitude = [1]}
        requirements = [{name = "as before", analysis = "response", kind = "baseline"}]
        """,
        encoding="utf-8",
    )
    crash = "response: y/u, amplitude 1 at 1 Hz: the FMU crashed: segmentation fault"
    for words in ((), ("--update-baselines",), ()):
        assert run(["run", str(study), "--json", str(tmp_path / "out.json"), *words]) == 1
        out, said = capsys.readouterr()
        assert f"as before: {crash}" in out
        assert (f"baseline s.baselines/response.json: not written, {crash}" in said) == bool(words)
        assert "1 analysis measured, 0 taken from the store" in out
        assert "measured before" not in (tmp_path / "out.json").read_text(encoding="utf-8")  # by the points' own store
    assert not (tmp_path / "s.baselines").exists()


STUDY = """
[models]
lag = {model = "fmu:FirstOrderLag", set = {tau = 1.0}}
[configurations]
plain = {}
slow = {lag = {set = {tau = 2.0}}}
[analyses.step]
command = "simulate"
model = "lag"
input = {u = "step:time=0.1,value=1"}
output = "y"
stop = 1
step = 0.1
[[requirements]]
name = "as before"
analysis = "step"
kind = "baseline"
tolerance = 1e-3
"""


def test_a_baseline_from_the_first_run_to_a_change(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study, junit, page = tmp_path / "s.toml", tmp_path / "j.xml", tmp_path / "r.html"
    study.write_text(STUDY, encoding="utf-8")

    def ran(*words: str) -> tuple[int, str, str]:
        code = run(["run", str(study), *words])
        return code, *capsys.readouterr()

    code, out, _ = ran()
    assert code == 1
    assert "there is no baseline s.baselines/step_slow.json: workbench run STUDY --update-baselines writes it" in out
    code, _, said = ran("--update-baselines")
    assert code == 0
    assert "baseline s.baselines/step_slow.json: new" in said
    kept = {p.name: p.read_bytes() for p in (tmp_path / "s.baselines").iterdir()}
    assert set(kept) == {"step_plain.json", "step_slow.json"}
    assert ran()[0] == 0

    study.write_text(STUDY.replace("tau = 1.0", "tau = 1.05"), encoding="utf-8")
    code, out, _ = ran("--junit", str(junit), "--report", str(page))
    assert code == 1
    assert "as before (plain): asked with --set=tau=1.05, the baseline with --set=tau=1" in out
    assert "y at 1 s: off by 0.0" in junit.read_text(encoding="utf-8")
    shown = page.read_text(encoding="utf-8")
    assert "worst place" in shown
    assert 'download="r.json"' in shown
    for name, content in kept.items():
        assert f"s.baselines/{name}, SHA-256 {hashlib.sha256(content).hexdigest()}" in shown
    code, _, said = ran("--update-baselines")
    assert code == 0
    assert "s.baselines/step_plain.json: changed: " in said
    assert "s.baselines/step_slow.json: same, left as it is" in said
    assert (tmp_path / "s.baselines/step_slow.json").read_bytes() == kept["step_slow.json"]

    # A baseline that was changed by hand is judged anew, though nothing is measured again.
    data = json.loads((tmp_path / "s.baselines/step_slow.json").read_text(encoding="utf-8"))
    data["signals"]["y"][-1] += 0.1
    (tmp_path / "s.baselines/step_slow.json").write_text(json.dumps(data), encoding="utf-8")
    (tmp_path / "s.baselines/step_plain.json").write_text("<<<<<<< HEAD\n", encoding="utf-8")
    code, out, _ = ran()
    assert code == 1
    assert "0 analyses measured, 2 taken from the store" in out
    assert "s.baselines/step_plain.json: is not JSON (line 1, column 1)" in out
    assert "y at 1 s: off by 0.1, error bar" in out
    assert run(["run", "study:rudder_baselines", "--update-baselines"]) == 2


def test_a_record_that_its_own_requirement_could_not_meet_is_no_baseline(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A time history states no errors: without a tolerance every run would be refused, the next one too."""
    study = tmp_path / "s.toml"
    study.write_text(
        """
        models.lag = "fmu:FirstOrderLag"
        analyses.motion = {command = "simulate", model = "lag", input = {u = 1.0}, stop = 1.0}
        requirements = [{name = "as before", analysis = "motion", kind = "baseline"}]
        """,
        encoding="utf-8",
    )
    assert run(["run", str(study), "--update-baselines"]) == 1
    assert "not written, motion: the error of y at 0 s is not known" in capsys.readouterr().err
    assert not (tmp_path / "s.baselines").exists()
    study.write_text(study.read_text("utf-8").replace('"baseline"}', '"baseline", relative = 1e-3}'), encoding="utf-8")
    for words in (["--update-baselines"], []):
        assert run(["run", str(study), *words]) == 0
