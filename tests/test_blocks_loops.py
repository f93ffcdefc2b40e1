"""A loop with each block in every analysis; blocks in SSP, in systems of co-simulation parts, saved and restored."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import workbench as wb
from tests.block_models import SAMPLES, alone, block, event_times, response
from workbench.core.values.arrays import Floats
from workbench.errors import InputError, SimulationError
from workbench.point.lin.delayed import pade, phase_holds_to, through_delays
from workbench.point.lin.task import LinTask
from workbench.system.block_table.registry import BLOCKS, entry_of
from workbench.system.files.ssp_read import read_ssp
from workbench.system.files.ssp_write import write_ssp
from workbench.system.files.toml_file import read_toml

HELD = {"product": 1.0, "switch": 1.0, "minimum": 0.2}  # second input
RESTLESS = {"relay", "maximum", "friction"}  # no equilibrium, or not at the start
LINEAR = {kind for kind in BLOCKS if block(kind).block.is_linear}


def loop(kind: str, gain: float = 1.0) -> wb.DescribedModel:
    """Return a loop r → block → gain/(s + 1)³ with the block."""
    component = block(kind)
    first, *others = component.block.inputs
    plant = {"numerator": [gain], "denominator": [1.0, 3.0, 3.0, 1.0]}
    return wb.connect(
        {"e": wb.SumComponent(name="e", signs=(1, -1)), "b": component,
         "p": wb.BlockComponent(name="p", kind="transfer_function", parameters=plant)},
        [("e.y", f"b.{first}"), ("b.y", "p.u"), ("p.y", "e.u2")],
        inputs={"r": "e.u1", **{name: f"b.{name}" for name in others}}, outputs={"y": "p.y", "v": "b.y"},
        bias=dict.fromkeys(others, HELD.get(kind, 0.3)), name=kind,
    )  # fmt: skip


@pytest.mark.parametrize("kind", BLOCKS)
def test_a_loop_in_every_analysis(kind: str) -> None:
    with loop(kind) as system:
        with system.open_session() as session:
            end = session.advance(3.0, signals={"r": wb.Constant(1.0)}, record=["y"]).values["y"][-1]
        linear = wb.lin(system).result
        found = wb.nfr(system, "r", "y", [0.1], [1.0], in_process=True)
        opened = wb.loop(system, "p.y", refine=0, in_process=True)
        trimmed = None if kind in RESTLESS else wb.trim(system)
    assert math.isfinite(end)
    assert len(linear.A) >= 3
    assert np.isfinite(found.gain).all()
    assert opened.linear is not None
    assert trimmed is None or trimmed.converged
    if kind in LINEAR and kind not in ("zero_order_hold", "discrete_transfer_function"):  # samplers are held
        exact = abs(linear.response([0.1])[0, list(linear.output_names).index("y"), 0])
        assert found.gain[0, 0] == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize("kind", ["saturation", "relay", "dead_band"])
def test_the_cycle_of_a_loop_with_a_block(kind: str) -> None:
    """Describing function: the phase of 1/(s + 1)³ is −180° at √3 rad/s, where its gain is 1/8."""
    with loop(kind, gain=12.0) as system:
        # With a dead band small motions settle, and larger ones grow without bound.
        methods = ["describing function", *{"relay": ["simulation"], "saturation": ["shooting"]}.get(kind, [])]
        found = wb.limit_cycle(system, block="b", band=(0.05, 2.0), amplitudes=(0.15, 50.0), methods=methods)
    known = block(kind).block.described()
    assert known is not None
    first, *_, last = found.limit_cycles if len(found.limit_cycles) > 1 else found.limit_cycles * 2
    if kind != "relay":  # a hysteresis turns the phase
        assert first.frequency_hz == pytest.approx(math.sqrt(3.0) / (2.0 * math.pi), rel=1e-4)
        formula = wb.standard_block(known.name, known.parameters)
        assert formula.gain(first.amplitude).real == pytest.approx(8.0 / 12.0, rel=1e-3)
    else:
        assert found.simulated is not None
        assert last.frequency_hz == pytest.approx(found.simulated.frequency_hz, rel=0.05)


def test_a_linear_block_is_refused_as_the_block_of_a_limit_cycle() -> None:
    with loop("delay") as system, pytest.raises(InputError, match=r"b is a delay, which is linear"):
        wb.limit_cycle(system, block="b")


# -- linear models ---------------------------------------------------------------------------------


def test_at_a_kink_one_slope_is_taken_and_both_are_told() -> None:
    with alone("lookup", {"x": [-1.0, 0.0, 1.0], "y": [-0.5, 0.0, 1.0]}) as model:
        found = wb.lin(model).result
    assert found.D[0, 0] in (0.5, 1.0)
    (doubt,) = found.doubts
    assert doubt.reason.startswith("a kink at the point: slope 0.5 below, 1 above; the one ")
    assert doubt.about == "kink"


@pytest.mark.parametrize("u", [0.2, 0.9, -0.9])
def test_the_slope_of_a_saturation_is_that_of_its_piece(u: float) -> None:
    with alone("saturation", {"lower": -0.5, "upper": 0.5}) as model:
        assert wb.lin(model, u0={"u": u}).D[0, 0] == (1.0 if abs(u) < 0.5 else 0.0)


@pytest.mark.parametrize("kind", BLOCKS)
def test_slopes_are_what_differences_give(kind: str) -> None:
    """Beside every kink: inputs 0.37, 0.43 … and states 0.05, 0.06 …."""
    with alone(kind) as model:
        u0 = {v.name: 0.37 + 0.06 * k for k, v in enumerate(model.inputs)}
        x0 = {v.name: 0.05 + 0.01 * k for k, v in enumerate(model.states)}
        if kind in LINEAR:
            return
        exact = wb.lin(model, u0=u0, x0=x0, method="exact").result
        other = wb.lin(model, u0=u0, x0=x0, method="difference").result
    for name in "ABCD":
        assert getattr(exact, name) == pytest.approx(getattr(other, name), rel=1e-5, abs=1e-7), name


def test_a_delay_is_exact_in_the_frequency_response_and_a_pade_approximation_in_state_space() -> None:
    frequencies = np.array([0.1, 0.5, 2.0])
    with loop("delay") as system:
        found = wb.lin(system).result
    s = 2j * np.pi * frequencies
    ahead = np.exp(-0.2 * s) / (s + 1.0) ** 3
    assert found.response(frequencies)[:, 0, 0] == pytest.approx(ahead / (1.0 + ahead), rel=1e-12)
    assert len(found.A) == 3 + 4
    a = found.A
    states = np.linalg.solve(s[1] * np.eye(len(a)) - a, found.B)
    assert (found.C @ states)[0, 0] == pytest.approx((ahead / (1.0 + ahead))[1], rel=1e-6)
    (note,) = (n for n in found.notes if n.startswith("b: delay of 0.2 s as a Padé approximation of order 4"))
    assert f"up to {phase_holds_to(0.2, 4):.3g} Hz" in note


@pytest.mark.parametrize("order", [1, 2, 4, 10])
def test_the_phase_of_a_pade_approximation_holds_as_far_as_is_said(order: int) -> None:
    a, b, c, d = pade(0.3, order)
    end = phase_holds_to(0.3, order)

    def off(f: float) -> float:
        value = (d + c @ np.linalg.solve(2j * np.pi * f * np.eye(order) - a, b))[0, 0]
        assert abs(value) == pytest.approx(1.0, abs=1e-9)
        return abs(math.degrees(np.angle(value * np.exp(2j * np.pi * f * 0.3))))

    assert max(off(f) for f in np.linspace(0.01 * end, 0.99 * end, 25)) < 1.01
    assert off(1.05 * end) > 1.0


def test_a_sampled_model_holds_a_delay_as_a_chain() -> None:
    parts = {"hold": wb.BlockComponent(name="hold", kind="discrete_transfer_function",
                                       parameters={"numerator": [0.5], "denominator": [1.0, -0.5], "period": 0.1}),
             "b": block("delay", {"delay": 0.3})}  # fmt: skip
    with wb.connect(parts, [("b.y", "hold.u")], inputs={"u": "b.u"}, outputs={"y": "hold.y"}) as system:
        found = wb.lin(system).result
    z = np.exp(2j * np.pi * 0.7 * 0.1)
    states = np.linalg.solve(z * np.eye(len(found.A)) - found.A, found.B)
    assert (found.D + found.C @ states)[0, 0] == pytest.approx(0.5 / (z - 0.5) * z**-3, rel=1e-9)


def test_a_hold_in_a_loop_is_sampled() -> None:
    """1/s behind a hold of 0.1 s, closed: x(k+1) = 0.9 x(k) + 0.1 r."""
    parts = {"e": wb.SumComponent(name="e", signs=(1, -1)), "b": block("zero_order_hold", {"period": 0.1}),
             "p": wb.BlockComponent(name="p", kind="integrator")}  # fmt: skip
    wires = [("e.y", "b.u"), ("b.y", "p.u"), ("p.y", "e.u2")]
    with wb.connect(parts, wires, inputs={"r": "e.u1"}, outputs={"y": "p.y"}) as system:
        found = wb.lin(system).result
    assert found.dt == pytest.approx(0.1)
    assert found.A[0, 0] == pytest.approx(0.9, rel=1e-7)
    assert found.B[0, 0] == pytest.approx(0.1, rel=1e-7)


def test_a_delay_has_no_period_map_and_nfr_waits_instead() -> None:
    with alone("delay", {"delay": 0.2}) as model:
        found = wb.nfr(model, "u", "y", [1.0], [1.0], in_process=True)
        assert found.gain[0, 0] == pytest.approx(1.0, abs=1e-4)
        assert found.phase_deg[0, 0] == pytest.approx(-72.0, abs=0.01)
    with loop("delay") as model, pytest.raises(InputError, match="the model has a transport delay"):
        wb.branches(model, "r", "y", amplitudes=[1.0], band=(0.5, 1.0), in_process=True)


# -- saved states, files, co-simulation ------------------------------------------------------------


@pytest.mark.parametrize("kind", BLOCKS)
def test_a_snapshot_brings_a_block_back(kind: str) -> None:
    with loop(kind) as system, system.open_session() as session:
        drive = {"r": wb.Sine(amplitude=1.0, frequency=0.4)}
        session.advance(1.7, signals=drive)
        saved = session.snapshot()
        session.restore(saved)  # both runs begin with a solver that knows nothing
        first = session.advance(4.0, signals=drive, record=["y", "v"]).values
        session.restore(saved)
        second = session.advance(4.0, signals=drive, record=["y", "v"]).values
    for name in ("y", "v"):
        assert second[name][-1] == pytest.approx(first[name][-1], rel=1e-9, abs=1e-12)


def test_a_system_file_and_an_ssp_hold_every_block(tmp_path: Path) -> None:
    lines = [f"{kind} = {entry_of(kind)}" for kind in BLOCKS]
    path = tmp_path / "all.toml"
    path.write_text("[components]\n" + "\n".join(lines), encoding="utf-8")
    description = read_toml(path)
    assert [c.kind for c in description.components if isinstance(c, wb.BlockComponent)] == list(BLOCKS)
    write_ssp(description, tmp_path / "all.ssp")
    again = read_ssp(tmp_path / "all.ssp")
    assert {c.name: c.block for c in again.components} == {c.name: c.block for c in description.components}  # type: ignore[union-attr]


def test_a_wrong_parameter_in_a_file_is_told_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text('[components]\nb = {block = "rate_limiter", risign = 1.0}\n', encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_toml(path)
    assert "[components] b: rate_limiter: parameter 'risign' is unknown; did you mean rising?" in str(caught.value)


def test_blocks_beside_a_co_simulation_part() -> None:
    """Blocks between co-simulation parts are stepped as a group; the limit is met at its instant."""
    limit = wb.BlockComponent(name="b", kind="saturation", parameters={"lower": -0.2, "upper": 0.2})
    later = wb.BlockComponent(name="d", kind="delay", parameters={"delay": 0.25})
    lag = wb.load("fmu:FirstOrderLag", interface="cs")
    with lag, wb.connect(
        {"b": limit, "d": later, "lag": lag}, [("b.y", "d.u"), ("d.y", "lag.u")],
        inputs={"r": "b.u"}, outputs={"y": "lag.y", "w": "d.y"}, step=0.01,
    ) as system, system.open_session() as session:  # fmt: skip
        points = np.linspace(0.0, 2.0, 201)[1:]
        record = session.advance(2.0, signals={"r": wb.Constant(1.0)}, record=["y", "w"], points=points)
    assert record.values["w"].max() == pytest.approx(0.2, abs=1e-12)
    assert record.values["y"][-1] == pytest.approx(0.2 * (1.0 - math.exp(-2.0)), abs=0.05)


def test_a_sliding_relay_is_refused_with_its_reason() -> None:
    parts = {"b": block("relay", {}), "i": wb.BlockComponent(name="i", kind="integrator", parameters={"gain": -1.0})}
    with (
        wb.connect(parts, [("b.y", "i.u"), ("i.y", "b.u")], outputs=["i.y"]) as system,
        system.open_session() as session,
        pytest.raises(SimulationError, match="chattering"),
    ):
        session.advance(1.0, signals={})


def test_every_sample_is_made() -> None:
    assert SAMPLES.keys() == BLOCKS.keys()


# -- pilots ----------------------------------------------------------------------------------------

PILOTS = [
    ("crossover_pilot", {"gain": 0.5, "lead": 0.4, "lag": 0.2, "neuromuscular": 0.1, "delay": 0.15}),
    ("crossover_pilot", {"gain": -2.0, "neuromuscular": 0.0, "delay": 0.2}),
    ("neal_smith_pilot", {"gain": 0.5, "lead": 0.1, "lag": 0.5}),
]


def pilot_response(given: Mapping[str, float], f: Floats) -> Floats:
    """Return McRuer's form at frequencies [Hz]; that of Neal and Smith is the one without the arm's lag."""
    s = 2j * np.pi * f
    lead, lag, arm = (given.get(n, 0.0) * s + 1.0 for n in ("lead", "lag", "neuromuscular"))
    return np.asarray(given["gain"] * lead / lag / arm * np.exp(-given.get("delay", 0.3) * s))


@pytest.mark.parametrize(("kind", "given"), PILOTS)
def test_a_pilot_has_its_published_frequency_response(kind: str, given: Mapping[str, float]) -> None:
    f = np.array([0.05, 0.3, 1.0, 2.0])
    exact = pilot_response(given, f)
    with alone(kind, given) as model:
        linear = wb.lin(model).result
        measured = wb.nfr(model, "u", "y", f, [1.0], in_process=True)
    assert np.abs(np.ravel(linear.response(f)) / exact - 1.0).max() < 1e-12
    got = np.ravel(measured.gain) * np.exp(1j * np.radians(np.ravel(measured.phase_deg)))
    assert np.abs(got / exact - 1.0).max() < 1e-5


def test_a_step_passes_a_pilot_after_its_delay() -> None:
    """gain (1 + (lead − lag)/lag e^(−t/lag)) after the delay, the jump at its instant."""
    given = {"gain": 2.0, "lead": 0.1, "lag": 0.5, "delay": 0.3}
    time, y = response("neal_smith_pilot", given, {"u": wb.Step(time=0.25, value=1.0)})
    late = time - 0.55
    exact = np.where(late < 0.0, 0.0, 2.0 * (1.0 - 0.8 * np.exp(-np.maximum(late, 0.0) / 0.5)))
    assert event_times(time) == pytest.approx([0.25, 0.55], abs=1e-9)
    assert np.abs(y - exact)[np.abs(late) > 1e-9].max() < 1e-5


def test_a_pilot_who_only_leads_is_refused() -> None:
    with pytest.raises(InputError, match=r"neal_smith_pilot: lead = 0.2 s needs a lag above 0"):
        block("neal_smith_pilot", {"lead": 0.2})


def test_a_pilot_holds_its_point_before_a_nonlinear_block() -> None:
    """What is behind the delay stands where it stood: the slope of the table is that at 0.5 · 3."""
    table = {"x": [0.0, 1.0, 2.0], "y": [0.0, 1.0, 4.0]}
    with wb.connect(
        {"b": block("neal_smith_pilot", {"gain": 0.5, "lag": 0.5}),
         "square": wb.BlockComponent(name="square", kind="lookup", parameters=table)},
        [("b.y", "square.u")], inputs={"u": "b.u"}, outputs={"y": "square.y"},
    ) as system:  # fmt: skip
        found = wb.lin(system, u0={"u": 3.0}, x0={"b.x1": 1.5})
    assert found.result.response([1e-6]).real.ravel()[0] == pytest.approx(1.5)


def test_two_delays_in_a_row_are_the_product_of_their_approximations() -> None:
    """1/(0.5 s + 1), 0.2 s, 0.3 s, beside a kink, whose doubt is not one of the delays."""
    first, second = (
        wb.BlockComponent(name=name, kind="delay", parameters={"delay": delay})
        for name, delay in (("a", 0.2), ("b", 0.3))
    )
    kink = wb.BlockComponent(name="k", kind="lookup", parameters={"x": [-1.0, 0.0, 1.0], "y": [-0.5, 0.0, 1.0]})
    parts = {"p": wb.BlockComponent(name="p", kind="transfer_function",
                                    parameters={"numerator": [1.0], "denominator": [0.5, 1.0]}),
             "s": wb.SumComponent(name="s", signs=(1, 1)), "a": first, "b": second,
             "k": kink}  # fmt: skip
    wires = [("p.y", "s.u1"), ("s.y", "a.u"), ("a.y", "b.u")]
    ports = {"u": "p.u", "through": "s.u2", "v": "k.u"}
    with wb.connect(parts, wires, inputs=ports, outputs={"y": "b.y", "w": "k.y"}) as system:
        found = wb.lin(system, inputs=["u", "through", "v"], outputs=["y", "w"]).result
    s = 2j * np.pi * 0.7
    states = np.linalg.solve(s * np.eye(len(found.A)) - found.A, found.B)
    delayed = 1.0 + 0.0j
    for delay in (0.2, 0.3):
        a, b, c, d = pade(delay, 4)
        delayed *= (d + c @ np.linalg.solve(s * np.eye(len(a)) - a, b)).item()
    assert (found.D + found.C @ states)[0] == pytest.approx(
        [delayed / (0.5 * s + 1.0), delayed, 0.0], rel=1e-9, abs=1e-12
    )
    assert [(x.row, x.column) for x in found.doubts] == [("w", "v")]


def test_what_is_no_system_has_no_delays_to_open() -> None:
    with wb.load("fmu:FirstOrderLag", "me") as model:
        task = LinTask(model=model, inputs=("u",), outputs=("y",))
        with pytest.raises(InputError, match="this is not a system"):
            through_delays(task, lambda _: pytest.fail("linearised"))
