"""How a master is asked for: its options, and the table [master] of a system file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.master_loops import REFERENCE, error_of, lags, mastered
from workbench.errors import InputError
from workbench.health.delays.request import delays
from workbench.health.delays.result import DelayReport
from workbench.response.simulate.request import simulate
from workbench.system.load import load


def test_the_step_has_a_tolerance_of_its_own() -> None:
    loose, tight = (error_of(lags(step_tolerance=tolerance)) for tolerance in (1e-3, 1e-6))
    assert 1e-5 < loose < 5e-3
    assert tight < 0.03 * loose


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"extrapolation": 3}, "extrapolation 3 is unknown; known: 0, 1, 2"),
        ({"extrapolation": 2, "hold_inputs": True}, "hold_inputs holds all inputs"),
        ({"step_tolerance": 1e-3, "step": 0.1}, "give one"),
        ({"step_tolerance": 2.0}, "step_tolerance is 2, not between 0 and 1"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        lags(**options)


_FILE = """
[components]
a = {model = "fmu:FirstOrderLag", interface = "cs"}
b = {model = "fmu:FirstOrderLag", interface = "cs"}
e = {sum = "+-"}
k = 4.0
[connections]
"a.u" = "e.y"
"b.u" = "a.y"
"k.u" = "b.y"
"e.u2" = "k.y"
[inputs]
r = "e.u1"
[outputs]
y = "b.y"
a = "a.y"
[master]
"""


def test_a_file_says_how_its_components_are_stepped(tmp_path: Path) -> None:
    file = tmp_path / "loop.toml"
    errors = {}
    for n in (0, 1):
        file.write_text(_FILE + f'order = "jacobi"\nextrapolation = {n}\n')
        model = mastered(load(file, step=0.05, tolerance=1e-8))
        assert model.order == "jacobi"
        errors[n] = error_of(model)
    assert errors == pytest.approx({n: error_of(lags(step=0.05, order="jacobi", extrapolation=n)) for n in (0, 1)})
    assert errors[0] > 2.0 * errors[1]
    file.write_text(_FILE + "step_tolerance = 1e-6\n")
    assert error_of(mastered(load(file, tolerance=1e-8))) < 1e-4
    with load(file, step=0.5) as stepped:
        assert any("step_tolerance of the file is not used" in note for note in stepped.notes)


def test_the_phase_that_a_loop_loses_is_known_whatever_the_extrapolation(tmp_path: Path) -> None:
    file = tmp_path / "loop.toml"
    found = []
    for n in (1, 2):
        file.write_text(_FILE + f"extrapolation = {n}\n")
        with load(file, step=0.05) as model:
            report = delays(model, stop=1.0)
        assert isinstance(report, DelayReport)
        (loop,) = report.loops
        found.append(loop.crossover_hz)
    assert found[0] is not None
    assert found[1] == pytest.approx(found[0])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("extrapolation = 3", r"loop.toml: extrapolation 3 is unknown; known: 0, 1, 2"),
        ("extrapolation = 'two'", r"loop.toml: \[master\]: key 'extrapolation' must be an integer"),
        ("tolerance = 1e-3", r"loop.toml: \[master\]: .*tolerance.* step_tolerance"),
        ("order = 'random'", r"loop.toml: order 'random' is unknown; known: auto, gauss-seidel, jacobi"),
    ],
)
def test_a_wrong_master_table_is_one_line(line: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "loop.toml").write_text(_FILE + line + "\n")
    with pytest.raises(InputError, match=words):
        load(tmp_path / "loop.toml")


def test_an_inner_systems_master_and_one_without_use_are_told(tmp_path: Path) -> None:
    (tmp_path / "inner.toml").write_text(_FILE + "extrapolation = 2\n")
    outer = tmp_path / "outer.toml"
    outer.write_text('[components]\ns = "inner.toml"\n[inputs]\nr = "s.r"\n[outputs]\ny = "s.y"\n')
    with load(outer) as model:
        assert any("s: of its master is not used, the whole system has one: extrapolation" in n for n in model.notes)
    (tmp_path / "inner.toml").write_text(_FILE.replace('"cs"', '"me"') + "extrapolation = 2\n")
    with pytest.raises(InputError, match="extrapolation is for systems with co-simulation components"):
        load(tmp_path / "inner.toml")


def test_recording_does_not_shorten_the_steps_that_were_asked_for() -> None:
    """Recorded at each 500th of the run, two runs of unlike steps were one and the same."""
    for step in (0.1, 0.2):
        with lags(step=step) as model:
            found = simulate(model, stop=2.0, inputs=REFERENCE, in_process=True)
        np.testing.assert_allclose(np.diff(found.time), step)
