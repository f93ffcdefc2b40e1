"""One model of several inputs and outputs from their responses: exact ones, noisy ones, the bound, files, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from scipy.io import savemat

import workbench as wb
from workbench.cli.app import run
from workbench.core.values.arrays import Complex, Floats
from workbench.errors import InputError
from workbench.identification.fit.matrix import Points, fitted_matrix

F = np.geomspace(0.01, 5.0, 50)
CIRCLE = np.sqrt(-np.log(0.05))  # radius that 95 % of complex normal numbers of E|e|² = 1 stay in


def plant(seed: int, n: int, p: int, m: int) -> wb.Linear:
    """A stable system of modes between 0.1 and 10 rad/s, single states and pairs of any damping."""
    random = np.random.default_rng(seed)
    blocks: list[Floats] = []
    while (left := n - sum(map(len, blocks))) > 0:
        w = float(10.0 ** random.uniform(-1.0, 1.0))
        if left >= 2 and random.random() < 0.6:
            z = random.uniform(0.05, 0.7)
            turn = w * np.sqrt(1.0 - z * z)
            blocks.append(np.array([[-z * w, turn], [-turn, -z * w]]))
        else:
            blocks.append(np.array([[-w]]))
    A = scipy.linalg.block_diag(*blocks)
    size = np.sqrt(np.abs(np.diag(A)))
    B, C = random.standard_normal((n, m)) * size[:, None], random.standard_normal((p, n)) * size
    return wb.Linear(A=A, B=B, C=C, D=0.3 * random.standard_normal((p, m)))


def curves(model: wb.Linear, sigma: float = 0.0, seed: int = 0) -> list[wb.Response]:
    """Its responses, channel by channel, with noise of a known size relative to each value."""
    random, G = np.random.default_rng(seed), model.response(F)
    e = (random.standard_normal(G.shape) + 1j * random.standard_normal(G.shape)) / np.sqrt(2.0)
    # The error is relative to the true value; the fit knows the measured one, which differs by less than 1 %.
    return [
        wb.Response(
            F, G[:, i, j] * (1.0 + sigma * e[:, i, j]), np.full(len(F), CIRCLE * sigma), input=f"u{j}", output=f"y{i}"
        )
        for i, j in np.ndindex(*model.D.shape)
    ]


def bound(model: wb.Linear, points: Points) -> Floats:
    """Cramér-Rao variance of the model's value at each point over sigma², shape (k,).

    From central differences by all entries of A, B, C, D, of which as many directions as the model has numbers count:
    nothing of the fit's own derivatives.
    """
    n, (p, m) = len(model.A), model.D.shape
    parts = [np.array(x) for x in (model.A, model.B, model.C, model.D)]
    frequency = points.s.imag / (2.0 * np.pi)

    def values() -> Complex:
        A, B, C, D = parts
        found = wb.Linear(A=A, B=B, C=C, D=D).response(frequency)
        return np.asarray(found[np.arange(len(frequency)), points.row, points.column] / points.sigma)

    slopes = []
    for part in parts:
        for at in np.ndindex(part.shape):
            step, kept = 1e-5 * max(1.0, abs(float(part[at]))), float(part[at])
            part[at] = kept + step
            above = values()
            part[at] = kept - step
            slopes.append((above - values()) / (2.0 * step))
            part[at] = kept
    J = np.array(slopes).T
    left = np.linalg.svd(np.vstack([J.real, J.imag]), full_matrices=False)[0][:, : n * (p + m) + p * m]
    both = 0.5 * np.sum(left**2, axis=1)
    return np.asarray(both[: len(frequency)] + both[len(frequency) :])


@pytest.mark.parametrize("shape", [(1, 2), (2, 2), (3, 2)])
def test_exact_responses_give_the_poles_and_the_order(shape: tuple[int, int]) -> None:
    model = plant(7, 4, *shape)
    first, *others = curves(model)
    found = wb.fit(first, also=others, max_order=6)
    assert found.order == 4
    assert np.sort_complex(found.poles) == pytest.approx(np.sort_complex(model.poles), rel=1e-6)
    assert found.misfit.max() < 1e-7
    assert found.response(F) == pytest.approx(model.response(F), rel=1e-6)


def test_noise_costs_what_theory_says() -> None:
    """Cost against χ², error against the Cramér-Rao bound, over random systems of known variance."""
    ratios, far = [], []
    for seed in range(18):
        n, (p, m) = 1 + seed % 6, ((1, 2), (2, 1), (2, 2))[seed // 6]
        model, random = plant(seed, n, p, m), np.random.default_rng(1000 + seed)
        row, column = (np.tile(k, len(F)) for k in (np.repeat(np.arange(p), m), np.tile(np.arange(m), p)))
        s = np.asarray(2j * np.pi * np.repeat(F, p * m), dtype=np.complex128)
        at = np.repeat(np.arange(len(F)), p * m)
        G = model.response(F)
        true = G[at, row, column]
        sigma = 0.01 * np.abs(true) + 0.002 * np.abs(G).max()
        e = (random.standard_normal(len(s)) + 1j * random.standard_normal(len(s))) / np.sqrt(2.0)
        points = Points(s, row, column, true + sigma * e, sigma)
        fit = fitted_matrix(points, n, direct=True, stable=True)
        A, B, C, D = fit.matrices
        found = wb.Linear(A=A, B=B, C=C, D=D).response(F)[at, row, column]
        ratios.append(np.sqrt(np.mean(np.abs((found - true) / sigma) ** 2) / np.mean(bound(model, points))))
        free = 2 * len(s) - fit.freedom
        far.append((2.0 * fit.cost - free) / np.sqrt(2.0 * free))
    assert np.median(ratios) == pytest.approx(1.0, abs=0.15)
    assert max(ratios) < 1.7
    # Normal numbers of variance 1: of 18 the mean is known to 0.24, and none lies beyond 4.
    assert abs(np.mean(far)) < 0.75
    assert np.abs(far).max() < 4.0


def test_errors_of_the_poles_are_what_they_scatter_by() -> None:
    model = plant(3, 3, 1, 2)
    true = np.sort_complex(model.poles)
    off, said = [], []
    for seed in range(20):
        first, *others = curves(model, 0.01, seed)
        found = wb.fit(first, also=others, order=3, accuracy=0.0)
        order = np.argsort(found.poles)
        off.append(np.abs(found.poles[order] - true))
        said.append(found.pole_spread[order])
    measured = np.sqrt(np.mean(np.square(off), axis=0))
    # Of 20 the root mean square is known to about 16 %.
    assert np.median(said, axis=0) == pytest.approx(measured, rel=0.4)


def test_the_order_is_right_under_noise() -> None:
    orders = []
    for seed in range(6):
        first, *others = curves(plant(seed + 20, 3, 2, 1), 0.005, seed)
        orders.append(wb.fit(first, also=others, max_order=4, accuracy=0.0).order)
    assert np.mean(np.array(orders) == 3) >= 0.8


def test_equal_poles_of_two_channels_are_two_states() -> None:
    """diag(1/(s + 1), 1/(s + 1)): the residue at −1 has rank two."""
    s = np.asarray(2j * np.pi * F, dtype=np.complex128)
    lag = np.asarray(1.0 / (s + 1.0), dtype=np.complex128)
    values = {(0, 0): lag, (1, 1): lag, (0, 1): np.full_like(s, 0.1), (1, 0): np.full_like(s, 0.2)}
    given = [wb.Response(F, v, input=f"u{j}", output=f"y{i}") for (i, j), v in values.items()]
    found = wb.fit(given[0], also=given[1:], max_order=4)
    assert found.order == 2
    assert found.poles == pytest.approx([-1.0, -1.0], abs=1e-9)
    assert found.misfit.max() < 1e-12  # companion blocks come to 1e-7 to 3e-4, by the processor


def test_a_residue_of_rank_two_beside_another_pole_is_found_to_rounding() -> None:
    s = 2j * np.pi * F
    for seed in range(6):
        draw = np.random.default_rng(seed)
        R, w, v = draw.normal(size=(2, 2)), draw.normal(size=2), draw.normal(size=2)
        given = [
            wb.Response(F, R[i, j] / (s + 2.0) + w[i] * v[j] / (s + 20.0), input=f"u{j}", output=f"y{i}")
            for i in (0, 1)
            for j in (0, 1)
        ]
        found = wb.fit(given[0], also=given[1:], order=3)
        assert np.sort(found.poles.real) == pytest.approx([-20.0, -2.0, -2.0], rel=1e-9)
        assert found.misfit.max() < 1e-12


def test_channels_may_have_their_own_frequencies_and_a_delay() -> None:
    model = plant(11, 3, 2, 1)
    given = []
    for i, f in enumerate((F[:30], F[10:])):
        late = model.response(f)[:, i, 0] * np.exp(-2j * np.pi * f * 0.05)
        given.append(wb.Response(f, late, input="u", output=f"y{i}"))
    found = wb.fit(given[0], also=given[1:], order=3, delay=0.05)
    assert np.sort_complex(found.poles) == pytest.approx(np.sort_complex(model.poles), rel=1e-6)
    assert found.fitted == pytest.approx(found.measured)
    assert [int(at.sum()) for at in found.channels.values()] == [30, 40]


def test_sines_at_two_outputs_of_a_model_make_one_model(tmp_path: Path) -> None:
    """Output and state of a lag: one model of both, from two measurements."""
    with wb.load("fmu:FirstOrderLag") as lag:
        first = wb.nfr(lag, "u", "y", band=(0.02, 2.0), amplitudes=[1.0])
        second = wb.nfr(lag, "u", "x", band=(0.02, 2.0), amplitudes=[1.0])
    for name, record in (("y", first), ("x", second)):
        (tmp_path / f"{name}.json").write_text(json.dumps(record.to_dict()), encoding="utf-8")
    files = ["--also", str(tmp_path / "x.json"), "--json", str(tmp_path / "m.json"), "--csv", str(tmp_path / "m.csv")]
    assert run(["identify", str(tmp_path / "y.json"), *files, "--plot", str(tmp_path / "m.png")]) == 0
    found = wb.FitResult.read(tmp_path / "m.json")
    assert found.output_names == ("y", "x")
    assert found.poles == pytest.approx([-1.0], rel=0.01)
    assert (tmp_path / "m.csv").read_text(encoding="utf-8").splitlines()[1].startswith("y/u,")
    assert json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))["of_output"][-1] == 1
    assert (tmp_path / "m.png").stat().st_size > 10_000
    again = wb.FitResult.from_dict(found.to_dict())
    assert again.fitted == pytest.approx(found.fitted)


def test_tables_and_matlab_name_their_channels(tmp_path: Path) -> None:
    model = plant(5, 2, 2, 2)
    G = model.response(F)
    names = [f"{kind} y{i}/u{j}" for i, j in np.ndindex(2, 2) for kind in ("gain_db", "phase")]
    columns = [
        x for i, j in np.ndindex(2, 2) for x in (20.0 * np.log10(np.abs(G[:, i, j])), np.angle(G[:, i, j], deg=True))
    ]
    np.savetxt(
        tmp_path / "r.csv", np.column_stack([F, *columns]), delimiter=",", header=",".join(["frequency", *names]),
        comments="", fmt="%.17g",
    )  # fmt: skip
    savemat(tmp_path / "r.mat", {"ResponseData": np.moveaxis(G, 0, 2), "Frequency": 2.0 * np.pi * F[:, None]})
    for name, outputs in (("r.csv", ("y0", "y1")), ("r.mat", ("y1", "y2"))):
        found = wb.fit(tmp_path / name, order=2)
        assert found.output_names == outputs
        assert np.sort_complex(found.poles) == pytest.approx(np.sort_complex(model.poles), rel=1e-6), name


def test_an_error_column_weights_a_table(tmp_path: Path) -> None:
    """Relative, 95 %, as nfr writes it: a point that is known badly does not matter."""
    value = 1.0 / (2j * np.pi * F + 1.0)
    value[25] *= 3.0
    error = np.where(np.arange(len(F)) == 25, 100.0, 0.01)
    table = np.column_stack([F, value.real, value.imag, error])
    np.savetxt(tmp_path / "r.csv", table, delimiter=",", header="frequency,real,imag,error", comments="", fmt="%.17g")
    assert wb.fit(tmp_path / "r.csv", order=1).poles == pytest.approx([-1.0], abs=1e-3)


def test_channels_without_errors_beside_others_that_have_them_are_named() -> None:
    first, second, *others = curves(plant(1, 2, 2, 2), 0.02)
    bare = wb.Response(F, second.value, input=second.input, output=second.output)
    gap = wb.Response(F, first.value, np.where(F < 0.1, np.nan, CIRCLE * 0.02), input=first.input, output=first.output)
    assert not any("no error" in note for note in wb.fit(first, also=[second, *others], order=2).notes)
    said = [note for note in wb.fit(gap, also=[bare, *others], order=2).notes if "no error" in note]
    assert len(said) == 2
    assert f"from u0 to y0 is given at {np.count_nonzero(F < 0.1)} of {len(F)} frequencies" in said[0]
    assert "from u1 to y0 is given, and other values have theirs: the accuracy of 0.3 % alone" in said[1]


def test_channels_that_make_no_matrix_are_refused() -> None:
    first, *others = curves(plant(1, 2, 2, 2))
    unnamed = wb.Response(F, first.value)
    sampled = wb.Response(F, first.value, input="u0", output="y0", input_unit="deg")
    turned = wb.Response(F, first.value, input="u0", output="y1", input_unit="rad")
    for given, also, said in (
        (first, others[:2], "from u1 to y1 is missing"),
        (first, [first], "given more than once"),
        (first, [unnamed], "does not say its input and output"),
        (sampled, [turned], "u0 is in deg and in rad"),
    ):
        with pytest.raises(InputError, match=said):
            wb.fit(given, also=also)
    with pytest.raises(InputError, match="too high"):
        wb.fit(first, also=others, order=200)
