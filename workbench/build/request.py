"""What becomes an FMU: what can be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from workbench.core.records.forms import File, Names
from workbench.core.records.option import option
from workbench.requests.request import Request, Subject, function

if TYPE_CHECKING:
    from workbench.build.compile_fmu import CompiledFmu  # noqa: F401
    from workbench.build.container import ContainerResult  # noqa: F401
    from workbench.build.export import ExportResult  # noqa: F401 - the records' types, below
    from workbench.build.fmu import BuiltModels  # noqa: F401
    from workbench.build.result import SystemFile  # noqa: F401

__all__ = ["Build", "Compile", "Export", "compile_fmu", "export"]


def _holds(folder: Path, name: str) -> bool:
    try:
        return (folder / name).is_file()
    except OSError:  # a name that no file can have, of which whoever opens it tells
        return False


class Build(Request[Sequence[str | Path], "BuiltModels"]):
    """Turn a Modelica model into an FMU for five platforms (model exchange and co-simulation), or a folder of them.

    Raises:
        InputError: a folder that does not exist, or is given where one model is.
        BuildError: a file is missing, the model is outside the supported subset, or the compiler failed.
    """

    command = "build"
    written = "workbench.build.written:BuildFiles"
    algorithm = "workbench.build.run:run_build"
    example = "workbench build Rudder.mo --out Rudder.fmu --fmi 3"
    subject = Subject(
        name="sources",
        type="Sequence[str | Path]",
        help="Modelica files, or folders of them.",
        metavar="MODEL.mo..",
        words="Modelica files, or folders of them.",
        several=True,
    )
    counts = "models"
    unwritten = ("csv", "mat", "plot")

    out: File = option(
        "FMU to write, or a folder: then every model is built into FOLDER/fmi2/ and FOLDER/fmi3/.",
        metavar="X.fmu|FOLDER",
    )
    _: KW_ONLY
    model: str | None = option("Model to build, if the sources contain several.", metavar="NAME", default=None)
    fmi: int | None = option("FMI version; 2 for one FMU, both for a folder.", metavar="2|3", default=None)
    platforms: Names | None = option(
        "Platforms to build for, as FMI 3.0 or 2.0 names them: x86_64-linux or linux64; host for this machine's alone; "
        "by default all five.",
        flag="--platform",
        metavar="host|all|NAME,..",
        default=None,
    )
    stiff: bool | None = option(
        "Integrator of co-simulation: implicit where True, explicit where False; by default chosen from the "
        "eigenvalues at the start values.",
        default=None,
        python=True,
    )
    reference_results: bool = option(
        "Run what was built and pack the results into it (FMI-LS-REF), for whoever gets it to compare with. The last "
        "digits then depend on this machine, so that the same source no longer gives the same bytes.",
        default=False,
    )


class Compile(Request[str | Path, "CompiledFmu"]):
    """Compile the sources that an FMU brings, for a machine that it has no binary for.

    FMI 1.0, 2.0 and 3.0; the compiler comes with the extra `build`, also for Windows and macOS. What is compiled is
    what the FMU lists (buildDescription.xml, SourceFiles), else every C file in its folder sources; the standard's
    headers are there. Function names get the prefix that FMI wants: the model identifier in FMI 1.0, none from 2.0 on.
    Not for sources that need a library, or headers of an operating system, that do not come with them.

    Returns:
        What was compiled, and the FMU written: all that the old one has, and the binaries.

    Raises:
        InputError: no such file, an unknown platform, binaries that are there already and no `out`.
        FmuError: it is not an FMU.
        BuildError: it has no sources, or the compiler refuses them; the message has its first error.

    Examples:
        >>> compiled = wb.compile_fmu("fmu:FirstOrderLag", out="lag.fmu", platforms=["linux64"])
        >>> print(compiled.binaries)
        ('binaries/linux64/FirstOrderLag.so',)
    """

    command = "build"
    case = "an FMU with sources"
    written = "workbench.build.written:ExportFiles"
    called = "compile_fmu"
    algorithm = "workbench.build.run:run_compile"
    example = "workbench build fmu:FirstOrderLag --out FirstOrderLag_here.fmu"
    subject = Subject(
        name="path",
        type="str | Path",
        help="An `.fmu` file with sources.",
        metavar="X.fmu",
        argument="fmu",
        words="An FMU with sources.",
    )
    counts = "platforms"
    unwritten = ("csv", "mat", "plot")

    _: KW_ONLY
    out: File | None = option(
        "FMU to write; by default the binaries are added to X.fmu.", metavar="Y.fmu", default=None
    )
    platforms: Names | None = option(
        "Platforms to compile for, as FMI 3.0 or 2.0 names them: x86_64-linux or linux64; all for all five; by default "
        "host, this machine's.",
        flag="--platform",
        metavar="host|all|NAME,..",
        default=None,
    )

    @classmethod
    def takes(cls, given: Sequence[str]) -> bool:
        """Return whether an FMU is given.

        Args:
            given: as the command line names it.
        """
        path = Path(given[0])
        return path.suffix.lower() == ".fmu" or given[0].startswith("fmu:") or _holds(path, "modelDescription.xml")


compile_fmu = function(Compile)


class Export(Request[object, "ExportResult | ContainerResult | SystemFile"]):
    """Turn a linear model into an FMU for five platforms, or a system of FMUs into one container FMU.

    A model with static blocks (`identify --structure`) becomes a system, as .toml or .ssp.

    A continuous model (dt = 0) is der(x) = dx0 + A x + B (u − u0), y = y0 + C x + D (u − u0). A discrete one is sampled
    at multiples of dt; its outputs are held in between, and y[k] holds the effect of u[k]. The inputs start at u0 and
    the state, a deviation, at x0; so the FMU stands where the model was found. Matrix entries are numbers in the code,
    not parameters: to vary them, export again. It serves model exchange and co-simulation.

    A parameter-varying model (`lin --over NAME=LO:HI`) has its scheduling parameters as further inputs, held within
    their ranges, and starts in the middle of them; its states are those of the model, not deviations.

    A system becomes a container for co-simulation, see `export_container`: every connection carries a delay of one
    step, which the system itself does not have.

    A model with static blocks becomes a system of its own sampled linear part between tables, which go on beyond their
    knots along their last lines: see `StructureResult.to_system`. FMUs of linear models have no place for tables.

    Raises:
        InputError: no linear model, a wrong FMI version or name, a folder that does not exist; a container cannot
            express the system; a model with static blocks, and `out` is not a .toml or .ssp.
        BuildError: the compiler is missing or failed.

    Examples:
        >>> import control
        >>> linear = control.ss([[-2.0]], [[1.0]], [[1.0]], [[0.0]])
        >>> exported = wb.export(linear, "linear.fmu", platforms=["x86_64-linux"])
        >>> print(exported.n_states, exported.n_inputs, exported.n_outputs)
        1 1 1
    """

    command = "build"
    called = "export"
    case = "a linear model or a system"
    written = "workbench.build.written:ExportFiles"
    algorithm = "workbench.build.run:run_export"
    example = "workbench build identified.json --out identified.fmu --fmi 3"
    details = (
        "The container is for co-simulation: it steps the FMUs inside by --step and passes values on in between, so "
        "that every connection carries a delay of one step, which the system itself does not have. Blocks, gains, "
        "conversions of units and connections that close later cannot be expressed; the message names the reason.\n\n"
        "A model with static blocks (identify --structure … --json) becomes a system: --out X.toml or X.ssp. "
        'Compilers: pip install "fmi-workbench[build]".'
    )
    subject = Subject(
        name="model",
        type="object",
        help="A JSON file that `workbench identify` or `workbench lin` wrote; a model as "
        "`workbench.build.matrices.matrices_of` takes it: a mapping, a result of `lin`, an identified model, a "
        "python-control StateSpace; an identified model with static blocks, or its JSON; or a system: a model, a "
        "description, or a file.",
        metavar="MODEL",
        words="Linear model, or one with static blocks: the JSON of workbench identify or lin. Or a system: .toml, "
        ".ssp, system:NAME.",
    )
    unwritten = ("csv", "mat", "plot")

    out: File = option("FMU to write; of a model with static blocks a system, .toml or .ssp.", metavar="X.fmu")
    _: KW_ONLY
    fmi: int = option("FMI version, 2 or 3.", metavar="2|3", default=2)
    name: str | None = option(
        "Name of the model in the FMU, a C identifier for linear models; by default made from the file name.",
        metavar="NAME",
        default=None,
    )
    step: float | None = option(
        "Communication step of a system's container, by which every connection between its parts is late.",
        unit="s",
        metavar="S",
        default=None,
    )
    platforms: Names | None = option(
        "Platforms to build a linear model for, as FMI 3.0 or 2.0 names them: x86_64-linux or linux64; host for this "
        "machine's alone; by default all five.",
        flag="--platform",
        metavar="host|all|NAME,..",
        default=None,
    )
    stiff: bool | None = option(
        "Integrator of a linear model's co-simulation: implicit where True, explicit where False; by default chosen "
        "from the eigenvalues of A.",
        default=None,
        python=True,
    )
    reference_results: bool = option(
        "Run what was built and pack the results into it (FMI-LS-REF), for whoever gets it to compare with. The last "
        "digits then depend on this machine, so that the same source no longer gives the same bytes.",
        default=False,
    )

    @classmethod
    def takes(cls, given: Sequence[str]) -> bool:
        """Return whether a linear model or a system is given.

        Args:
            given: as the command line names it.
        """
        path = Path(given[0])
        models = (".json", ".toml", ".ssp", ".ssd")
        return path.suffix.lower() in models or given[0].startswith("system:") or _holds(path, "SystemStructure.ssd")


export = function(Export)
