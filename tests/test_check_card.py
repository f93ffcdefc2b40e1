"""Health cards of bundled, third-party, old, crashing and combined FMUs, and the command."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import workbench as wb
from tests.gemseo import gemseo_fmu, needs_gemseo
from tests.hostile_fmus import build_hostile, lose_patience_at_once
from tests.lin_fmus import built
from tests.lying_fmus import build_lying
from tests.mimic_fmus import build_mimic
from tests.platforms import needs_module, posix_signals
from tests.reference_fmus import build_reference
from workbench.cli.app import run
from workbench.fmi.rules import structured_name
from workbench.health.check.registry import CHECKS
from workbench.health.check.result import VERDICTS
from workbench.jobs.options import Workers

ROOT = Path(__file__).parent.parent
BUNDLED = sorted(p.stem for p in (ROOT / "fmus" / "fmi2").glob("*.fmu"))
HERE = Workers(in_process=True)
NO_MEMORY = ["memory", "largest-step"]  # take longest, and are the same code in each bundled FMU


def concerns(card: wb.HealthCard) -> list[str]:
    return [str(c) for c in card.concerns]


# -- no false alarms -------------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["", "@3"])
@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_fmus_are_green(name: str, version: str) -> None:
    card = wb.check(f"fmu:{name}{version}", skip=NO_MEMORY, workers=HERE)
    assert concerns(card) == []
    assert card.interfaces == ("me", "cs")


def test_a_hundred_sessions_of_the_aircraft_leave_nothing_behind() -> None:
    card = wb.check("fmu:Aircraft", only=["memory"])
    assert [c.verdict for c in card.checks] == ["good", "good"]
    assert all(c.numbers["sessions"][-1] == 100 for c in card.checks)


LORENZ = """model Lorenz
  input Real u(start = 0);
  output Real y;
  Real a(start = 1, fixed = true, nominal = 10);
  Real b(start = 1, fixed = true, nominal = 10);
  Real c(start = 20, fixed = true, nominal = 10);
equation
  der(a) = 10 * (b - a) + u;
  der(b) = a * (28 - c) - b;
  der(c) = a * b - 8 / 3 * c;
  y = a;
end Lorenz;
"""
STIFF = """model Stiff
  input Real u(start = 0);
  output Real y;
  Real a(start = 2, fixed = true, nominal = 1);
  Real b(start = 0, fixed = true, nominal = 1);
equation
  der(a) = b;
  der(b) = 1000 * (1 - a * a) * b - a + u;
  y = a;
end Stiff;
"""
BALL = """model Ball
  input Real u(start = 0);
  output Real y;
  output Integer bounces(start = 0, fixed = true);
  Real h(start = 1, fixed = true, nominal = 1);
  Real v(start = 0, fixed = true, nominal = 1);
equation
  der(h) = v;
  der(v) = -9.81 + u;
  when h < 0 and v < 0 then
    reinit(v, -0.7 * v);
    bounces = pre(bounces) + 1;
  end when;
  y = h;
end Ball;
"""
SAMPLED = """model Sampled
  input Real u(start = 0);
  output Real y;
  Real x(start = 0, fixed = true, nominal = 1);
  discrete Real c(start = 0, fixed = true, nominal = 1);
equation
  when sample(0, 0.01) then
    c = pre(c) + 0.05 * (u - x);
  end when;
  der(x) = 5 * (c - x);
  y = x;
end Sampled;
"""
UNSTABLE = """model Unstable
  input Real u(start = 0);
  output Real y;
  Real x(start = 0, fixed = true, nominal = 1);
equation
  der(x) = 50 * x + u;
  y = x;
