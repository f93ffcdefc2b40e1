"""JSON Schema of what people write: what is bundled fits it, and what the readers refuse does not.

The validator is `jsonschema`, which knows nothing of the workbench.
"""

from __future__ import annotations

import json
import random
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match

import workbench as wb
from tests.test_request_lines import VALUES, asked_at_random
from workbench.cli.app import run
from workbench.commands import COMMANDS as EVERY
from workbench.commands import request_of
from workbench.core.records.forms import of_type
from workbench.core.records.option import asked_of
from workbench.errors import InputError
from workbench.study.commands import COMMANDS, command
from workbench.study.read import read_study
from workbench.study.requirements import KINDS
from workbench.system.files.toml_file import read_toml

ROOT = Path(__file__).parents[1]
ANALYSES = [name for requests in (EVERY[command] for command in COMMANDS) for name in requests]
FILES = [(name, path) for name in ("studies", "systems") for path in sorted((ROOT / name).glob("*.toml"))]
STUDY = """
[models]
lag = {model = "fmu:FirstOrderLag", set = {tau = 2.0}}
[analyses.response]
command = "nfr"
model = "lag"
input = "u"
output = "y"
amplitude = [1, "2"]
band = [0.1, 10.0]
max_periods = 5
[analyses.point]
command = "trim"
model = "lag"
[analyses.linear]
command = "lin"
model = "lag"
at = {from = "point"}
[[requirements]]
name = "wide"
analysis = "response"
kind = "bandwidth"
min = 0.05
"""
SYSTEM = """
[components]
law = {numerator = [2.0], denominator = [1.0, 1.0]}
limit = {block = "saturation", lower = -1.0, upper = 1.0}
error = {sum = "+-"}
[connections]
"law.u" = "error.y"
limit.u = {from = "law.y", gain = 2}
"error.u2" = "limit.y"
[inputs]
reference = "error.u1"
[outputs]
y = "limit.y"
"""


def fits(name: str, data: object) -> bool:
    return bool(Draft202012Validator(wb.schema(name)).is_valid(data))


def table_of(name: str) -> dict[str, Any]:
    """The schema of a request's table: some commands have several."""
    whole = wb.schema(request_of(name).command)
    several = whole.get("anyOf", [whole])
    (found,) = several if len(several) == 1 else [several[list(EVERY[request_of(name).command]).index(name)]]
    return {**found, "$defs": whole["$defs"]}


