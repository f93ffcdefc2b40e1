"""Third-party FMUs: OpenModelica's and one by PythonFMU3."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tests.gemseo import gemseo_fmu, needs_gemseo
from workbench.core.values.arrays import Floats
from workbench.errors import FmuError, InputError, SimulationError
from workbench.model.load import load
from workbench.response.simulate.request import simulate
from workbench.signals.kinds import Constant, Signal, Sine, Step, Table

pytestmark = needs_gemseo

M, C, D = 1.0, 1e4, 10.0


def oscillator(t: Floats, frequency: float) -> Floats:
    """y of Mass_Damper: y'' + 10 y' + 1e4 (y + 0.5) = sin(2π f t), at rest at y = 0."""
    omega = 2.0 * math.pi * frequency
    forced = 1.0 / complex(C - M * omega**2, D * omega)
    particular = (forced * np.exp(1j * omega * t)).imag
    pole = complex(-0.5 * D, math.sqrt(C - 0.25 * D**2))
    x0, v0 = 0.5 - forced.imag, -(forced * 1j * omega).imag
    coefficient = complex(x0, (pole.real * x0 - v0) / pole.imag)
    result: Floats = particular + (coefficient * np.exp(pole * t)).real - 0.5
    return result


@pytest.mark.parametrize(
    ("solver", "tolerance", "accuracy"), [("vkm", 1e-6, 1e-4), ("gear", 1e-6, 2e-4), ("gear", 1e-9, 1e-6)]
)
def test_mass_damper_by_model_exchange_matches_the_analytic_solution(
    solver: str, tolerance: float, accuracy: float
) -> None:
    with load(gemseo_fmu("Mass_Damper"), "me", solver, tolerance=tolerance) as model:
        result = simulate(model, stop=1.0, inputs={"f": Sine(frequency=5.0)}, outputs=["y"], interval=0.01)
    assert len(result.time) == 101
    assert np.max(np.abs(result.signals["y"] - oscillator(result.time, 5.0))) < accuracy


def test_mass_damper_by_cosimulation_is_explicit_euler() -> None:
    with load(gemseo_fmu("Mass_Damper"), "cs", step=1e-4) as model:
        result = simulate(
            model, stop=0.2, inputs={"f": Sine(frequency=5.0)}, outputs=["y"], interval=0.01, verify_step=False
        )
        assert np.max(np.abs(result.signals["y"] - oscillator(result.time, 5.0))) < 0.02
        coarse = simulate(model, stop=0.2, outputs=["y"])
    assert any("changes by" in note for note in coarse.notes)


def test_a_diverging_cosimulation_does_not_pass_silently() -> None:
    with load(gemseo_fmu("Mass_Damper"), "cs") as model:
        result = simulate(model, stop=2.0, inputs={"f": Sine(frequency=1.0)})
        assert "half the communication step" in result.notes[0]
        with pytest.raises(SimulationError, match=r"returned error|not a finite") as caught:
            simulate(model, stop=400.0, inputs={"f": Sine(frequency=0.5)}, verify_step=False)
    assert caught.value.time is not None


def test_auto_takes_model_exchange_and_gear_and_says_so() -> None:
    with load(gemseo_fmu("Mass_Damper")) as model:
        assert (model.interface, model.solver) == ("me", "gear")
        assert any("interface: me" in note for note in model.notes)
        assert any("gear" in note for note in model.notes)
        assert [v.name for v in model.states] == ["damper.s_rel", "damper.v_rel"]
        assert model.inputs[0].unit == "N"
        assert model.snapshot_method() == "replay"


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_mass_spring_system_follows_its_matrix(interface: str) -> None:
    with load(gemseo_fmu("MassSpringSystem"), interface, step=1e-4 if interface == "cs" else None) as model:
        names = [v.name for v in model.states]
        with model.open_session() as session:
            session.advance(0.0, signals={})
            start = session.values(names)
            record = session.advance(1.0, signals={}, record=names)
    # x1'' = −2 x1 + x2, x2'' = x1 − 2 x2 (masses and stiffnesses 1)
    x = np.array([start[n] for n in names])
    order = [next(i for i, n in enumerate(names) if n.endswith(s)) for s in ("v1", "v2", "x1", "x2")]
    system = np.array([[0, 0, -2, 1], [0, 0, 1, -2], [1, 0, 0, 0], [0, 1, 0, 0]], dtype=float)
    values, vectors = np.linalg.eig(system)
    expected = (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors) @ x[order]).real
    reached = np.array([record.values[names[i]][-1] for i in order])
    assert reached == pytest.approx(expected, abs=2e-5 if interface == "me" else 1e-3)


