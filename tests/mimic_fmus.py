"""FMUs of FMI 2.0 that behave as known exporters' do: one library (tests/c/mimics), many descriptions around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.stub_fmus import stub_fmu
from workbench.core.machine.files import pack

__all__ = ["MIMICS", "Mimic", "build_mimic"]

_BOTH = ("ModelExchange", "CoSimulation")


@dataclass(frozen=True)
class Mimic:
    """An FMU of this kind.

    Attributes:
        mimics: whose behaviour, in words.
        way: of tests/c/mimics.
        interfaces: that it offers.
        flags: attributes of each interface.
        experiment: attributes of its default experiment; "": it has none.
        outputs: whether its model structure lists them.
        change: of the whole description, last.
        encoding: of the description.
    """

    mimics: str
    way: str = "plain"
    interfaces: tuple[str, ...] = _BOTH
    flags: str = ""
    experiment: str = 'startTime="0" stopTime="2" stepSize="0.02"'
    outputs: bool = True
    change: Callable[[str], str] = field(default=str)
    encoding: str = "UTF-8"


def _scaled(text: str) -> str:
    """Give the states nominal values, and y the size of x."""
    text = text.replace('<Real start="0" /><!--x-->', '<Real start="0" nominal="1e-9" />')
    return text.replace('<Real start="0" /><!--v-->', '<Real start="0" nominal="1e9" />')


def _aliases(text: str) -> str:
    """Give y, and the time, second names at the same value references, and odd letters to one of them."""
    more = "".join(
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="local"><Real /></ScalarVariable>'
        for name, reference in (
            ("$whenCondition.y", 6),
            ("'y of [bar] (1)'", 6),
            ("_D_time", 0),
            ("body.frame_a.R[1]", 2),
        )
    )
    return text.replace("</ModelVariables>", f"{more}</ModelVariables>")


def _state_is_output(text: str) -> str:
    """Let x itself be an output, which depends on no other variable."""
    text = text.replace('name="x" valueReference="2"', 'name="x" valueReference="2" causality="output"')
    return text.replace("<Outputs>", '<Outputs><Unknown index="2" dependencies="" />')


def _latin(text: str) -> str:
    return text.replace('description=""', 'description="Prüfstand für Ventile, 20 °C"').replace("N.m", "°C")


def _two_names(text: str) -> str:
    return text.replace('<CoSimulation modelIdentifier="mimics"', '<CoSimulation modelIdentifier="mimics_cs"')


def _two_outputs(text: str) -> str:
    text = text.replace('name="v" valueReference="3"', 'name="v" valueReference="3" causality="output"')
    return text.replace("<Outputs>", '<Outputs><Unknown index="3" />')


_CS = ("CoSimulation",)
MIMICS = {
    "orderly": Mimic("an FMU that keeps to FMI's state machine and refuses what it does not allow"),
    "dymola": Mimic("Dymola: no time outside continuous-time mode; a multistep solver not restarted", "dymola"),
    "simulink": Mimic(
        "Simulink: a fixed step of its own, outputs of the last one", "simulink", _CS,
        'canHandleVariableCommunicationStepSize="false"', 'startTime="0" stopTime="2" stepSize="0.01"',
    ),
    "unlike": Mimic("states of unlike scale, with nominal values", "unlike", change=_scaled),
    "silent": Mimic("states of unlike scale whose nominal values say nothing", "silent"),
    "needs-tool": Mimic("AMESim and others: the simulator must be there", "tool", flags='needsExecutionTool="true"'),
    "warns": Mimic("SimulationX and others: every call returns a warning", "warns"),
    "no-nominals": Mimic("older exporters: fmi2GetNominalsOfContinuousStates is not there for good", "nominals"),
    "formats": Mimic("JModelica: log messages with formats and references, categories of their own", "formats"),
    "memory": Mimic("CATIA and others: memory from the callbacks, and back to them", "memory"),
    "fast-math": Mimic("compiled with -ffast-math: tiny numbers become zero in the whole process", "fast"),
    "handles": Mimic("a run-time system that sets handlers of signals", "handles"),
    "discards": Mimic("a model that discards trial points of an integrator", "discards", ("ModelExchange",)),
    "forgets": Mimic("20-sim: parameters are reset by fmi2SetupExperiment", "forgets"),
    "undeclared": Mimic("exporters that list no outputs in ModelStructure", outputs=False),
    "no-experiment": Mimic("exporters without a default experiment", experiment=""),
    "latin": Mimic("MapleSim: the description in ISO-8859-1", change=_latin, encoding="ISO-8859-1"),
    "aliases": Mimic("Dymola, OpenModelica: second names of a value, generated names", change=_aliases),
    "two-names": Mimic("exporters with a library for each interface", change=_two_names),
    "state-output": Mimic(
        "Reference FMUs: a state that is an output, without dependencies and with derivatives of equations alone",
        flags='providesDirectionalDerivative="true"', change=_state_is_output,
    ),
    "keyless": Mimic("OpenModelica: shows a thread-specific key, 0, that it has not taken; 0 is Python's"),
    "undefined": Mimic("20-sim: an output stops being a number, the others go on", "undefined", change=_two_outputs),
    "once": Mimic("JModelica: one instance in a process", flags='canBeInstantiatedOnlyOncePerProcess="true"'),
    "statics": Mimic(
        "20-sim, Overture: one instance in a process, and a second one ends it", "statics",
        flags='canBeInstantiatedOnlyOncePerProcess="true"',
    ),
    "resources": Mimic("JModelica: refuses to start without its folder of resources, which is empty", "resources"),
    "overshoots": Mimic(
        "20-sim: a fixed step of its own, and always whole ones, up to the communication point or past it",
        "overshoots", _CS, experiment='startTime="0" stopTime="5" stepSize="0.01"',
    ),
    "insists": Mimic(
        "FMUs that take no communication step but that of their default experiment", "insists", _CS,
        'canHandleVariableCommunicationStepSize="false"', 'startTime="0" stopTime="2.005" stepSize="0.01"',
    ),
    "slow": Mimic("Dymola: two seconds for each that is simulated", "slow", _CS),
    "finishes": Mimic("20-sim: a stop time of its own, which only another one that it is told moves", "finishes", _CS),
    "repeats": Mimic(
        "fmiCpp: a step that may be taken back is taken for one that is to be made again", "repeats", _CS
    ),
}  # fmt: skip


def _description(mimic: Mimic) -> str:
    offered = "".join(
        f'<{kind} modelIdentifier="mimics" {mimic.flags} '
        + ('canHandleVariableCommunicationStepSize="true" ' if kind in _CS and "canHandle" not in mimic.flags else "")
        + "/>"
        for kind in mimic.interfaces
    )
    experiment = f"<DefaultExperiment {mimic.experiment} />" if mimic.experiment else ""
    outputs = '<Outputs><Unknown index="6" /></Outputs>' if mimic.outputs else ""
    first = '<Unknown index="6" />' if mimic.outputs else ""
    states = "ModelExchange" in mimic.interfaces
    derivatives = '<Derivatives><Unknown index="4" /><Unknown index="5" /></Derivatives>' if states else ""
    initial = '<Unknown index="4" /><Unknown index="5" />' if states else ""
    # A model without Model Exchange need not show its states, and Simulink's does not.
    of_x, of_v = (' derivative="2"', ' derivative="3"') if states else ("", "")
    return f"""<?xml version="1.0" encoding="{mimic.encoding}"?>
