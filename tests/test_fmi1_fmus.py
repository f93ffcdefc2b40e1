"""FMI 1.0 on real binaries: the same answers as the same models give in FMI 2.0."""

from __future__ import annotations

import ctypes
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from tests.drivers import DRIVERS
from tests.fmi1_fmus import MODELS, build_fmi1
from workbench.build.fmu import build_fmu
from workbench.errors import FmuError, InputError
from workbench.fmi.bundled import bundled_path
from workbench.fmi.fmpy_access import fmi1, fmi2
from workbench.fmi.log import callbacks1, callbacks2
from workbench.fmi.platforms import host
from workbench.fmi.reading import described_at
from workbench.model.load import load
from workbench.model.sample_rates import rates_of
from workbench.point.lin.request import lin
from workbench.point.trim.request import trim
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Signal, Sine, Step

OUTPUTS = {"FirstOrderLag": ["x", "y"], "Hybrid": ["h", "v", "T", "held", "stairs", "bounces", "heating", "y"]}
STOP = 1.9
GRID = np.arange(0.0137, STOP, 0.0137)  # no event falls on these
SIGNALS: dict[str, Signal] = {"u": Sine(amplitude=0.3, frequency=1.7)}
# Co-simulation of FMI 1.0 holds its inputs, of FMI 2.0 it gets their slopes, too: alike for a step only.
FORCED: dict[str, dict[str, Signal]] = {"me": SIGNALS, "cs": {"u": Step(time=0.45, value=0.3, initial=0.1)}}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmi1")
    for model in MODELS:
        for interface in ("me", "cs"):
            build_fmi1(folder, model, interface)
    shutil.copy(bundled_path("fmu:FirstOrderLag"), folder / "FirstOrderLag.fmu")
    build_fmu([MODELS["Hybrid"]], out=folder / "Hybrid.fmu", platforms=[host()])
    return folder


def run(file: Path, interface: str, names: list[str]) -> dict[str, np.ndarray]:
    solver, step = ("vkm", None) if interface == "me" else ("auto", 1e-3)
    with load(file, interface, solver, tolerance=1e-10, step=step) as model:
        forced = FORCED[interface]
        result = simulate(model, stop=float(GRID[-1]), inputs=forced, outputs=names, points=GRID, verify_step=False)
    rows = np.searchsorted(result.time, GRID, side="right") - 1
    return {name: result.signals[name][rows].astype(float) for name in names}


@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("model", MODELS)
def test_fmus_are_valid(fmus: Path, model: str, interface: str) -> None:
    assert validate_fmu(str(fmus / f"{model}_{interface}.fmu")) == []


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
@pytest.mark.parametrize("interface", ["me", "cs"])
@pytest.mark.parametrize("model", MODELS)
def test_the_answers_are_those_of_fmi_2(fmus: Path, model: str, interface: str, driver: str) -> None:
    with load(fmus / f"{model}_{interface}.fmu") as opened:
        assert opened.description.fmi_version == "1.0"
        assert opened.interface == interface
    names = OUTPUTS[model]
    one = run(fmus / f"{model}_{interface}.fmu", interface, names)
    two = run(fmus / f"{model}.fmu", interface, names)
    for name in names:
        assert one[name] == pytest.approx(two[name], rel=1e-6, abs=1e-6), name
        assert np.ptp(one[name]) > 0.0, name


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
def test_gear_goes_through_the_events_too(fmus: Path, driver: str) -> None:
    with (
        load(fmus / "Hybrid_me.fmu", solver="gear", tolerance=1e-9) as model,
        model.open_session() as session,
    ):
        record = session.advance(STOP, signals=SIGNALS, record=["bounces", "h"])
    bounces, height = record.values["bounces"], record.values["h"]
    at = np.flatnonzero(np.diff(bounces))
    first = np.sqrt(2.0 / 9.81)
    assert record.time[at[:2]] == pytest.approx([first, first * (1 + 2 * 0.7)], rel=1e-6)
    assert height[at] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("driver", DRIVERS, indirect=True)
