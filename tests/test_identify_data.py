"""Data as they come: gaps, outliers, several experiments, the files of other tools."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy import signal

import workbench as wb
from tests.platforms import needs_module
from workbench.cli.app import run
from workbench.data.experiment.experiment import read_pieces
from workbench.errors import InputError

TRUE = ([0.0, 0.1, 0.05], [1.0, -1.6, 0.8])
POLES = np.sort_complex(np.roots(TRUE[1]))


def part(seed: int, samples: int = 600, *, noise: float = 0.02, offset: float = 0.0) -> wb.Experiment:
    """The resonance, started from a random state."""
    random = np.random.default_rng(seed)
    u = random.choice([-1.0, 1.0], samples + 100)
    y = signal.lfilter(*TRUE, u)[100:] + noise * random.standard_normal(samples) + offset
    return wb.make_experiment(0.1, u[100:] + offset, y, input_names=["u"], output_names=["y"], name=f"part {seed}")


@pytest.mark.parametrize("refine", ["never", "always"])
def test_several_experiments_are_fitted_together_whatever_their_starts(refine: str) -> None:
    """Free of noise (but for what the refinement needs) the joints leave no trace.

    Means are not taken off: over a short record they are not the operating point.
    """
    noise = 0.0 if refine == "never" else 1e-4
    several = [
        part(
            s,
            200,
            noise=noise,
        )
        for s in range(3)
    ]
    found = wb.identify(several[0], also=several[1:], order=2, refine=refine, detrend="none")
    assert np.sort_complex(found.model.poles) == pytest.approx(POLES, abs=1e-9 + 3.0 * noise)
    assert len(found.model.input_names) == found.model.B.shape[1] == found.model.D.shape[1] == 1
    assert any("fitted together: part 0: 200 samples" in note for note in found.notes)


def test_three_experiments_are_known_better_than_one() -> None:
    one = wb.identify(part(0), order=2, noise=0)
    three = wb.identify(part(0), also=[part(1), part(2)], order=2, noise=0)
    assert one.uncertainty is not None
    assert three.uncertainty is not None
    ratio = one.uncertainty.regions[0].spread / three.uncertainty.regions[0].spread
    assert ratio == pytest.approx(np.sqrt(3.0), rel=0.15)
    assert three.uncertainty.holds(POLES[1], POLES[1])


def in_degrees(data: wb.Experiment, unit: str | None = "deg") -> wb.Experiment:
    """The same experiment with u in degrees and y in degrees per second, under any name of the unit."""
    return wb.make_experiment(
        data.dt, np.rad2deg(data.u), np.rad2deg(data.y), input_names=["u"], output_names=["y"],
        input_units=[unit], output_units=["deg/s"], name="degrees",
    )  # fmt: skip


def in_radians(data: wb.Experiment) -> wb.Experiment:
    return wb.make_experiment(
        data.dt, data.u, data.y, input_names=["u"], output_names=["y"], input_units=["rad"], output_units=["rad/s"]
    )


def test_experiments_in_other_units_are_converted_to_those_of_the_first() -> None:
    first, second, third = in_radians(part(0)), in_radians(part(1)), in_radians(part(2))
    alike = wb.identify(first, also=[second], validation=third, order=2, noise=0)
    mixed = wb.identify(first, also=[in_degrees(second)], validation=in_degrees(third), order=2, noise=0)
    assert mixed.model.poles == pytest.approx(alike.model.poles, rel=1e-9)
    assert mixed.model.response([0.5]) == pytest.approx(alike.model.response([0.5]), rel=1e-9)
    assert mixed.fit_percent == pytest.approx(alike.fit_percent, rel=1e-9)
    assert (mixed.model.units["u"], mixed.model.units["y"]) == ("rad", "rad/s")
    assert mixed.notes.count("degrees: y is converted from deg/s to rad/s") == 1
    own = wb.validate(alike.model, in_degrees(third))
    assert own.fit_percent["y"] == pytest.approx(alike.fit_percent, rel=1e-9)
    assert own.data.units == {"u": "rad", "y": "rad/s"}


def test_experiments_that_do_not_fit_each_other_are_refused() -> None:
    first = in_radians(part(0))
    slow = wb.make_experiment(0.2, first.u, first.y, input_names=["u"], output_names=["y"])
    with pytest.raises(InputError, match="resample one"):
        wb.identify(first, also=[slow])
    for unit, why in (("m", "they do not measure the same"), ("notches", "the unit 'notches' is not known")):
        with pytest.raises(InputError, match=f"u is in '{unit}', and is needed in 'rad': {why}; convert the data"):
            wb.identify(first, also=[in_degrees(part(1), unit)])
        with pytest.raises(InputError, match=why):
            wb.identify(first, validation=in_degrees(part(1), unit))
    without = wb.identify(first, validation=part(1), order=2)
    assert any("u has no unit; it is taken to be in rad" in note for note in without.notes)


def rows_of(data: wb.Experiment) -> list[str]:
    table = np.column_stack([data.time, data.u, data.y])
    return [",".join(f"{value:.12g}" for value in row) for row in table]


def test_gaps_are_filled_or_divide_the_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = part(0, 900)
    rows = rows_of(data)
    del rows[500:520]  # a long gap of missing rows
    rows[100] = f"{data.time[100]:.12g},{data.u[100, 0]:.12g},"  # one missing output
    rows[200] = f"{data.time[200]:.12g},{data.u[200, 0]:.12g},{data.y[200, 0] + 50.0}"  # an outlier
    path = tmp_path / "data.csv"
    path.write_text("\n".join(["time [s],u,y", *rows, ""]), encoding="utf-8")
    pieces = read_pieces(path, inputs=["u"], outputs=["y"])
    assert [p.n_samples for p in pieces] == [500, 380]
    assert pieces[1].time[0] == pytest.approx(52.0)
    assert pieces[0].y[100, 0] == pytest.approx(0.5 * (data.y[99, 0] + data.y[101, 0]))
    command = ["identify", str(path), "--input", "u", "--output", "y", "--order", "2"]
    assert run(command) == 2
    assert run([*command, "--repair"]) == 0
    told = capsys.readouterr()
    assert "1 missing samples filled" in told.err
    assert "1 outlier replaced" in told.err
    found = wb.identify(path, inputs=["u"], outputs=["y"], order=2, repair=True)
    assert np.sort_complex(found.model.poles) == pytest.approx(POLES, abs=0.01)


def test_data_with_nothing_but_gaps_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    lines = [f"{0.1 * k:.1f},{k % 2},{'' if k % 15 < 8 else k}" for k in range(200)]
    path.write_text("\n".join(["time [s],u,y", *lines, ""]), encoding="utf-8")
    with pytest.raises(InputError, match="no piece of 20 samples is without long gaps"):
        wb.identify(path, inputs=["u"], outputs=["y"], repair=True)


def test_matlab_files_are_read(tmp_path: Path) -> None:
    data = part(0)
    path = tmp_path / "data.mat"
    scipy.io.savemat(
        path, {"time": data.time, "u": data.u, "log": {"y": data.y[:, 0]}, "gains": np.arange(3.0), "who": "me"}
    )
    read = wb.read_experiment(path, inputs=["u"], outputs=["y"])
    assert read.y == pytest.approx(data.y)
    assert read.dt == pytest.approx(0.1)
    assert any("gains left out" in note for note in read.notes)
    path.write_bytes(b"MATLAB 7.3 MAT-file" + bytes(105) + b"\x00\x02IM" + bytes(400))
    with pytest.raises(InputError, match=r"7\.3|cannot be read"):
        wb.read_experiment(path)


@pytest.mark.parametrize("suffix", [".parquet", ".feather"])
def test_arrow_files_are_read(suffix: str, tmp_path: Path) -> None:
    needs_module("pyarrow", "data")
    arrow = import_module("pyarrow")
    module = import_module("pyarrow.parquet" if suffix == ".parquet" else "pyarrow.feather")
    data = part(0)
    table = arrow.table({"time [s]": data.time, "u [V]": data.u[:, 0], "y": data.y[:, 0], "word": ["x"] * len(data.y)})
    write = module.write_table if suffix == ".parquet" else module.write_feather
    write(table, str(tmp_path / f"data{suffix}"))
    read = wb.read_experiment(tmp_path / f"data{suffix}", inputs=["u"], outputs=["y"])
    assert read.y == pytest.approx(data.y)
    assert read.units["u"] == "V"


def test_mdf_files_are_read(tmp_path: Path) -> None:
    needs_module("asammdf", "data")
    asammdf = import_module("asammdf")
    data = part(0)
    with asammdf.MDF() as file:
        for name, values, unit in (("u", data.u[:, 0], "V"), ("y", data.y[:, 0], "deg")):
            file.append(asammdf.Signal(samples=values, timestamps=data.time, name=name, unit=unit))
        file.save(str(tmp_path / "data.mf4"))
    read = wb.read_experiment(tmp_path / "data.mf4", inputs=["u"], outputs=["y"])
    assert read.y == pytest.approx(data.y)
    assert read.units["y"] == "deg"


@pytest.mark.parametrize(("suffix", "package"), [(".parquet", "pyarrow"), (".mf4", "asammdf")])
def test_a_package_that_is_missing_is_named(
    suffix: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [package, *(n for n in sys.modules if n.startswith(f"{package}."))]:
        monkeypatch.setitem(sys.modules, name, None)
    path = tmp_path / f"data{suffix}"
    path.write_bytes(b"PAR1")
    with pytest.raises(InputError, match=f"needs the package {package}: pip install {package}"):
        wb.read_experiment(path)
    with pytest.raises(InputError, match="no such file"):
        wb.read_experiment(tmp_path / f"none{suffix}")
