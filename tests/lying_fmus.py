"""FMUs that break one promise each, built for this machine: one library (tests/c/lying), many archives around it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tests.stub_fmus import write_stub


@dataclass(frozen=True)
class Lie:
    """What an FMU does, and what the health card must make of it.

    Attributes:
        check: the check that finds it.
        verdict: of that check.
        interfaces: where.
        evidence: what the line must contain (a regular expression).
        others: (interface, check) → verdict of lines that it changes, too.
    """

    check: str
    verdict: str
    interfaces: tuple[str, ...] = ("me", "cs")
    evidence: str = ""
    others: tuple[tuple[str, str, str], ...] = ()


_ME, _CS = ("me",), ("cs",)
_UNREPEATED = (("me", "processes", "broken"), ("cs", "processes", "broken"))

LIES = {
    "forgetful": Lie(
        "snapshots", "broken", evidence="claimed, but (after a second restore . is|the same run after a restore)"
    ),
    "wrong-restore": Lie("snapshots", "broken", evidence="the values after a restore are not those that were saved"),
    "half-restore": Lie("snapshots", "broken", evidence="the values after a restore are not those that were saved"),
    "failing-restore": Lie("snapshots", "broken", evidence="claimed, but it fails: .*fmi2SetFMUstate returned error"),
    "repeats": Lie("promise", "broken", _CS, r"noSetFMUStatePriorToCurrentPoint is false\) . is"),
    "wrong-derivative": Lie("directional", "broken", _ME, r"∂der\(v\)/∂x is -44 by the FMU, -40 by differences"),
    "no-derivative": Lie("directional", "broken", _ME, "fmi2GetDirectionalDerivative returned error"),
    "undeclared": Lie("dependencies", "broken", _ME, r"der\(v\) depends on w, which it does not declare"),
    "clock": Lie("start-time", "watch", evidence="s later . is"),
    "random": Lie("determinism", "broken", evidence="in a second run . is", others=_UNREPEATED),
    "coarse": Lie("determinism", "broken", evidence="in a second run . is", others=_UNREPEATED),
    "pid": Lie("processes", "broken", evidence="in a second process . is"),
    "unset": Lie("processes", "broken", evidence="in a second process . is"),
    "first": Lie("processes", "broken", evidence="in the second instance of a process . is"),
    "shared": Lie("instances", "broken", evidence="beside a second instance . is"),
    "single": Lie("instances", "broken", evidence="two instances at once fail: .*cannot be instantiated"),
    "sticky-reset": Lie("reset", "broken", evidence="after a reset . is"),
    "refused-reset": Lie("reset", "watch", evidence="fmi2Reset returns status 3"),
    "euler": Lie("step", "watch", _CS, r"first order \((1\.0|0\.9).*error .* % at its own step 0\.01 s"),
    "diverging": Lie("step", "broken", _CS, r"first order .*diverging at its own step 0\.01 s"),
    "counter": Lie("step", "watch", _CS, "no convergence"),
    "deaf": Lie("inputs", "broken", _ME, "u, w: declared continuous, but it acts only at events"),
    "refused-slopes": Lie(
        "inputs", "broken", _CS, "canInterpolateInputs is claimed, but input derivatives are rejected"
    ),
    "ignored-slopes": Lie("inputs", "watch", _CS, "have no effect"),
    "wrong-slopes": Lie("inputs", "broken", _CS, "input derivatives make the result worse"),
    "late-inputs": Lie(
        "jumps", "watch", _CS, r"the response of f .* differs by 9\d.* % .* up to 3 steps \(0\.03 s\) later"
    ),
    "own-clock": Lie("start-time", "broken", _CS, r"the FMU ignores the start time .* s and begins at 0"),
    "zero-nominal": Lie("nominals", "broken", _ME, "nominal value of x is 0"),
    "tiny-nominal": Lie("nominals", "watch", _ME, "x reaches .*, its nominal value is 1e-09"),
    "leak": Lie("memory", "watch", evidence="6[0-9].* kB per session"),
    "large-leak": Lie("memory", "broken", evidence="kB per session"),
    "nameless": Lie("validation", "watch", ("file",), "'der.*' is not a structured name"),
}

# What is wrong in the description alone: the library is told to be honest.
_DESCRIBED = ("undeclared", "nameless")


def description(name: str) -> str:
    """Return the model description of a lie, or of "honest" or "unstable"."""
    guid = "honest" if name in _DESCRIBED else name
    known = "1 2 5" if name == "undeclared" else "1 2 5 6"
    kinds = " ".join(["dependent"] * len(known.split()))
    odd = "der(der(y))" if name == "nameless" else "f"
    flags = 'modelIdentifier="lying" canGetAndSetFMUstate="true" providesDirectionalDerivative="true"'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Lying" guid="{{lying-{guid}}}" numberOfEventIndicators="0"
    variableNamingConvention="structured">
  <ModelExchange {flags} />
  <CoSimulation {flags} canHandleVariableCommunicationStepSize="true" canInterpolateInputs="true" />
  <DefaultExperiment startTime="0" stopTime="2" stepSize="0.01" />
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" causality="local" initial="exact"><Real start="0" nominal="0.01" />
    </ScalarVariable>
    <ScalarVariable name="v" valueReference="1" causality="local" initial="exact"><Real start="0" nominal="0.1" />
    </ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="2" causality="local"><Real derivative="1" /></ScalarVariable>
    <ScalarVariable name="der(v)" valueReference="3" causality="local"><Real derivative="2" /></ScalarVariable>
    <ScalarVariable name="u" valueReference="4" causality="input"><Real start="0" /></ScalarVariable>
    <ScalarVariable name="w" valueReference="5" causality="input"><Real start="0" /></ScalarVariable>
    <ScalarVariable name="y" valueReference="6" causality="output"><Real /></ScalarVariable>
    <ScalarVariable name="{odd}" valueReference="7" causality="output"><Real /></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs>
      <Unknown index="7" dependencies="1" dependenciesKind="dependent" />
      <Unknown index="8" dependencies="2 5" dependenciesKind="dependent dependent" />
    </Outputs>
    <Derivatives>
      <Unknown index="3" dependencies="2" dependenciesKind="dependent" />
      <Unknown index="4" dependencies="{known}" dependenciesKind="{kinds}" />
    </Derivatives>
    <InitialUnknowns><Unknown index="3" /><Unknown index="4" /><Unknown index="7" /><Unknown index="8" />
    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def build_lying(folder: Path, name: str) -> Path:
    """Write ``folder/NAME.fmu`` for a name in LIES, or "honest", "unstable"."""
    return write_stub(folder / f"{name}.fmu", "lying", description(name))