def test_a_session_goes_back_by_replay(fmus: Path, driver: str) -> None:
    for interface in ("me", "cs"):
        with load(fmus / f"Hybrid_{interface}.fmu", step=0.01) as model, model.open_session() as session:
            assert model.snapshot_method() == "replay"
            session.advance(0.5, signals=SIGNALS)
            saved = session.snapshot()
            ends = []
            for _ in range(2):
                session.restore(saved)
                session.advance(1.0, signals=SIGNALS)
                ends.append(session.values(["h", "v", "T"]))
            assert ends[0] == ends[1]


def test_parameters_are_set_before_the_start(fmus: Path) -> None:
    for interface in ("me", "cs"):
        file = fmus / f"FirstOrderLag_{interface}.fmu"
        with load(file, start_values={"tau": 0.25, "u": 1.0}, step=0.05) as model, model.open_session() as session:
            session.advance(0.5, signals={})
            assert session.values(["y"])["y"] == pytest.approx(1.0 - np.exp(-2.0), rel=1e-5)


def test_the_wrong_token_is_refused_with_the_fmus_own_reason(fmus: Path, tmp_path: Path) -> None:
    file = tmp_path / "Wrong.fmu"
    with zipfile.ZipFile(fmus / "Hybrid_cs.fmu") as old, zipfile.ZipFile(file, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            new.writestr(name, data.replace(b'guid="{', b'guid="{0') if name.endswith(".xml") else data)
    with load(file) as model, pytest.raises(FmuError, match=r"cannot be instantiated.*GUID"):
        model.open_session()


def test_rates_of_states_that_are_no_variables_are_seen(fmus: Path) -> None:
    """Hybrid samples every 0.1 s from 0.05 s on, and has single events at 0.4 and 0.7 s; its states have no names."""
    for name in ("Hybrid_me.fmu", "Hybrid.fmu"):
        with load(fmus / name, "me") as model:
            found = rates_of(model)
        assert found.periods == (0.1,)
        assert found.begin == pytest.approx(0.7)
        assert not any("no variable" in note for note in found.notes)
    with load(fmus / "Hybrid_me.fmu") as model:
        result = trim(model)
    assert not result.converged  # a ball in the air
    assert any("discrete states are held: Hybrid: no equilibrium found by running" in note for note in result.notes)


def test_what_is_minus_another_variable_is_listed_and_refused(fmus: Path, tmp_path: Path) -> None:
    """It would be read with the sign of the other."""
    negated = (
        '<ScalarVariable name="minus{0}" valueReference="{1}" causality="{2}" variability="{3}" alias="negatedAlias">'
        '<Real start="-1.5"/></ScalarVariable>'
    )
    path = tmp_path / "Negated.fmu"
    with zipfile.ZipFile(fmus / "FirstOrderLag_me.fmu") as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.infolist():
            data = old.read(entry)
            if entry.filename == "modelDescription.xml":
                found = {v.name: v.value_reference for v in described_at(fmus / "FirstOrderLag_me.fmu").variables}
                more = negated.format("Y", found["y"], "output", "continuous")
                more += negated.format("Tau", found["tau"], "internal", "parameter")
                data = data.replace(b"</ModelVariables>", f"{more}</ModelVariables>".encode())
            new.writestr(entry, data)
    with load(path, "me") as model:
        assert "minusY and 1 more: minus another variable (negatedAlias), and only listed" in model.description.notes
        plain = simulate(model, stop=0.1)
        assert "minusY" in [v.name for v in model.outputs]
        assert "minusY" not in plain.signals
        for refused in (lambda: simulate(model, stop=0.1, outputs=["minusY"]), lambda: lin(model, outputs=["minusY"])):
            with pytest.raises(InputError, match=r"'minusY' of \w+ is minus another variable"):
                refused()
        with pytest.raises(InputError, match="minusTau: variables of type negated Real"):
            simulate(model.with_values({"minusTau": -2.0}), stop=0.1)


@pytest.mark.parametrize("version", [1, 2])
def test_fmus_get_memory_from_c_itself(version: int) -> None:
    """Through Python each call would take longer than most steps; some FMUs allocate in every one."""
    callbacks, module = {1: (callbacks1, fmi1), 2: (callbacks2, fmi2)}[version]
    for given, function in ((callbacks.allocateMemory, module.calloc), (callbacks.freeMemory, module.free)):
        assert ctypes.cast(given, ctypes.c_void_p).value == ctypes.cast(function, ctypes.c_void_p).value