<fmiModelDescription fmiVersion="2.0" modelName="Mimic" guid="{{mimic-{mimic.way}}}" description=""
    generationTool="Tests of the workbench" numberOfEventIndicators="0">
  {offered}
  <UnitDefinitions><Unit name="N.m"><BaseUnit kg="1" m="2" s="-2" /></Unit></UnitDefinitions>
  {experiment}
  <ModelVariables>
    <ScalarVariable name="u" valueReference="1" causality="input"><Real start="1" unit="N.m" /></ScalarVariable>
    <ScalarVariable name="x" valueReference="2" initial="exact"><Real start="0" /><!--x--></ScalarVariable>
    <ScalarVariable name="v" valueReference="3" initial="exact"><Real start="0" /><!--v--></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="4"><Real{of_x} /></ScalarVariable>
    <ScalarVariable name="der(v)" valueReference="5"><Real{of_v} /></ScalarVariable>
    <ScalarVariable name="y" valueReference="6" causality="output"><Real unit="N.m" /></ScalarVariable>
    <ScalarVariable name="c" valueReference="7" causality="parameter" variability="tunable"><Real start="100" />
    </ScalarVariable>
    <ScalarVariable name="d" valueReference="8" causality="parameter" variability="fixed"><Real start="4" />
    </ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    {outputs}
    {derivatives}
    <InitialUnknowns>{initial}{first}</InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def build_mimic(folder: Path, name: str) -> Path:
    """Write ``folder/NAME.fmu`` for a name in `MIMICS`."""
    mimic, file = MIMICS[name], folder / f"{name}.fmu"
    text = mimic.change(_description(mimic))
    binaries = stub_fmu("mimics", 2)
    if "mimics_cs" in text:
        binaries |= {path.replace("mimics.", "mimics_cs."): data for path, data in binaries.items()}
    folders = {"resources/": b""} if mimic.way == "resources" else {}
    pack(file, {"modelDescription.xml": text.encode(mimic.encoding), **folders, **binaries})
    return file