@pytest.mark.parametrize("name", ["study", "system", *COMMANDS])
def test_a_schema_is_one(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["schema", name]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == wb.schema(name)
    assert printed["$schema"] == Draft202012Validator.META_SCHEMA["$schema"]
    Draft202012Validator.check_schema(printed)


@pytest.mark.parametrize(("name", "path"), FILES, ids=lambda value: getattr(value, "stem", value))
def test_what_is_bundled_fits(name: str, path: Path) -> None:
    assert fits({"studies": "study", "systems": "system"}[name], tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("name", ANALYSES)
@pytest.mark.parametrize("seed", range(3))
def test_what_a_command_line_gives_fits_as_text(name: str, seed: int) -> None:
    """As a table of a study may have it: a text, or one for each time the option stands there; switches typed."""
    facts = command(name)
    asked, loading = asked_at_random(name, random.Random(f"{name} {seed}"))
    table: dict[str, Any] = {"command": asked.command, facts.subject: ["one"] if facts.several else "one"}
    table |= {flag: True for flag in [asked.chosen_by.lstrip("-")] if flag}
    for words in {**asked_of(loading), **asked_of(asked)}.values():
        key = words[0].partition("=")[0].removeprefix("--")
        texts = [word.partition("=")[2] for word in words]
        if "=" not in words[0]:
            table[key.removeprefix("no-") if key not in facts.options else key] = key in facts.options
        else:
            table[key] = texts if len(texts) > 1 else texts[0]
    facts.values(table)
    assert fits(asked.command, table), table


@pytest.mark.parametrize("name", ANALYSES)
def test_typed_values_fit(name: str) -> None:
    """Lists, tables and numbers, as TOML has them."""
    facts, chance = command(name), random.Random(name)
    for key, (_, declared) in facts.options.items():
        make = VALUES.get(declared.form.metavar) if declared.form is not None and not declared.choices else None
        if make is None or declared.form is of_type(declared.type) or key == "vary":
            continue  # a text alone
        if declared.form is not None and declared.form.metavar == "NAME=SIGNAL":
            continue  # a signal in Python
        value = json.loads(json.dumps(make(chance)))
        try:
            declared.checked(value)
        except InputError:  # out of its range
            continue
        whole = table_of(name)
        held = {**whole["properties"][key], "$defs": whole["$defs"]}
        assert Draft202012Validator(held).is_valid(value), (key, value)


WRONG_STUDY = [
    ('command = "nfr"', 'command = "nrf"'),
    ('input = "u"\n', ""),
    ('model = "lag"\ninput', "input"),
    ("amplitude = [1", "amplitude = [-1"),
    ("band = [0.1, 10.0]", "band = [0.1]"),
    ("band = [0.1, 10.0]", "band = true"),
    ("max_periods = 5", "max_periods = 1"),
    ("max_periods = 5", 'max_periods = "many"'),
    ("max_periods = 5", "max-period = 5"),
    ("max_periods = 5", 'method = "sttle"'),
    ("max_periods = 5", "tolerance = 2.0"),
    ("max_periods = 5", 'carry = "yes"'),
    ('at = {from = "point"}', 'at = {form = "point"}'),
    ('kind = "bandwidth"', 'kind = "band width"'),
    ("min = 0.05", "mni = 0.05"),
    ("min = 0.05", 'min = "0.05"'),
    ("set = {tau = 2.0}", "set = 2.0"),
    ("[models]", "[model]"),
]
WRONG_SYSTEM = [
    ("denominator = [1.0, 1.0]", "denominator = []"),
    ("denominator = [1.0, 1.0]", 'denominator = "1"'),
    ('block = "saturation"', 'block = "saturaton"'),
    ("upper = 1.0", "uper = 1.0"),
    ("upper = 1.0", 'upper = "high"'),
    ('{sum = "+-"}', "{sum = 1}"),
    ("gain = 2", "gian = 2"),
    ('{from = "law.y", gain = 2}', "2"),
    ('y = "limit.y"\n', "y = 2\n"),
    ("[components]", "[component]"),
]


@pytest.mark.parametrize(
    ("name", "text", "right", "wrong"),
    [*(("study", STUDY, *case) for case in WRONG_STUDY), *(("system", SYSTEM, *case) for case in WRONG_SYSTEM)],
)
def test_what_the_reader_refuses_does_not_fit(name: str, text: str, right: str, wrong: str, tmp_path: Path) -> None:
    assert fits(name, tomllib.loads(text))
    read(name, text, tmp_path)
    assert right in text
    changed = text.replace(right, wrong, 1)
    assert not fits(name, tomllib.loads(changed))
    with pytest.raises(InputError):
        read(name, changed, tmp_path)


def read(name: str, text: str, folder: Path) -> None:
    path = folder / "file.toml"
    path.write_text(text, encoding="utf-8")
    if name == "system":
        for component in read_toml(path).components:
            getattr(component, "block", None)
    else:
        for analysis in read_study(path).analyses.values():
            analysis.command.check({analysis.command.subject: "lag", **analysis.options})


def test_every_option_says_what_help_says() -> None:
    properties = wb.schema("nfr")["properties"]
    assert properties["band"]["unit"] == "Hz"
    assert properties["errcrit"]["default"] == 0.1
    assert properties["method"]["anyOf"][0]["enum"] == ["auto", "settle"]
    assert properties["max-periods"]["anyOf"][0]["minimum"] == 2
    for name in ANALYSES:
        flags = {flag for flag in [request_of(name).chosen_by.lstrip("-")] if flag}
        known = set(command(name).options) | {"command", command(name).subject} | flags
        assert table_of(name)["properties"].keys() == known


def undescribed(held: object, path: str = "") -> Iterator[str]:
    """Yield the keys that an editor shows without a word; what can have one value alone says itself what it is."""
    if isinstance(held, dict):
        for key, inner in held.get("properties", {}).items():
            if "description" not in inner and "const" not in inner:
                yield f"{path}.{key}"
        for key, inner in held.items():
            yield from undescribed(inner, f"{path}.{key}")
    elif isinstance(held, list):
        for inner in held:
            yield from undescribed(inner, path)


@pytest.mark.parametrize("name", ["study", "system", *ANALYSES])
def test_every_key_has_a_description(name: str) -> None:
    assert list(undescribed(table_of(name) if name in ANALYSES else wb.schema(name))) == []


def test_kinds_of_requirements_are_told_apart() -> None:
    kinds = wb.schema("study")["properties"]["requirements"]["items"]["anyOf"]
    assert [one["properties"]["kind"]["const"] for one in kinds[:-1]] == list(KINDS)
    assert "const" not in kinds[-1]["properties"]["kind"]


GOOD = 'analyses.a = {command = "lin", model = "m"}\n'


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ('[analyses.a]\ncommand = "lin"\nmodel = "m"\ninputz = "u"', "'inputz' "),
        ('[analyses.a]\ncommand = "linn"\nmodel = "m"', "'linn' is not one of"),
        ('[analyses.a]\nmodel = "m"', "'command' is a required property"),
        (f'{GOOD}[[requirements]]\nname = "r"\nanalysis = "a"\nkind = "gain"\nmim = 1', "'mim' was unexpected"),
    ],
)  # fmt: skip
def test_the_mistake_is_named(wrong: str, words: str) -> None:
    data = tomllib.loads(f'models.m = "fmu:FirstOrderLag"\n{wrong}')
    errors = Draft202012Validator(wb.schema("study")).iter_errors(data)
    worst = best_match(errors)
    assert worst is not None
    assert words in worst.message


def test_a_schema_of_another_name_is_none() -> None:
    with pytest.raises(InputError, match=r"there is no schema 'studdy'; did you mean study"):
        wb.schema("studdy")
