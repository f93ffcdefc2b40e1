"""Recorded data: what is accepted, what is refused in one line, and that nothing is lost in a file."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from workbench.data.experiment.experiment import Experiment, make_experiment, read_experiment
from workbench.data.experiment.formats import read_table
from workbench.errors import InputError


def sample(n: int = 10) -> Experiment:
    k = np.arange(n, dtype=float)
    return make_experiment(
        0.022,
        np.column_stack([k, k**2]),
        np.sin(k),
        input_names=["stick", "flap"],
        output_names=["elevator"],
        input_units=["1", None],
        output_units=["deg"],
        name="law",
    )


def write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def test_sizes_and_names() -> None:
    data = sample()
    assert (data.n_samples, data.n_inputs, data.n_outputs, data.dt) == (10, 2, 1, 0.022)
    assert data.units == {"stick": "1", "flap": None, "elevator": "deg"}
    assert json.loads(json.dumps(data.to_dict()))["u"]["flap"][3] == 9.0


def test_vectors_become_columns_with_names_and_the_callers_arrays_are_left_alone() -> None:
    u, y = np.arange(4.0), np.ones((4, 2))
    data = make_experiment([0.0, 0.1, 0.2, 0.3], u, y)
    assert (data.u.shape, data.input_names, data.output_names) == ((4, 1), ("u",), ("y1", "y2"))
    data.u[0] = 7.0
    assert u[0] == 0.0


def test_part_keeps_its_times() -> None:
    part = sample().part(3, 6)
    np.testing.assert_allclose(part.time, [0.066, 0.088, 0.11])
    assert part.u[:, 0].tolist() == [3.0, 4.0, 5.0]
    assert sample().part(8).n_samples == 2


def test_select_in_the_order_asked_for_and_outputs_as_inputs() -> None:
    data = sample().select(["elevator", "stick"], ["flap"])
    assert (data.input_names, data.input_units, data.output_units) == (("elevator", "stick"), ("deg", "1"), (None,))
    np.testing.assert_array_equal(data.u[:, 0], np.sin(np.arange(10)))
    np.testing.assert_array_equal(data.y[:, 0], np.arange(10.0) ** 2)


def test_with_data_keeps_names_and_adds_a_note() -> None:
    data = sample().with_data(y=2.0 * sample().y, note="doubled")
    assert data.notes == ("doubled",)
    assert data.output_units == ("deg",)
    np.testing.assert_array_equal(data.y, 2.0 * sample().y)
    np.testing.assert_array_equal(data.u, sample().u)


def test_a_file_gives_back_every_bit(tmp_path: Path) -> None:
    data = sample()
    data.to_csv(tmp_path / "law.csv")
    back = read_experiment(tmp_path / "law.csv", outputs=["elevator"])
    for name in ("time", "u", "y"):
        np.testing.assert_array_equal(getattr(back, name), getattr(data, name))
    assert (back.units, back.input_names, back.name, back.notes) == (data.units, data.input_names, "law.csv", ())
    stream = io.StringIO()
    data.to_csv(stream)
    assert stream.getvalue() == (tmp_path / "law.csv").read_text(encoding="utf-8")
    assert stream.getvalue().splitlines()[0] == "time [s],stick [1],flap,elevator [deg]"


@pytest.mark.parametrize(
    ("text", "encoding", "dt"),
    [
        ("time;u;y\n0;1,5;2\n0,1;2,5;3\n0,2;3,5;4\n", "utf-8", None),
        ("\ufefftime [ms]\tu\ty\n0\t1.5\t2\n100\t2.5\t3\n200\t3.5\t4\n", "utf-8", None),
        ("# time u y\n0 1.5 2\n0.1 2.5 3\n0.2 3.5 4\n", "utf-8", None),
        ("u,y\n1.5,2\n2.5,3\n3.5,4\n", "utf-8", 0.1),
        ("Zeit,u,y\ns,°,m\n0,1.5,2,\n0.1,2.5,3,\n0.2,3.5,4,\n", "latin-1", None),
        ('"T","u","y"\n\n0,1.5,2\n0.1,2.5,3\n0.2,3.5,4\n', "utf-8", None),
    ],
    ids=["semicolon and decimal comma", "tab, mark and ms", "blanks and remark", "no time", "units below", "quotes"],
)
def test_files_of_others_are_read(tmp_path: Path, text: str, encoding: str, dt: float | None) -> None:
    data = read_experiment(write(tmp_path / "x.csv", text, encoding), inputs=["u"], outputs=["y"], dt=dt)
    np.testing.assert_allclose(data.time, [0.0, 0.1, 0.2], atol=1e-12)
    assert data.u[:, 0].tolist() == [1.5, 2.5, 3.5]
    assert data.y[:, 0].tolist() == [2.0, 3.0, 4.0]


def test_units_in_a_line_of_their_own_are_told(tmp_path: Path) -> None:
    data = read_experiment(write(tmp_path / "x.csv", "t,u,y\n[s],[deg],[m]\n0,1,2\n1,2,3\n"))
    assert data.units == {"u": "deg", "y": "m"}
    assert any("second line" in note for note in data.notes)
    assert any("'u' is taken as the input" in note for note in data.notes)


@pytest.mark.parametrize("unit", ["m/s2", "N.m", "kg m^2/s⁻²", "rad/(s2)", "1", "m/s^-2*kg"])
def test_a_unit_alone_is_known(tmp_path: Path, unit: str) -> None:
    (tmp_path / "units.csv").write_text(f"time,u\ns,{unit}\n0,1\n1,2\n", encoding="utf-8")
    assert read_table(tmp_path / "units.csv").units == ("s", unit)


@pytest.mark.parametrize("unit", ["1" * 500 + "x", "m⁻²³¹" * 200 + "?", "m " * 300 + "?"])
def test_a_line_that_is_almost_of_units_is_refused_at_once(tmp_path: Path, unit: str) -> None:
    """Found by the fuzzer: a pattern of repeated repetitions tried every way to part the digits, for ever."""
    (tmp_path / "units.csv").write_text(f"time,u\ns,{unit}\n0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match="is neither a number nor a known unit"):
        read_table(tmp_path / "units.csv")


def test_units_behind_the_names_hold_whatever_stands_in_the_second_line(tmp_path: Path) -> None:
    data = read_experiment(write(tmp_path / "x.csv", "t [s],u [deg],y\n(clock),(raw),(filtered)\n0,1,2\n1,2,3\n"))
    assert data.units == {"u": "deg", "y": None}


def test_a_file_without_names_numbers_its_columns(tmp_path: Path) -> None:
    data = read_experiment(write(tmp_path / "x.txt", "1,2\n3,4\n"), dt=0.5)
    assert (data.input_names, data.output_names, data.dt) == (("column1",), ("column2",), 0.5)


def test_of_two_rows_at_an_event_the_later_one_counts(tmp_path: Path) -> None:
    text = "time,y,u\n0,0,0\n1,0,0\n1,0,5\n2,3,5\n"
    data = read_experiment(write(tmp_path / "sim.csv", text), inputs=["u"], outputs=["y"])
    assert data.u[:, 0].tolist() == [0.0, 5.0, 5.0]
    assert any("appears twice with other values (an event)" in note for note in data.notes)


def test_rounded_times_are_put_on_their_grid_with_a_note() -> None:
    time = np.round(np.arange(31) / 30.0, 4)
    data = make_experiment(time, np.zeros(31), np.zeros(31))
    assert np.ptp(np.diff(data.time)) < 1e-12
    assert "off the grid" in data.notes[0]


def test_variable_steps_are_put_on_a_grid_when_it_is_given(tmp_path: Path) -> None:
    time = np.array([0.0, 0.1, 0.25, 0.3, 0.4, 0.7, 1.0])
    rows = "\n".join(f"{t},{np.floor(t / 0.25)},{2.0 * t}" for t in time)
    file = write(tmp_path / "x.csv", "time,u,y\n" + rows)
    with pytest.raises(InputError, match="not equidistant"):
        read_experiment(file)
    data = read_experiment(file, dt=0.05)
    np.testing.assert_allclose(data.y[:, 0], 2.0 * data.time, atol=1e-12)
    assert data.u[4, 0] == 0.0
    assert data.u[5, 0] == 1.0
    assert data.u[-1, 0] == 4.0
    assert any("put on a grid of 0.05 s" in note for note in data.notes)


def bad_files(folder: Path) -> dict[str, tuple[Callable[[], object], str]]:
    def of(text: str, **options: object) -> Callable[[], object]:
        file = folder / f"{abs(hash(text))}.csv"
        return lambda: read_experiment(write(file, text), **options)  # type: ignore[arg-type]

    return {
        "missing": (lambda: read_experiment(folder / "none.csv"), "cannot be read"),
        "a picture": (of("\0\0\1PNG"), "is not text"),
        "empty": (of(""), "no row of numbers"),
        "words": (of("a,b\nc,d\n"), "no row of numbers"),
        "a word among numbers": (of("time,u,y\n0,1,2\n1,x,3\n"), "line 3, column 2: 'x' is not a number"),
        "short row": (of("time,u,y\n0,1,2\n1,2\n"), "line 3: 2 cells, but 3"),
        "gap": (of("time,u,y\n0,1,2\n1,,3\n2,4,5\n"), "input 'u' is nan at sample 1"),
        "no time": (of("u,y\n1,2\n3,4\n"), "no time column"),
        "wrong column": (of("time,stick,y\n0,1,2\n1,2,3\n", inputs=["stik"]), "did you mean stick"),
        "both": (of("time,u,y\n0,1,2\n1,2,3\n", inputs=["u"], outputs=["u"]), "named twice"),
        "which": (of("time,a,b,c\n0,1,2,3\n1,2,3,4\n"), "which columns are inputs"),
        "twice": (of("time,u,u\n0,1,2\n1,2,3\n"), "column 'u' appears twice"),
        "one sample": (of("time,u,y\n0,1,2\n"), "too few"),
        "back": (of("time,u,y\n0,1,2\n2,1,2\n1,1,2\n"), "does not rise at sample 2"),
        "unit of time": (of("time [deg],u,y\n0,1,2\n1,2,3\n"), "time is in 'deg'"),
        "dt": (of("u,y\n1,2\n2,3\n", dt=0.0), "must be positive"),
    }


@pytest.mark.parametrize("case", list(bad_files(Path())))
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    read, words = bad_files(tmp_path)[case]
    with pytest.raises(InputError) as caught:
        read()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: make_experiment(0.1, [1.0, 2.0, 3.0], [1.0, 2.0]), "u has 3 samples and y 2"),
        (lambda: make_experiment(0.1, [1.0, np.inf, 3.0], [1.0, 2.0, 3.0]), "input 'u' is inf at sample 1"),
        (lambda: make_experiment(0.1, [1.0, 2.0], [np.nan, np.nan]), "output 'y' is nan at sample 0"),
        (lambda: make_experiment([0.0, 0.1, 0.35, 0.45], np.ones(4), np.ones(4)), "0.25 s after sample 1"),
        (lambda: make_experiment([0.0, 0.1], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]), "2 times and 3 samples"),
        (lambda: make_experiment(-0.1, [1.0, 2.0], [1.0, 2.0]), "must be positive"),
        (lambda: make_experiment(0.1, [1.0, 2.0], [1.0, 2.0], input_names=["a", "b"]), "1 columns, but 2 names"),
        (lambda: make_experiment(0.1, [1.0, 2.0], [1.0, 2.0], output_names=["u"]), "'u' is given twice"),
        (lambda: make_experiment(0.1, [1.0, 2.0], [1.0, 2.0], output_units=["m", "s"]), "2 units are given"),
        (lambda: make_experiment(0.1, np.ones((2, 2, 2)), [1.0, 2.0]), "shape (samples, columns)"),
        (lambda: make_experiment(0.1, ["a", "b"], [1.0, 2.0]), "array of numbers"),
        (lambda: sample().part(5, 99), "no part 5 … 99 of 10"),
        (lambda: sample().part(5, 6), "at least two samples"),
        (lambda: sample().select(["stik"], ["elevator"]), "did you mean stick"),
        (lambda: sample().select([], ["elevator"]), "no input is named"),
        (lambda: sample().with_data(y=np.ones(3)), "the numbers must be equal"),
    ],
)
def test_bad_data_are_refused_in_one_line(make: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError) as caught:
        make()
    assert words in str(caught.value)
