"""FMUs that may be instantiated only once per process: each instance has its own copy of the code."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.mimic_fmus import MIMICS, build_mimic
from tests.platforms import posix_signals
from workbench.core.machine.scratch import scratch_folder
from workbench.model.loading import Loading
from workbench.signals.kinds import Constant
from workbench.system.load import open_file

PLAIN = MIMICS["statics"]


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_sessions_one_after_the_other_and_side_by_side(tmp_path: Path, interface: str) -> None:
    """A second instance in one copy of the code of this FMU ends the process."""
    with wb.load(build_mimic(tmp_path, "statics"), interface) as model:
        alone = []
        for u in (1.0, 2.0):
            with model.open_session() as session:
                session.advance(0.5, signals={"u": Constant(u)})
                alone.append(session.values(["y"]))
        with model.open_session() as first, model.open_session() as second:
            for until in (0.25, 0.5):
                first.advance(until, signals={"u": Constant(1.0)})
                second.advance(until, signals={"u": Constant(2.0)})
            together = [first.values(["y"]), second.values(["y"])]
    assert [y["y"] for y in together] == pytest.approx([y["y"] for y in alone], rel=1e-5)


def test_a_system_may_have_it_twice(tmp_path: Path) -> None:
    file = build_mimic(tmp_path, "statics")
    text = (
        f"[components]\na = '{file}'\nb = '{file}'\n[connections]\n'b.u' = 'a.y'\n[inputs]\nu = 'a.u'\n"
        "[outputs]\ny = 'b.y'\nx = 'a.y'\n"
    )
    (tmp_path / "two.toml").write_text(text, encoding="utf-8")
    with open_file(tmp_path / "two.toml", Loading()) as twice, wb.load(file, "me") as one:
        found, single = wb.simulate(twice, stop=1.0), wb.simulate(one, stop=1.0)
    assert found.signals["x"][-1] == pytest.approx(single.signals["y"][-1], rel=1e-4)
    assert abs(found.signals["y"][-1] - found.signals["x"][-1]) > 0.05


def test_copies_are_removed(tmp_path: Path) -> None:
    with wb.load(build_mimic(tmp_path, "statics"), "cs") as model:
        folder = scratch_folder("here").parent
        with model.open_session(), model.open_session():
            assert len(list(folder.glob("alone-*"))) == 1
        assert not list(folder.glob("alone-*"))


@posix_signals
def test_a_result_is_not_lost_with_what_tests_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not say so: the run is there when its repetition with half the step ends the process."""
    monkeypatch.setitem(MIMICS, "statics", replace(PLAIN, flags=""))
    with wb.load(build_mimic(tmp_path, "statics"), "cs") as model:
        found = wb.simulate(model, stop=1.0)
        alone = wb.simulate(model, stop=1.0, verify_step=False)
    assert found.signals["y"][-1] == alone.signals["y"][-1]
    assert found.time[-1] == 1.0
    assert found.failed is None
    (note,) = [n for n in found.notes if "did not finish" in n]
    assert note.startswith("the repetition with half the communication step did not finish: the FMU aborted its")
    assert np.isfinite(found.signals["y"]).all()
