"""FMUs that break one promise each, built for this machine: one library (tests/c/lying), many archives around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import expm

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
    "euler": Lie(
        "step", "watch", _CS, r"error .* % of the range of .* at its own step 0\.01 s.* first order \((1\.0|0\.9)"
    ),
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
    "other-start": Lie("starts", "watch", evidence="u: the description says start 0.5, the FMU has 0 until it is set"),
    "zero-nominal": Lie("nominals", "broken", _ME, "nominal value of x is 0"),
    "tiny-nominal": Lie("nominals", "watch", _ME, "x reaches .*, its nominal value is 1e-09"),
    "leak": Lie("memory", "watch", evidence="6[0-9].* kB per session"),
    "large-leak": Lie("memory", "broken", evidence="kB per session"),
    "wrong-reference": Lie("references", "broken", _CS, r"response: [xvy] is .* % of its range off at t = .* s"),
    "misspelt": Lie("validation", "broken", ("file",), "attribute 'causality': .*outputt"),
    "nameless": Lie("validation", "watch", ("file",), "'der.*' is not a structured name"),
}

# What is wrong in the description alone: the library is told to be honest.
_DESCRIBED = ("undeclared", "nameless", "misspelt", "wrong-reference", "other-start")


def description(name: str) -> str:
    """Return the model description of a lie, or of "honest" or "unstable"."""
    guid = "honest" if name in _DESCRIBED else name
    known = "1 2 5" if name == "undeclared" else "1 2 5 6"
    role = "outputt" if name == "misspelt" else "output"
    kinds = " ".join(["dependent"] * len(known.split()))
    odd = "der(der(y))" if name == "nameless" else "f"
    flags = 'modelIdentifier="lying" canGetAndSetFMUstate="true" providesDirectionalDerivative="true"'
    start = 0.5 if name == "other-start" else 0
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
    <ScalarVariable name="u" valueReference="4" causality="input"><Real start="{start}" /></ScalarVariable>
    <ScalarVariable name="w" valueReference="5" causality="input"><Real start="0" /></ScalarVariable>
    <ScalarVariable name="y" valueReference="6" causality="{role}"><Real /></ScalarVariable>
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


def _carried(name: str) -> dict[str, bytes]:
    """Return the reference results that the honest FMU carries: its response to a constant force, in closed form."""
    if name not in ("honest", "wrong-reference"):
        return {}
    gain, times = 1.02 if name == "wrong-reference" else 1.0, np.arange(201) / 100.0
    turn = expm(np.array([[0.0, 1.0], [-40.0, -0.8]]) / 100.0)
    rows = [np.array([-0.5 / 40.0, 0.0])]  # from where it comes to rest
    for _ in times[1:]:
        rows.append(turn @ rows[-1])
    motion = [
        (t, gain * (float(x) + 0.5 / 40.0), gain * float(v)) for t, (x, v) in zip(times.tolist(), rows, strict=True)
    ]
    return reference_files(
        {"y.csv": "time,x,v,y\n" + "".join(f"{t!r},{x!r},{v!r},{x!r}\n" for t, x, v in motion)},
        'name="response" stopTime="2" stepSize="0.01"',
        u="time,u\n0,0.5\n",
    )


def reference_files(tables: Mapping[str, str], experiment: str, *, u: str = "") -> dict[str, bytes]:
    """Return the files of a folder of FMI-LS-REF with one experiment.

    Args:
        tables: file → text; the first has the results.
        experiment: attributes of the experiment.
        u: text of the stimuli; empty: none.
    """
    stimuli = '<Stimuli source="u.csv" />' if u else ""
    text = f'<Experiment {experiment}>{stimuli}<References source="{next(iter(tables))}" /></Experiment>'
    files = {
        "fmi-ls-manifest.xml": '<fmiReferences><Related type="application/x-ma-hs-experiments" source="runs.exp"'
        ' role="experiment/smoke-test" /></fmiReferences>',
        "runs.exp": f'<Experiments name="runs">{text}</Experiments>',
        **tables,
        **({"u.csv": u} if u else {}),
    }
    return {f"extra/org.fmi-standard.fmi-ls-ref/{name}": text.encode() for name, text in files.items()}


def build_lying(folder: Path, name: str, more: Mapping[str, bytes] = {}) -> Path:
    """Write ``folder/NAME.fmu`` for a name in LIES, or "honest", "unstable", with more files."""
    return write_stub(folder / f"{name}.fmu", "lying", description(name), more={**_carried(name), **more})