@pytest.mark.parametrize("interface", ["me", "cs"])
def test_add_feeds_through_and_takes_bias(interface: str) -> None:
    signals: dict[str, Signal] = {"u1": Step(time=0.5, value=3.0), "u2": Constant(1.0)}
    with load(gemseo_fmu("add"), interface, bias={"u2": 0.25}) as model:
        result = simulate(model, stop=1.0, inputs=signals, interval=0.25)
    assert result.signals["y"][0] == 1.25
    assert result.signals["y"][-1] == 4.25
    at = result.time == 0.5
    assert result.signals["y"][at].tolist() == [1.25, 4.25]


def test_cosimulation_inputs_are_linear_where_the_fmu_interpolates() -> None:
    ramp = Table([0.0, 1.0], [0.0, 1.0])
    with load(gemseo_fmu("add"), "cs", step=0.1) as model, model.open_session() as session:
        record = session.advance(0.3, signals={"u1": ramp}, record=["y"])
    assert record.values["y"] == pytest.approx(record.inputs["u1"], abs=1e-12)
    assert record.inputs["u1"] == pytest.approx(record.time, abs=1e-12)


def test_ramp_has_its_state_events_located() -> None:
    with load(gemseo_fmu("ramp"), start_values={"ramp.startTime": 0.3, "ramp.duration": 0.4}) as model:
        assert model.solver == "none"
        result = simulate(model, stop=1.0, interval=0.5)
    twice = result.time[:-1][np.diff(result.time) == 0.0]
    assert twice == pytest.approx([0.3, 0.7], abs=1e-9)
    assert np.interp(0.5, result.time, result.signals["out"]) == pytest.approx(0.5, abs=1e-9)


def test_two_sessions_at_once_do_not_disturb_each_other() -> None:
    signals = {"f": Sine(frequency=3.0)}
    with load(gemseo_fmu("Mass_Damper")) as model:
        with model.open_session() as a, model.open_session() as b:
            for until in (0.1, 0.2):
                a.advance(until, signals=signals)
                b.advance(until, signals={})
            mixed = a.values(["y"])
        with model.open_session() as alone:
            for until in (0.1, 0.2):
                alone.advance(until, signals=signals)
            assert alone.values(["y"]) == mixed


