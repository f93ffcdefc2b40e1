"""What is outside the Modelica subset is refused before any C is written: file, line, construct, remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from workbench.build.fmu import build_fmu, generate
from workbench.build.frontend import models_in
from workbench.errors import BuildError, InputError

REFUSED = {
    "varying delay": (
        "Real y;\nequation\n  y = delay(time, 0.1 + 0.1*time, 1.0);",
        4,
        "whose time varies",
        "parameter",
    ),
    "delayed loop": ("Real y;\nequation\n  y = 1 - 0.5*delay(y, 1.0);", 4, "delay() of y", "delay a state"),
    "initial equation": (
        "Real x;\ninitial equation\n  x = 2;\nequation\n  der(x) = -x;",
        4,
        "initial equation",
        "fixed = true",
    ),
    "nonlinear unknown": ("Real y;\nequation\n  y^3 + y = time;", 4, "not affine in y", "by hand"),
    "algebraic loop": ("Real a;\nReal b;\nequation\n  a = 2*b + time;\n  b = 3*a;", 5, "algebraic loop", "by hand"),
    "parameter as period": (
        "parameter Real T = 0.1; discrete Real d;\n\nequation\n  when sample(0, T) then\n    d = time;\n  end when;",
        5,
        "parameter T as a sample period",
        "final parameter",
    ),
    "when of an element": (
        (
            "Real h[3](each start = 1, each fixed = true);\ndiscrete Real x[3](each start = 0, each fixed = true);\n"
            "equation\n  for i in 1:3 loop\n    der(h[i]) = -h[i];\n"
            "    when h[i] < 0.5 then\n      x[i] = time;\n    end when;\n  end for;"
        ),
        8,
        "a when clause assigns x[1], one element of an array",
        "assign the whole array",
    ),
    "reinit of an element": (
        (
            "Real x[3](each start = 1, each fixed = true);\nequation\n  for i in 1:3 loop\n    der(x[i]) = -1;\n"
            "    when x[i] < 0 then\n      reinit(x[i], 1);\n    end when;\n  end for;"
        ),
        7,
        "reinit of x[1], one element of an array",
        "put the when clause into a model",
    ),
    "when in an algorithm": (
        (
            "discrete Real x(start = 0, fixed = true);\nalgorithm\n  when sample(0, 0.1) then\n    x := pre(x) + 1;\n"
            "  end when;"
        ),
        4,
        "a when clause in an algorithm section",
        "in the equation section",
    ),
    "String": ('parameter String s = "a";\nReal y;\nequation\n  y = time;', 2, "String", "Integer"),
    "unresolved parameter": (
        "parameter Real p(fixed = false);\nReal y;\nequation\n  y = p*time;",
        2,
        "fixed = false",
        "value",
    ),
}


def write(folder: Path, body: str) -> Path:
    file = folder / "M.mo"
    file.write_text(f"model M\n{body}\nend M;\n")
    return file


@pytest.mark.parametrize("case", REFUSED)
def test_refusal_names_file_line_construct_and_remedy(tmp_path: Path, case: str) -> None:
    body, line, construct, remedy = REFUSED[case]
    with pytest.raises(BuildError) as caught:
        generate(write(tmp_path, body), "M")
    message = str(caught.value)
    assert message.startswith(f"M.mo:{line}:"), message
    assert construct in message
    assert remedy in message


def test_syntax_error_names_the_line(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=r"M\.mo:\d+"):
        generate(write(tmp_path, "Real x\nequation\n  x = 1;"), "M")


def test_what_is_advised_is_accepted(tmp_path: Path) -> None:
    whole = (
        "discrete Real x[3](each start = 0, each fixed = true);\nequation\n"
        "  when sample(0, 1) then\n    x = pre(x) + {1, 2, 3};\n  end when;"
    )
    assert generate(write(tmp_path, whole), "M").n_states == 0
    cell = (
        "model Cell\n  Real h(start = 1, fixed = true);\nequation\n  der(h) = -1;\n  when h < 0 then\n"
        "    reinit(h, 1);\n  end when;\nend Cell;\nCell cell[3];"
    )
    assert generate(write(tmp_path, cell), "M").n_states == 3


def test_a_fault_of_the_front_end_is_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    body = (
        "parameter Integer n = 3;\ndiscrete Real x[n](each start = 0, each fixed = true);\nequation\n"
        "  when sample(0, 0.1) then\n    x = {pre(x[i]) + i for i in 1:n};\n  end when;"
    )
    with pytest.raises(BuildError, match=r"M\.mo: the Modelica front end fails on this model.*write out the array"):
        generate(write(tmp_path, body), "M")
    assert not capfd.readouterr().err


def test_words_of_the_front_end_are_quoted_as_such(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=r"M\.mo: the Modelica front end refuses this: “unsupported model algorithm"):
        generate(
            write(tmp_path, "Real y;\nalgorithm\n  y := 0;\n  for i in 1:3 loop\n    y := y + i;\n  end for;"), "M"
        )


def test_unknown_name_is_the_front_ends_message(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="y"):
        generate(write(tmp_path, "Real x(start = 0, fixed = true);\nequation\n  der(x) = y;"), "M")


def test_nothing_is_written_when_a_model_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, "Real y;\nequation\n  y = delay(time, 0.0);")
    with pytest.raises(BuildError):
        build_fmu([file], out=tmp_path / "M.fmu")
    assert [p.name for p in tmp_path.iterdir()] == ["M.mo"]


def test_models_are_found_in_packages_and_not_in_comments(tmp_path: Path) -> None:
    file = tmp_path / "P.mo"
    file.write_text(
        "package P // model Hidden\n"
        "  function f input Real x; output Real y; algorithm y := x; end f;\n"
        "  partial model Base Real x; end Base;\n"
        '  model A "model B in a text" Real y; equation y = time; end A;\n'
        "  /* model C end C; */\n"
        "  block D Real y; equation y = time; end D;\n"
        "end P;\n"
    )
    assert models_in(file) == ["P.A", "P.D"]


def test_a_package_folder_is_read_as_a_whole(tmp_path: Path) -> None:
    folder = tmp_path / "Pk"
    folder.mkdir()
    (folder / "package.mo").write_text("package Pk\n  constant Real two = 2;\nend Pk;\n")
    (folder / "A.mo").write_text(
        "within Pk;\nmodel A\n  Real x(start = 1, fixed = true);\n  B b(u = x);\n  output Real y;\n"
        "equation\n  der(x) = -two*x;\n  y = b.y;\nend A;\n"
    )
    (folder / "B.mo").write_text(
        "within Pk;\nblock B\n  input Real u;\n  output Real y;\nequation\n  y = 3*u;\nend B;\n"
    )
    assert models_in(folder / "A.mo") == ["Pk.A"]
    generated = generate(folder / "A.mo", "Pk.A")
    assert generated.identifier == "Pk_A"
    assert generated.n_states == 1
    assert b"-(2.0 * " in generated.c_files["model.c"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"model": "Nothing"}, "no model Nothing"),
        ({"fmi": 1}, "FMI 1 cannot be built"),
        ({"platforms": ["amiga"]}, "no platform 'amiga'"),
    ],
)
def test_bad_arguments(tmp_path: Path, arguments: dict[str, object], message: str) -> None:
    file = write(tmp_path, "Real y;\nequation\n  y = time;")
    with pytest.raises((BuildError, InputError), match=message):
        build_fmu([file], out=tmp_path / "M.fmu", **arguments)  # type: ignore[arg-type]


def test_missing_source(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="no such file"):
        build_fmu([tmp_path / "none.mo"], out=tmp_path / "M.fmu")
