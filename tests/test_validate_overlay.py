"""The Bode overlay against closed forms: what sines show of a plant, of its samples, and of a sampled law."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from workbench.core.values.arrays import Floats
from workbench.core.values.decibels import follow_phase
from workbench.core.values.operating_point import OperatingPoint
from workbench.errors import InputError
from workbench.identification.identified.model import IdentifiedModel
from workbench.identification.subspace.picture import plot_order
from workbench.identification.validate.overlay import Overlay, overlay
from workbench.identification.validate.picture import plot_poles
from workbench.identification.validate.pole_zero import near_cancellations
from workbench.point.lin.result import Intersample, LinResult
from workbench.response.nfr.result import NfrResult

DT = 0.02
A = np.array([[0.0, 1.0], [-400.0, -12.0]])
B = np.array([[0.0], [400.0]])
C = np.array([[1.0, 0.0]])


def plant(frequency: Floats) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    s = 2j * np.pi * frequency
    return np.asarray(400.0 / (s**2 + 12.0 * s + 400.0), dtype=np.complex128)


def identified(*, delay: int = 0, A_d: Floats | None = None) -> IdentifiedModel:
    held = expm(DT * np.block([[A, B], [np.zeros((1, 3))]]))
    F, G, H = held[:2, :2] if A_d is None else A_d, held[:2, 2:], C
    if delay:  # the chain of delays are the last states
        chain = np.eye(delay, k=-1)
        F = np.block([[F, np.hstack([np.zeros((2, delay - 1)), G])], [np.zeros((delay, 2)), chain]])
        G, H = np.vstack([np.zeros((2, 1)), np.eye(delay)[:, :1]]), np.hstack([C, np.zeros((1, delay))])
    n = len(F)
    return IdentifiedModel(
        A=F, B=G, C=H, D=np.zeros((1, 1)), K=np.zeros((n, 1)), x0=np.zeros(n), dt=DT, u0=np.zeros(1), y0=np.zeros(1),
        covariance=np.eye(1), input_names=("u",), output_names=("y",), input_units=(None,), output_units=("deg",),
        delay=(delay,) if delay else (), name="Plant",
    )  # fmt: skip


def linear(*, dt: float = 0.0, sampled: bool = False) -> LinResult:
    model = identified()
    a, b = (A, B) if dt == 0.0 else (model.A, model.B)
    # Held from sample to sample: the output of a sampled law.
    between = Intersample(np.array([0.0, dt]), np.stack([C, C])[None], np.zeros((1, 2, 1, 1)), sampled=True)
    return LinResult(
        model="Plant", interface="me", method="exact", why="", A=a, B=b, C=C, D=np.zeros((1, 1)), dt=dt,
        state_names=("a", "b"), input_names=("u",), output_names=("y",), units={},
        operating_point=OperatingPoint(x={}, u={}, y={}), intersample=between if sampled else None,
    )  # fmt: skip


def measured(frequency: Floats, rows: dict[float, object]) -> NfrResult:
    response = np.array(list(rows.values()), dtype=np.complex128)
    shape = response.shape
    averaged = np.zeros(shape, dtype=np.bool_)
    averaged[:, -1] = True
    return NfrResult(
        model="Plant", interface="me", solver="vkm", input="u", output="y", input_unit=None, output_unit="deg",
        frequency_hz=frequency, amplitude=np.array(list(rows)), response=response,
        phase_deg=np.array([follow_phase(row) for row in response]), offset=np.zeros(shape), averaged=averaged,
        error=np.full(shape, np.nan), stable=np.full(shape, np.nan),
        periods=np.ones(shape, dtype=np.int64), step=np.full(shape, np.nan), failed=(), warnings=(),
        certificates=tuple((None,) * shape[1] for _ in range(shape[0])),
    )  # fmt: skip


FREQUENCY = np.geomspace(0.5, 24.0, 12)


def test_the_hold_of_a_continuous_plant_is_taken_out_exactly() -> None:
    found = overlay(identified(), lin=linear(), nfr=measured(FREQUENCY, {1.0: plant(FREQUENCY)}))
    assert found.reference == "the response measured at amplitude 1"
    for name in ("identified", "linearised"):
        assert found.difference(name).worst() == pytest.approx((0.0, 0.0), abs=1e-6)
        assert found.difference(name).within(1e-3, 1e-3)
    assert "up to 24 Hz" in found.words[0]


def test_without_that_the_hold_turns_the_phase() -> None:
    low = np.array([0.1, 0.5, 1.0])  # no aliasing to speak of
    found = overlay(identified(), nfr=measured(low, {1.0: plant(low)}), plant="held").difference()
    np.testing.assert_allclose(found.phase_deg, -180.0 * low * DT, atol=0.02)


def test_a_delay_turns_the_phase_and_leaves_the_gain() -> None:
    found = overlay(identified(delay=2), nfr=measured(FREQUENCY, {1.0: plant(FREQUENCY)})).difference()
    np.testing.assert_allclose(found.gain_db, 0.0, atol=1e-6)
    turned = (-360.0 * FREQUENCY * 2 * DT + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(found.phase_deg, turned, atol=1e-6)


def test_a_sampled_law_has_its_hold_behind_it() -> None:
    law = linear(dt=DT, sampled=True)
    found = overlay(identified(), lin=law, frequencies=FREQUENCY)  # taken as sampled since the linearisation is
    assert found.reference == "linearised"
    assert found.difference().worst() == pytest.approx((0.0, 0.0), abs=1e-6)
    wrong = overlay(identified(), lin=law, frequencies=FREQUENCY, plant="continuous").difference()
    assert wrong.worst()[1] > 90.0


def test_a_pole_on_the_negative_axis_has_no_continuous_model_but_an_overlay() -> None:
    model = identified(A_d=np.array([[0.5, 0.1], [0.0, -0.3]]))
    found = overlay(model, lin=linear(), frequencies=np.array([1.0, 5.0]))
    assert any("by division" in note for note in found.notes)
    z = np.exp(2j * np.pi * np.array([1.0, 5.0]) * DT)
    held = (1.0 - 1.0 / z) / np.log(z)
    np.testing.assert_allclose(
        found.curves["identified"], model.response(np.array([1.0, 5.0]))[:, 0, 0] / held, rtol=1e-9
    )


def test_nothing_is_said_beyond_the_nyquist_frequency() -> None:
    wide = np.array([1.0, 10.0, 30.0])
    found = overlay(identified(), nfr=measured(wide, {1.0: plant(wide)}))
    assert found.nyquist_hz == 25.0
    assert np.isnan(found.difference().gain_db[2])
    assert np.isfinite(found.difference().gain_db[:2]).all()
    assert np.isnan(found.difference().worst(0.5)[0])
    assert not found.difference().within(100.0, 180.0, up_to_hz=0.5)


def test_without_frequencies_the_curves_run_over_those_that_were_measured() -> None:
    found = overlay(identified(), nfr=measured(FREQUENCY, {1.0: plant(FREQUENCY)}))
    assert found.frequency_hz[[0, -1]] == pytest.approx(FREQUENCY[[0, -1]])


def test_the_amplitude_of_the_reference() -> None:
    nfr = measured(FREQUENCY, {1.0: plant(FREQUENCY), 2.0: 0.5 * plant(FREQUENCY)})
    assert overlay(identified(), nfr=nfr, amplitude=1.0).difference().worst()[0] == pytest.approx(0.0, abs=1e-6)
    half = overlay(identified(), nfr=nfr, amplitude=2.0).difference()
    assert half.worst()[0] == pytest.approx(20.0 * np.log10(2.0))
    with pytest.raises(InputError, match="several were measured"):
        overlay(identified(), nfr=nfr)
    with pytest.raises(InputError, match="amplitude 3 was not measured"):
        overlay(identified(), nfr=nfr, amplitude=3.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "give a linearisation, a measured frequency response or both"),
        ({"lin": linear(), "input": "v"}, "input 'v' is not in the model; known: u"),
        ({"lin": linear(), "plant": "smapled"}, "plant 'smapled' is unknown; did you mean sampled"),
    ],
)
def test_wrong_settings_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        overlay(identified(), **options)  # type: ignore[arg-type]


def whole() -> Overlay:
    nfr = measured(FREQUENCY, {1.0: plant(FREQUENCY), 2.0: 0.5 * plant(FREQUENCY)})
    return overlay(identified(), lin=linear(), nfr=nfr, amplitude=1.0)


def test_through_json_csv_and_picture(tmp_path: Path) -> None:
    found = whole()
    saved = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert set(saved["curves"]) == {"identified", "linearised"}
    assert len(saved["differences"][0]["gain_db"]) == len(FREQUENCY)
    found.to_csv(tmp_path / "overlay.csv")
    lines = (tmp_path / "overlay.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "curve,frequency_hz,difference_db,difference_deg"
    assert len(lines) == 1 + 2 * len(FREQUENCY)
    figure = found.plot(tmp_path / "overlay.svg")
    labels = [ax.get_ylabel() for ax in figure.get_axes()]
    assert labels == ["gain [dB]", "phase [deg]", "difference [dB]", "difference [deg]"]
    assert figure.get_axes()[-1].get_xlabel() == "frequency [Hz]"
    with pytest.raises(InputError, match="curve 'lin' is not compared; known: identified, linearised"):
        found.difference("lin")


def test_pole_zero_picture() -> None:
    model = identified(delay=1)
    figure = plot_poles(model, cancellations=near_cancellations(model, near=10.0))
    assert figure.get_axes()[0].get_xlabel() == "real part [1]"
    texts = [cell.get_text().get_text() for cell in figure.get_axes()[1].tables[0].get_celld().values()]
    assert "3.1831" in texts  # 20 rad/s in Hz
    assert "0.3" in texts


def test_picture_of_the_order() -> None:
    from workbench.identification.subspace.estimate import estimate

    rng = np.random.default_rng(0)
    u = np.sign(rng.normal(size=(600, 1)))
    found = estimate(u, identified().simulate(u) + 0.01 * rng.normal(size=(600, 1)), DT)
    axes = plot_order(found).get_axes()
    assert axes[1].get_ylabel() == "principal angle [deg]"
    assert axes[-1].get_xlabel() == "order"
    assert len(axes) == (3 if len(found.order_criterion) else 2)


def test_curves_in_other_units_are_converted_and_told() -> None:
    """A record in degrees beside a linear model in radians, of which the response in deg/deg is the same."""
    model = replace(identified(), input_units=("rad",))  # deg/rad: larger by 180/π than the plant in deg/deg
    turned = replace(model, B=model.B * 180.0 / np.pi)
    radians = replace(linear(), units={"u": "rad", "y": "rad"})
    sines = replace(measured(FREQUENCY, {1.0: plant(FREQUENCY)}), input_unit="deg", output_unit="deg")
    found = overlay(turned, lin=radians, nfr=sines)
    for curve in ("identified", "linearised"):
        assert found.difference(curve).worst()[0] == pytest.approx(0.0, abs=1e-6), curve
    assert "identified: the input is converted from rad to deg" in found.notes
    assert "linearised: the output is converted from rad to deg" in found.notes
    without = overlay(turned, lin=radians)  # in the units of the identified model
    assert without.difference().worst()[0] == pytest.approx(0.0, abs=1e-6)
    assert overlay(identified(), lin=replace(radians, units={"y": "deg"})).notes == ()
    with pytest.raises(InputError, match=r"output of the linearised model is in 'V'.*do not measure the same"):
        overlay(identified(), lin=replace(radians, units={"y": "V"}))
    with pytest.raises(InputError, match="the unit 'furlong' is not known"):
        overlay(identified(), lin=replace(radians, units={"y": "furlong"}))
