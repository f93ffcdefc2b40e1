"""The data file of targets: its schema, what a target accepts, and what words mean on the command line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from docs.tools.fitted import fitted_section, fitted_section_of
from scripts.reproduce.registry import experiments
from scripts.reproduce.select import select
from scripts.reproduce.targets import PublishedTarget, parse_targets, read_targets
from workbench.errors import InputError

TARGETS = read_targets()
WHOLE = '[a]\nchapter = "3"\nwhat = "w"\nbasis = "predicted"\n'
FITTED = 'value = 1\nabsolute = 1\nbasis = "fitted"\n'
INSTEAD = 'instead = {low = 3, high = 4, why = "w"}'


def one(lines: str) -> PublishedTarget:
    head = "\n".join(line for line in WHOLE.splitlines() if not (line.startswith("basis") and "basis =" in lines))
    return parse_targets(f"{head}\n{lines}", "file")["a"]


# -- the file ---------------------------------------------------------------------------------------


def test_every_target_has_its_place_and_is_measured_by_one_experiment() -> None:
    measured = [name for e in experiments().values() for name in e.targets]
    assert sorted(measured) == sorted(TARGETS)
    for target in TARGETS.values():
        assert re.fullmatch(r"[3-8](\.\d+)*", target.chapter), target.name
        assert all(1 <= n <= 59 for n in target.figures), target.name
        assert target.what
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", target.name)


def test_names_stand_in_the_order_of_the_chapters() -> None:
    chapters = [int(t.chapter[0]) for t in TARGETS.values()]
    assert chapters == sorted(chapters)


def test_no_target_or_tolerance_stands_in_the_code_that_measures() -> None:
    """A number that is published with four digits or more is not written down again beside the measurement."""
    folder = Path(__file__).resolve().parents[1] / "scripts" / "reproduce"
    code = "\n".join(p.read_text(encoding="utf-8") for p in folder.glob("*.py"))
    written = set(re.findall(r"(?<![\w.])\d+\.?\d*(?:e-?\d+)?", code))
    for target in TARGETS.values():
        values = [] if target.value is None else np.atleast_1d(np.asarray(target.value, dtype=float)).tolist()
        for value in values:
            text = f"{abs(value):.10g}"
            if len(text.replace(".", "").lstrip("0")) >= 4:
                assert text not in written, target.name


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("value = 1", "needs value with either absolute or relative"),
        ("value = 1\nabsolute = 1\nrelative = 1", "either absolute or relative"),
        ("value = 1\nabsolute = 1\nlow = 0", "needs value with"),
        ("absolute = 1", "needs value with"),
        ("", "needs value with"),
        ("value = 1\nabsolute = -1", "negative tolerance"),
        ("value = 1\nabsolut = 1", "key 'absolut' is unknown; did you mean absolute"),
        ("value = 'one'\nabsolute = 1", "key 'value'"),
        ("high = 1\norigin = 'guessed'", "key 'origin'"),
        ("high = 1\nfigures = 3", "key 'figures'"),
        ("high = 1\nbasis = 'guessed'", "key 'basis'"),
        ("value = [1, 2]\nabsolute = [1, 1, 1]", "as many as it has numbers"),
        ("value = 1\nabsolute = [1]", "as many as it has numbers"),
        ("value = [1, 2]\nabsolute = [1, -1]", "negative tolerance"),
        (FITTED, "needs fmu and fitted_by"),
        (FITTED + "fitted_by = 'b'", "needs fmu and fitted_by"),
        ("high = 1\nfitted_by = 'b'\nfmu = 'Rudder'", "needs fmu and fitted_by"),
        ("high = 1\nreason = 'r'", "needs instead"),
        ("high = 1\nshortfall = 's'", "needs instead"),
        ("high = 1\n" + INSTEAD, "needs instead"),
        ("high = 1\nreason = 'r'\nshortfall = 's'\n" + INSTEAD, "either a reason or a shortfall"),
        ("high = 1\nreason = 'r'\ninstead = {low = 1, high = 2}", "why"),
    ],
)
def test_a_broken_target_is_one_line(lines: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        one(lines)
    assert "\n" not in str(caught.value)
    assert "[a]" in str(caught.value)


def test_the_tolerance_of_a_printed_number_is_half_of_its_last_digit_or_says_why() -> None:
    """At most 0.51 of the last digit that stands in the file; else the note says why."""
    text = (Path(__file__).parents[1] / "scripts" / "reproduce" / "targets.toml").read_text(encoding="utf-8")
    for name, target in TARGETS.items():
        if target.origin != "printed" or target.value is None or target.note is not None:
            continue
        table = text.split(f"[{name}]\n", maxsplit=1)[1]
        written = re.findall(r"-?[\d.]+(?:e\d+)?", table.split("\nvalue = ", maxsplit=1)[1].split("\n")[0])
        low, high = target.limits
        for number, half in zip(written, np.atleast_1d((high - low) / 2.0), strict=True):
            mantissa, _, power = number.partition("e")
            last = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
            assert half <= 0.51 * last * (1 + 1e-9), (name, number, half)


def test_what_was_fitted_is_listed_in_the_readme_of_its_model() -> None:
    folder = Path(__file__).resolve().parents[1] / "modelica_src"
    fitted = {model: fitted_section(model) for model in {t.fmu for t in TARGETS.values() if t.fmu is not None}}
    for readme in folder.glob("*/README.md"):
        text = readme.read_text(encoding="utf-8")
        model = readme.parent.name
        assert fitted_section_of(text) == fitted.get(model, ""), f"{model}: run python -m docs.tools.fitted"


# -- what a target accepts ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "inside", "outside"),
    [
        ("value = 2.0\nabsolute = 0.1", [2.0, 1.9001, 2.0999], [1.89, 2.11, np.nan]),
        ("value = -2.0\nrelative = 0.1", [-2.0, -1.801, -2.199], [-1.79, -2.21, 2.0]),
        ("value = 3\nabsolute = 0", [3], [2, 4, 3.0000001]),
        ("low = 1.0", [1.0, 1e9], [0.999, np.nan]),
        ("high = 1.0", [1.0, -1e9], [1.001, np.nan]),
        ("low = 1.0\nhigh = 2.0", [1.0, 2.0, 1.5], [0.9, 2.1]),
        ("value = [1.0, 2.0]\nabsolute = 0.1", [(1.0, 2.0), (1.05, 1.95)], [(1.0, 2.2), (2.0, 1.0), (1.0, np.nan)]),
        ("value = [1, 10]\nabsolute = [0.1, 1]", [(1.1, 10.9), (0.9, 9.1)], [(1.2, 10.0), (1.0, 11.1)]),
        ("low = [0, 5]\nhigh = [5, 9]", [(4.0, 6.0)], [(6.0, 6.0), (4.0, 4.0)]),
        ("high = 1.0\nunit = 'dB'", [(0.5, 0.9)], [(0.5, 1.1)]),
    ],
)
def test_limits(lines: str, inside: Sequence[float], outside: Sequence[float]) -> None:
    target = one(lines)
    assert all(target.accepts(x) for x in inside)
    assert not any(target.accepts(x) for x in outside)


@pytest.mark.parametrize("measured", [[1.0], [1.0, 2.0, 3.0], []])
def test_as_many_numbers_as_the_target_has(measured: list[float]) -> None:
    with pytest.raises(InputError, match=f"{len(measured)} numbers measured, 2 wanted"):
        one("value = [1.0, 2.0]\nabsolute = 1").accepts(measured)


# -- selection -----------------------------------------------------------------------------------------


def names(*words: str) -> list[str]:
    return [t.name for t in select(words)]


def test_everything_without_words() -> None:
    assert names() == list(TARGETS)


@pytest.mark.parametrize("words", [("8",), ("8.",), ("chapter", "8"), ("chapter 8",)])
def test_a_chapter_with_all_below(words: tuple[str, ...]) -> None:
    assert names(*words) == [n for n, t in TARGETS.items() if t.chapter.startswith("8")]


@pytest.mark.parametrize("words", [("fig48",), ("figure 48",), ("figure", "48"), ("Fig.", "48"), ("fig48a",)])
def test_a_figure(words: tuple[str, ...]) -> None:
    assert names(*words) == [n for n, t in TARGETS.items() if 48 in t.figures]
    assert "nyquist-values" in names(*words)


def test_a_name_and_how_names_begin() -> None:
    assert names("cycle-rate") == ["cycle-rate"]  # not cycle-rate-degrees too
    assert set(names("example-2-1")) == {n for n in TARGETS if n.startswith("example-2-1-")}
    assert names("CYCLE-RATE") == ["cycle-rate"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("cycle-rat",), "'cycle-rat' is not a chapter, figure or target; did you mean cycle-rate"),
        (("rudde",), "did you mean rudder"),
        (("5",), "chapter 5: no target belongs to it; there are 3.1.3"),
        (("8.9",), "chapter 8.9"),
        (("fig27",), "figure 27: no target belongs to it; the nearest are 25, 26, 28, 29"),
        (("figure",), "'figure': the number is missing"),
        (("3", "nonsense"), "'nonsense' is not a chapter"),
    ],
)
def test_wrong_words_are_one_line(words: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        select(words)
    assert "\n" not in str(caught.value)
