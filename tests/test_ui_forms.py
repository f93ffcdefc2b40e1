"""Forms come from requests: every option has its field, and what is filled in is what a command line gives."""

from __future__ import annotations

import subprocess
from pathlib import Path
from shutil import which

import pytest

from workbench.commands import request_of
from workbench.requests.request import asked_options, command_line_of
from workbench.ui.curves import with_unit
from workbench.ui.forms import MEASURED, FormError, form_of, in_the_form, request_of_form
from workbench.ui.root import ServedFolder

ROOT = Path(__file__).resolve().parents[1]
ELSEWHERE = {"in_process", "scheduler", "tls"}


@pytest.mark.parametrize("command", MEASURED)
def test_each_option_has_a_field_with_help(command: str) -> None:
    form = form_of(command)
    shown = {field["name"]: field for field in form["fields"]}
    options = {n: d for n, (d, _) in asked_options(request_of(command)).items()}
    assert set(options) - set(shown) <= ELSEWHERE
    for name, field in shown.items():
        assert field["help"].endswith(".")
        assert field["unit"] == options[name].option.unit
        assert field["kind"] in {"switch", "number", "whole", "choice", "text", "list"}


def test_what_is_filled_in_is_what_a_command_line_gives(tmp_path: Path) -> None:
    given = {
        "input": "delC", "output": "del", "band": "0.5:20", "amplitudes": "1,4", "max_periods": "30", "carry": True,
        "method": "settle", "start_values": ["pS=1e7", "rho=900"], "tolerance": "1e-9", "ratio": "",
    }  # fmt: skip
    asked, loading = request_of_form("nfr", given, ServedFolder(tmp_path))
    assert command_line_of(asked, "x.fmu", loading) == (
        "workbench nfr x.fmu --input=delC --output=del --amplitude=1,4 --band=0.5:20 --max-periods=30 --method=settle "
        "--carry --tolerance=1e-09 --set=pS=1e+07 --set=rho=900"
    )


def test_what_is_wrong_is_said_at_its_field(tmp_path: Path) -> None:
    with pytest.raises(FormError) as told:
        request_of_form(
            "nfr",
            {"input": "u", "output": "y", "amplitudes": "1", "band": "1:2", "max_periods": "2.5"},
            ServedFolder(tmp_path),
        )
    assert told.value.fields == {"max_periods": "'2.5' is not a whole number"}
    with pytest.raises(FormError) as told:
        request_of_form("nfr", {"input": "u", "output": "y"}, ServedFolder(tmp_path))
    assert set(told.value.fields) == {"amplitudes", "frequencies"}


def wrong(command: str, **given: str) -> dict[str, str]:
    with pytest.raises(FormError) as told:
        request_of_form(command, given, ServedFolder(Path()))
    return told.value.fields


@pytest.mark.parametrize("command", ["nfr", "branches"])
def test_all_that_is_wrong_is_said_at_once_in_the_words_of_the_form(command: str) -> None:
    fields = wrong(command, input="u", output="y", amplitudes="-1", band="0.4:0.1")
    assert set(fields) == {"amplitudes", "band"}
    assert fields["amplitudes"].startswith("-1 is not a positive number")
    assert not any("--" in message for message in fields.values())


def test_a_loop_needs_its_opening() -> None:
    assert {f["name"]: f["required"] for f in form_of("loop")["fields"]}["open"]
    assert wrong("loop") == {"open": "is needed"}


def test_a_message_without_a_field_names_fields_too() -> None:
    fields = wrong("lin", amplitude="1")
    assert fields == {
        "amplitude": "Amplitude belongs to the measurement that Compare makes; add Compare, or leave it out"
    }


def test_the_only_option_that_a_message_names_is_its_field() -> None:
    excite = request_of("excite")
    assert in_the_form(excite, "Rudder: has no period; give the sampling interval, `dt`")[0] == "dt"
    assert in_the_form(excite, "Rudder: has no period; give --step")[0] == "dt"
    assert in_the_form(excite, "give `prbs` or `multisine`")[0] == ""
    assert in_the_form(request_of("branches"), "interface: Rudder runs as co-simulation")[0] == "interface"


def test_the_unit_1_is_not_shown() -> None:
    assert [with_unit(0.02, unit) for unit in ("1", "", None, "deg")] == ["0.02", "0.02", "0.02", "0.02 deg"]


@pytest.mark.skipif(which("node") is None, reason="node is not installed; it runs the browser's numbers")
def test_the_modules_that_touch_no_page() -> None:
    files = sorted(map(str, (ROOT / "tests" / "js").glob("*.test.mjs")))
    done = subprocess.run(["node", "--test", *files], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