def test_fmi_3_scalars_and_arrays() -> None:
    signals: dict[str, Signal] = {"input": Constant(2.0), "int32": Constant(5.0)}
    with load(gemseo_fmu("FMU3Model")) as model:
        assert model.interface == "cs"
        assert "vector[3]" in [v.name for v in model.outputs]
        try:
            session = model.open_session()
        except FmuError as error:
            if "libpython" not in str(error):
                raise
            pytest.skip(
                f"this FMU is written in Python and loads libpython, which this Python was built without: {error}"
            )
        with session:
            record = session.advance(0.2, signals=signals, record=["int32", "vector[2]", "boolean"])
    assert record.values["int32"][-1] == 5.0
    assert record.values["vector[2]"][-1] == 1.0
    assert record.values["boolean"][-1] == 1.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"interface": "mee"}, "interface 'mee' is unknown"),
        ({"solver": "gears"}, "did you mean gear"),
        ({"solver": "none"}, "2 continuous states"),
        ({"interface": "cs", "solver": "vkm"}, "brings its own"),
        ({"step": 0.0}, "step: 0 is not a positive number"),
        ({"tolerance": 2.0}, "tolerance: 2 is too large; it must be below 1"),
        ({"start_values": {"sprung.c": 1.0}}, "did you mean spring.c"),
        ({"start_values": {"spring.c": "much"}}, "'much' is not"),
        ({"bias": {"y": 1.0}}, "bias: 'y' of the model is an output; its inputs are: f"),
        ({"bias": {"f": math.nan}}, "bias: f: nan is not a number"),
    ],
)
def test_load_refuses_in_one_line(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        load(gemseo_fmu("Mass_Damper"), **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_an_interface_that_is_not_offered_is_refused() -> None:
    with pytest.raises(InputError, match="interface me is not offered; it has: cs"):
        load(gemseo_fmu("FMU3Model"), "me")


def test_a_wrong_guid_is_refused_with_the_fmus_own_words(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "wrong"
    with zipfile.ZipFile(gemseo_fmu("Mass_Damper")) as archive:
        archive.extractall(folder)
    xml = folder / "modelDescription.xml"
    xml.write_text(re.sub(r'guid="\{.*?\}"', 'guid="{wrong}"', xml.read_text(), count=1))
    with load(folder) as model, pytest.raises(FmuError, match=r"cannot be instantiated; its log: .*GUID"):
        model.open_session()
    assert capfd.readouterr().out == ""
    shutil.rmtree(folder)


def test_parameters_are_set_before_initialisation() -> None:
    with load(gemseo_fmu("Mass_Damper"), start_values={"spring.c": 4e4}) as model, model.open_session() as session:
        assert session.values(["spring.c"]) == {"spring.c": 4e4}
        session.advance(0.1, signals={})
        rate = math.sqrt(4e4 - 25.0)
        expected = 1.0 - 0.5 * math.exp(-0.5) * (math.cos(0.1 * rate) + 5.0 / rate * math.sin(0.1 * rate))
        assert session.values(["damper.s_rel"])["damper.s_rel"] == pytest.approx(expected, abs=1e-4)


MANY_INSTANCES = """
import ctypes
from tests.gemseo import gemseo_fmu
from workbench.model.load import load

file = gemseo_fmu("MassSpringSystem")
with load(file, "cs") as first:
    for _ in range(1100):  # more than a process has thread-specific keys
        first.open_session().close()
    with first.recipe.open() as again, again.open_session():
        pass
for _ in range(5):  # binaries that were not loaded before
    with load(file, "cs") as other, other.open_session():
        pass
assert ctypes.CFUNCTYPE(ctypes.c_int)(lambda: 7)() == 7  # Python still finds its own
"""

NO_KEY_LEFT = """
import ctypes
from tests.gemseo import gemseo_fmu
from workbench.errors import FmuError
from workbench.model.load import load

own = ctypes.CDLL(None)
while own.pthread_key_create(ctypes.byref(ctypes.c_ulong()), None) == 0:
    pass
try:
    with load(gemseo_fmu("MassSpringSystem"), "cs") as model, model.open_session():
        raise AssertionError("it was loaded")
except FmuError as error:
    assert "no thread-specific key is left" in str(error), error
"""


@pytest.mark.skipif(sys.platform == "win32", reason="the keys are those of POSIX threads")
@pytest.mark.parametrize("code", [MANY_INSTANCES, NO_KEY_LEFT], ids=["many instances", "no key left"])
def test_keys_that_an_fmu_leaves_behind_crash_nobody(code: str) -> None:
    """Each instance of OpenModelica's FMUs takes a key; a binary that never got one writes into Python's."""
    done = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, text=True, cwd=Path(__file__).parents[1]
    )
    assert done.returncode == 0, done.stderr