end Unstable;
"""


@pytest.mark.parametrize(
    ("name", "source", "own_movement"),
    [
        ("Lorenz", LORENZ, True),
        ("Stiff", STIFF, True),
        ("Ball", BALL, True),
        ("Sampled", SAMPLED, False),
        ("Unstable", UNSTABLE, False),
    ],
)
def test_difficult_models_are_not_blamed(name: str, source: str, own_movement: bool) -> None:
    card = wb.check(built(source, name), skip=NO_MEMORY, workers=HERE)
    allowed = {"drift"} if own_movement else set()
    assert {c.name for c in card.concerns} == allowed, concerns(card)
    assert card.passed


def test_a_model_with_an_integer_output_has_exact_derivatives() -> None:
    with wb.load(built(BALL, "Ball"), "me") as model:
        found = wb.lin(model, method="exact", outputs=["y", "bounces"]).result
    assert found.C.tolist() == [[1.0, 0.0], [0.0, 0.0]]


# -- third-party FMUs ------------------------------------------------------------------------------


@needs_gemseo
def test_mass_damper_is_first_order_and_diverges_at_its_natural_step() -> None:
    card = wb.check(gemseo_fmu("Mass_Damper"))
    step = card.line("step", "cs")
    assert step.verdict == "broken"
    assert step.evidence.startswith("first order (1.0")
    assert "diverging at its natural step 0.002 s" in step.evidence
    assert step.numbers["order"] == pytest.approx(1.0, abs=0.05)
    assert "use interface me" in step.consequence
    assert not card.passed
    assert {c.name for c in card.checks if c.interface == "me" and c.verdict in ("watch", "broken")} == set()
    # This tool's first step begins at 0, wherever the run begins; and it integrates with the input of the step's begin.
    assert card.line("start-time", "cs").verdict == "broken"
    assert card.line("inputs", "cs").verdict == "watch"
    assert card.line("validation", "file").numbers["problems"]
    # Divergence is told once: the other checks take shorter steps.
    assert card.line("drift", "cs").verdict == "good"


@needs_gemseo
@pytest.mark.parametrize("name", ["MassSpringSystem", "MassSpringSubSystem1", "MassSpringSubSystem2"])
def test_openmodelica_cosimulation_is_first_order(name: str) -> None:
    card = wb.check(gemseo_fmu(name), skip=NO_MEMORY, workers=HERE)
    assert card.line("step", "cs").numbers["order"] == pytest.approx(1.0, abs=0.05)
    assert card.line("step", "cs").verdict == "watch"
    assert card.line("snapshots", "me").consequence.startswith("replay is used instead")
    assert card.passed


@needs_gemseo
def test_other_third_party_fmus() -> None:
    assert wb.check(gemseo_fmu("add"), skip=NO_MEMORY, workers=HERE).worst == "good"
    ramp = wb.check(
        gemseo_fmu("ramp"), skip=NO_MEMORY, workers=HERE
    )  # a source: it depends on time, and says so by what it does
    assert {(c.name, c.verdict) for c in ramp.concerns} == {("drift", "watch"), ("start-time", "watch")}
    counter = wb.check(gemseo_fmu("FMU3Model"), skip=NO_MEMORY)  # its output counts the steps
    assert counter.line("step", "cs").evidence.startswith("no convergence")


def test_fmi_1_fmus_get_a_card(tmp_path: Path) -> None:
    needs_module("rumoca", "build")
    from tests.fmi1_fmus import build_fmi1

    cards = {i: wb.check(build_fmi1(tmp_path, "FirstOrderLag", i), skip=NO_MEMORY, workers=HERE) for i in ("me", "cs")}
    assert {i: c.worst for i, c in cards.items()} == {"me": "good", "cs": "good"}
    assert cards["me"].line("reset", "me").verdict == "not applicable"
    assert cards["cs"].line("reset", "cs").verdict == "good"
    assert cards["cs"].fmi_version == "1.0"


# -- FMUs that take their process with them ----------------------------------------------------------


@posix_signals
def test_a_crash_is_a_line_and_the_other_checks_go_on(tmp_path: Path) -> None:
    card = wb.check(build_hostile(tmp_path, "abort"), interface="me", only=["runs", "determinism", "snapshots"])
    assert "the FMU aborted its process (SIGABRT)" in card.line("runs", "me").evidence
    assert "`in_process`" in card.line("runs", "me").consequence
    assert [c.verdict for c in card.checks] == ["broken", "good", "good"]  # on a tenth of the run: it aborts later


def test_a_hang_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lose_patience_at_once(tmp_path, monkeypatch)
    limits = Workers(timeout=200.0, jobs=1)
    card = wb.check(build_hostile(tmp_path, "hang"), interface="cs", only=["runs", "reset"], workers=limits)
    assert card.line("runs", "cs").evidence.startswith("time limit: not finished after 200 s")
    assert "`timeout`" in card.line("runs", "cs").consequence
    # A later check may only be slow; but nobody knows, so that the card is not passed.
    other = wb.check(build_hostile(tmp_path, "hang"), interface="cs", only=["determinism"], workers=limits)
    assert (other.worst, other.passed, other.checks[0].finished) == ("watch", False, False)
    assert "leave determinism out (`skip`)" in other.checks[0].consequence


@posix_signals
def test_an_fmu_that_dies_at_once_is_given_up(tmp_path: Path) -> None:
    card = wb.check(build_hostile(tmp_path, "segfault-at-start"), interface="me", skip=["validation"])
    verdicts = [c.verdict for c in card.checks]
    assert verdicts[:3] == ["broken"] * 3
    assert set(verdicts[3:]) == {"not applicable"}
    assert card.line("instances", "me").evidence == "stopped after 3 crashes or hangs"
    assert card.line("processes", "me").evidence == "another check lost the process that it ran in"


def test_a_failing_run_leaves_the_other_checks_a_shorter_one(tmp_path: Path) -> None:
    card = wb.check(build_hostile(tmp_path, "error"), only=["runs", "determinism", "reset"], workers=HERE)
    assert "the pump ran dry" in card.line("runs", "me").evidence
    assert card.line("determinism", "cs").verdict == "good"


# -- systems ---------------------------------------------------------------------------------------


def test_each_fmu_of_a_system_gets_its_lines(tmp_path: Path) -> None:
    build_lying(tmp_path, "wrong-derivative")
    text = '[components]\nlag = "fmu:FirstOrderLag"\nliar = "wrong-derivative.fmu"\ngain = {gain = 2.0}\n'
    (tmp_path / "loop.toml").write_text(text + '[connections]\n"gain.u" = "lag.y"\n"liar.u" = "gain.y"\n')
    only = ["runs", "directional"]
    card = wb.check(tmp_path / "loop.toml", only=only, start_values={"lag.tau": 0.5}, workers=HERE)
    assert {c.component for c in card.checks} == {"lag", "liar"}
    assert card.line("directional", "me", component="lag").verdict == "good"
    assert card.line("directional", "me", component="liar").verdict == "broken"
    assert card.model == "loop.toml"
    assert str(card.concerns[0]).startswith("directional (liar, me): broken: ∂der(v)/∂x")


def test_an_ssp_stays_unpacked_while_it_is_checked(tmp_path: Path) -> None:
    wb.write_ssp(wb.read_system(ROOT / "systems" / "failed_aileron.toml"), tmp_path / "failed.ssp")
    seen: list[tuple[float, str]] = []
    card = wb.check(
        tmp_path / "failed.ssp",
        only=["runs"],
        workers=HERE,
        progress=lambda text, done, total: seen.append((done / total, text)),
    )
    assert [str(c.component) for c in card.checks] == ["aircraft", "aircraft", "damper", "damper"]
    assert card.worst == "good"
    assert seen == [
        (0.25, "aircraft me runs"),
        (0.5, "aircraft cs runs"),
        (0.75, "damper me runs"),
        (1.0, "damper cs runs"),
    ]


# -- names -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "x", "a.b.c", "a[1].b[2,3]", "der(x)", "der(a.b[1],2)", "'odd name (1)'.x", "der(der(x))", "1a", "a..b", "a[x]",
        "der(x", "a b", "'x", "_D_outputAlias_v1", "x.'der(y)'", "der()", "a[]", "", "ä",
    ],
)  # fmt: skip
def test_structured_names_are_those_of_fmpys_grammar(name: str) -> None:
    from fmpy.model_description import ModelDescription, ModelVariable
    from fmpy.validation import _validate_variable_names

    raw: Callable[..., Any] = ModelDescription
    described = raw(variableNamingConvention="structured")
    described.modelVariables = [ModelVariable(name=name, valueReference=0)]
    assert structured_name(name) == (not _validate_variable_names(described))


def test_unknown_checks_are_refused_with_near_names() -> None:
    with pytest.raises(wb.InputError, match="'determinsm' is not a check; did you mean determinism"):
        wb.check("fmu:FirstOrderLag", only=["determinsm"])
    with pytest.raises(wb.InputError, match="no check is left"):
        wb.check("fmu:FirstOrderLag", only=["runs"], skip=["runs"])
    with pytest.raises(wb.InputError, match="has no check 'memory' of me; "):
        wb.check("fmu:FirstOrderLag", only=["runs"], workers=HERE).line("memory", "me")


# -- the command -----------------------------------------------------------------------------------


def test_the_command_writes_every_kind_of_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = {
        k: tmp_path / f"card.{s}" for k, s in {"json": "json", "csv": "csv", "plot": "png", "report": "html"}.items()
    }
    options = [x for k, v in files.items() for x in (f"--{k}", str(v))]
    only = ["--only", "validation,runs,step", "--only", "memory"]
    assert run(["check", str(build_lying(tmp_path, "diverging")), *only, *options]) == 1
    assert "diverging at its own step 0.01 s" in " ".join(capsys.readouterr().out.split())
    data = json.loads(files["json"].read_text(encoding="utf-8"))
    assert (data["command"], data["verdict"], data["passed"]) == ("check", "broken", False)
    wanted = {"component", "interface", "name", "verdict", "evidence", "consequence", "numbers", "seconds", "finished"}
    assert all(set(line) == wanted for line in data["checks"])
    assert [c["name"] for c in data["checks"]] == ["validation", "runs", "memory", "runs", "step", "memory"]
    assert {c["verdict"] for c in data["checks"]} <= set(VERDICTS)
    rows = list(csv.DictReader(files["csv"].read_text(encoding="utf-8").splitlines()))
    assert [r["verdict"] for r in rows] == [c["verdict"] for c in data["checks"]]
    assert files["plot"].stat().st_size > 10_000
    page = files["report"].read_text(encoding="utf-8")
    assert page.index("diverging at its own step") < page.index("Model exchange")  # what is broken comes first
    assert data["sha256"] in page


def test_the_command_ends_with_0_where_no_promise_is_broken(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run(["check", "fmu:FirstOrderLag", "--only", "runs", "--interface", "cs", "--in-process", "--json", "-"]) == 0
    )
    (line,) = json.loads(capsys.readouterr().out)["checks"]
    assert (line["interface"], line["name"], line["verdict"]) == ("cs", "runs", "good")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["check", "nosuch.fmu"], "nosuch.fmu"),
        (["check", "fmu:Ruder"], "did you mean"),
        (["check", "fmu:Rudder", "--only", "stpe"], "'stpe' is not a check; did you mean step?"),
        (["check", "fmu:Rudder", "--skip", "drfit"], "did you mean drift?"),
        (["check", "fmu:Rudder", "--timeout", "0"], "--timeout: 0 is not a positive number"),
        (["check", "fmu:Rudder", "--set", "nosuch=1"], "the model has no variable 'nosuch'"),
        (["check", "fmu:Rudder", "--step", "-1"], "step: -1 is not a positive number"),
        (["check", "fmu:Rudder", "--report", "card.txt"], "--report"),
        (["check", "fmu:Rudder", "--bias", "delC=x"], "'x' is not a number"),
    ],
)
def test_wrong_input_is_one_line(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert words in error


def test_the_help_names_every_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "--help"]) == 0
    text = re.sub(r"-\s+", "-", capsys.readouterr().out)  # a line may end at a hyphen
    assert all(name in text for name in CHECKS)
    assert "workbench check" in text


# -- what other commands say when they meet it -------------------------------------------------------


def test_lin_and_trim_say_what_they_met(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    restore, derivative = (str(build_lying(tmp_path, n)) for n in ("wrong-restore", "wrong-derivative"))
    said = "snapshots fall back to replay, which is slower: the FMU claims to save its state, but the values after"
    for arguments in (["trim", restore], ["lin", restore, "--interface", "cs", "--method", "response"]):
        assert run(arguments) == 0
        assert said in capsys.readouterr().err
    assert run(["lin", derivative]) == 0
    out, err = capsys.readouterr()
    assert "the FMU's directional derivative is -44, a difference gives -40" in " ".join(out.split())
    assert "directional derivatives disagree with differences in 1 entries; use method difference" in err
    assert run(["trim", derivative]) == 0
    assert "differences are used" in capsys.readouterr().err


def test_an_output_that_is_a_state_need_not_name_itself(tmp_path: Path) -> None:
    """As in the Modelica Association's Reference FMUs: no dependency, and a directional derivative of 0."""
    file = build_mimic(tmp_path, "state-output")
    card = wb.check(file, only=["dependencies", "directional"], workers=HERE)
    assert {line.name: line.verdict for line in card.checks if line.interface == "me"} == {
        "dependencies": "good",
        "directional": "good",
    }
    with wb.load(file, "me") as model:
        found = wb.lin(model, method="exact").result
    assert dict(zip(found.output_names, found.C.tolist(), strict=True)) == {"x": [1.0, 0.0], "y": [1.0, 0.0]}
    assert not found.doubts


def test_an_fmu_that_ends_its_run_breaks_no_promise(tmp_path: Path) -> None:
    card = wb.check(build_reference(tmp_path, "stair", 3), only=["runs", "snapshots", "determinism"], workers=HERE)
    for interface in ("me", "cs"):
        line = card.line("runs", interface)
        assert (line.verdict, line.evidence) == ("watch", "the FMU ended its run (at t = 9 s)")
    assert card.passed


def test_what_held_inputs_cost_is_said_beside_what_is_done_here() -> None:
    """FMI 3 interpolates nothing: inputs have the value of the middle of a step, and no message says they are late."""
    (line,) = wb.check("fmu:Rudder@3", interface="cs", only=["inputs"], workers=HERE).checks
    assert line.consequence.startswith("here they have the value of the middle of a step; inputs held from the start")
