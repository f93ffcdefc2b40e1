"""From Modelica files to FMUs: the public functions of the build chain."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any

import fmpy

from workbench.build.causalise import causalise
from workbench.build.describe import (
    BuiltExperiment,
    ModelDescriptionParts,
    build_description,
    model_description_2,
    model_description_3,
)
from workbench.build.emit_c import emit_equations, emit_model
from workbench.build.frontend import FlatModel, check, models_in
from workbench.build.scalar_model import ScalarModel
from workbench.build.scalarise import scalarise
from workbench.build.stiffness import is_stiff
from workbench.build.toolchain import Platform, chosen_platforms, compile_all
from workbench.core.machine.files import cache_folder, named_path, pack, replacing
from workbench.core.records.names_in_text import OUR_TOOL
from workbench.core.records.record import entry
from workbench.errors import BuildError, suggest
from workbench.jobs.job import Job
from workbench.model.loading import DEFAULT_TOLERANCE
from workbench.requests.decorator import with_origin
from workbench.show.result import Result

FMI_VERSIONS = (2, 3)
_MODEL = "model.c"  # the one C file that is the model's own


@dataclass(frozen=True)
class BuildResult(Result):
    """What was built.

    Attributes:
        model: Name of the Modelica model.
        files: The FMUs written, one for each FMI version asked for.
        platforms: FMI 3 platform tuples of the binaries inside.
        stiff: Whether Co-Simulation integrates with the implicit method.
        n_states: Number of continuous states.
    """

    _page = "workbench.build.page:build_page"

    model: str
    files: tuple[Path, ...]
    platforms: tuple[str, ...]
    stiff: bool
    n_states: int = field(metadata=entry(key="states"))

    _WHAT, _COMMAND = "a model that was built", "build"


@dataclass(frozen=True)
class BuiltModels(Result):
    """Models that were built in one call.

    Attributes:
        models: one of each.
    """

    _page = "workbench.build.page:built_page"

    models: tuple[BuildResult, ...]

    _WHAT, _COMMAND = "a result of build", "build"

    @property
    def files(self) -> tuple[Path, ...]:
        """The FMUs written."""
        return tuple(file for model in self.models for file in model.files)

    @property
    def platforms(self) -> tuple[str, ...]:
        """FMI 3 platform tuples of the binaries inside."""
        return self.models[0].platforms

    def derived(self) -> Mapping[str, Any]:
        names = ", ".join(model.model for model in self.models)
        return {"model": names, "interface": None, "solver": None, "files": self.files, "platforms": self.platforms}


@dataclass(frozen=True, slots=True)
class Sources:
    """The generated model: C files by name, model descriptions by FMI version."""

    name: str
    identifier: str
    c_files: Mapping[str, bytes]
    descriptions: Mapping[int, bytes]
    build_description: bytes
    stiff: bool
    n_states: int
    compiled: tuple[str, ...] = field(default=())


@with_origin()
def build_fmu(
    sources: Sequence[Path],
    *,
    model: str | None = None,
    out: Path,
    fmi: int = 2,
    platforms: Sequence[str] | None = None,
    stiff: bool | None = None,
    job: Job | None = None,
) -> BuildResult:
    """Build one model into one FMU that serves Model Exchange and Co-Simulation.

    Args:
        sources: Modelica files, or folders that hold them.
        model: Name of the model; needed only where the sources hold several.
        out: The FMU to write.
        fmi: FMI version, 2 or 3.
        platforms: FMI 3 platform tuples to build for; default: all five.
        stiff: Integrator of Co-Simulation: implicit where True, explicit where False; default: chosen from the
            eigenvalues at the start values.
        job: Is told what takes long.

    Raises:
        BuildError: A file is missing, the model is outside the supported subset, or the compiler failed.
    """
    result = _find(sources)
    name = _choose(result, model)
    return _build(result[name], name, {fmi: out}, platforms, stiff=stiff, job=job or Job())


def build_all(
    sources: Sequence[Path],
    *,
    out: Path,
    fmi: Sequence[int] = FMI_VERSIONS,
    platforms: Sequence[str] | None = None,
    stiff: bool | None = None,
    job: Job | None = None,
) -> list[BuildResult]:
    """Build every model in `sources` into ``out/fmi2/NAME.fmu`` and ``out/fmi3/NAME.fmu``.

    Args:
        sources: Modelica files or folders.
        out: Folder for the FMUs.
        fmi: FMI versions to build.
        platforms: FMI 3 platform tuples to build for; default: all five.
        stiff: As for :func:`build_fmu`.
        job: Is told which models are built, and what takes long.

    Raises:
        BuildError: As :func:`build_fmu`.
    """
    results = list[BuildResult]()
    result, job = sorted(_find(sources).items()), job or Job()
    for name, file in result:
        targets = {version: out / f"fmi{version}" / f"{name.replace('.', '_')}.fmu" for version in fmi}
        results.append(_build(file, name, targets, platforms, stiff=stiff, job=job))
        job.partial = lambda: BuiltModels(tuple(results))
        job.done(name, len(results), len(result))
    return results


def generate(file: Path, model: str, *, stiff: bool | None = None) -> Sources:
    """Generate all C and XML of one model without compiling it.

    Raises:
        BuildError: The model is outside the supported subset.
    """
    checked = check(file, model)
    scalar = scalarise(checked.dae, checked.name, checked.description)
    return assemble(scalar, _experiment(checked), stiff=stiff)


def assemble(
    scalar: ScalarModel,
    experiment: BuiltExperiment,
    *,
    stiff: bool | None = None,
    origin: str = "its Modelica source",
    naming: str = "structured",
) -> Sources:
    """Generate all C and XML of a model without arrays.

    Args:
        scalar: The model; its name becomes the model identifier, dots as underscores.
        experiment: FMI's default experiment; its tolerance is Co-Simulation's where the environment gives none.
        stiff: Integrator of Co-Simulation: implicit where True, explicit where False; default: chosen from the
            eigenvalues at the start values.
        origin: What the model was generated from, for a comment in the C code.
        naming: FMI's variable naming convention, "structured" or "flat".

    Raises:
        BuildError: The equations cannot be sorted.
    """
    order = causalise(scalar)
    implicit = is_stiff(scalar, order) if stiff is None else stiff
    equations = emit_equations(scalar, order)
    runtime = _runtime()

    def c_model(token: str) -> str:
        return emit_model(scalar, equations, token, stiff=implicit, tolerance=experiment.tolerance, origin=origin)

    # The token names the equations and the runtime, so a changed model never passes for the old one.
    digest = hashlib.sha256()
    for name in sorted(runtime):
        digest.update(name.encode() + b"\0" + runtime[name] + b"\0")
    digest.update(c_model("").encode())
    token = "{" + digest.hexdigest()[:32] + "}"
    c_files = {**runtime, _MODEL: c_model(token).encode()}
    compiled = tuple(sorted(n for n in c_files if n.endswith(".c")))
    description = ModelDescriptionParts(scalar, order, token, OUR_TOOL, experiment, compiled, naming)
    return Sources(
        name=scalar.name,
        identifier=description.identifier,
        c_files=c_files,
        descriptions={2: model_description_2(description), 3: model_description_3(description)},
        build_description=build_description(description),
        stiff=implicit,
        n_states=len(scalar.states),
        compiled=compiled,
    )


def _experiment(checked: FlatModel) -> BuiltExperiment:
    return BuiltExperiment(checked.stop_time, checked.tolerance or DEFAULT_TOLERANCE, checked.interval)


def _runtime() -> dict[str, bytes]:
    """Return the C runtime and the standard's headers."""
    folder = package_files("workbench.build").joinpath("runtime")
    result = {f.name: f.read_bytes() for f in folder.iterdir() if f.name.endswith((".c", ".h"))}
    headers = Path(fmpy.__file__).parent / "c-code"
    for header in sorted(headers.glob("fmi[23]*.h")):
        result[header.name] = header.read_bytes()
    return result


def _find(sources: Sequence[Path]) -> dict[str, Path]:
    """Return {model: file} of all models in `sources`."""
    result: dict[str, Path] = {}
    for source in sources:
        if not named_path(source).exists():
            raise BuildError(f"{source}: no such file or folder; give a Modelica file (.mo) or a folder of them")
        for file in sorted(source.rglob("*.mo")) if source.is_dir() else [source]:
            for name in models_in(file):
                result[name] = file
    if not result:
        raise BuildError(f"{', '.join(map(str, sources))}: no model found; a source needs a `model` or `block`")
    return result


def _choose(result: Mapping[str, Path], model: str | None) -> str:
    if model is None:
        if len(result) > 1:
            raise BuildError(f"several models: {', '.join(sorted(result))}; choose one (`model`)")
        return next(iter(result))
    matches = [name for name in result if name == model or name.endswith("." + model)]
    if len(matches) != 1:
        raise BuildError(f"no model {model} in the sources; {suggest(model, result)}")
    return matches[0]


def _build(
    file: Path,
    model: str,
    targets: Mapping[int, Path],
    platforms: Sequence[str] | None,
    *,
    stiff: bool | None,
    job: Job,
) -> BuildResult:
    _check_versions(targets)
    chosen = chosen_platforms(platforms, usual="all")
    return compile_and_pack(generate(file, model, stiff=stiff), targets, chosen, job)


def _check_versions(targets: Mapping[int, Path]) -> None:
    for version in targets:
        if version not in FMI_VERSIONS:
            raise BuildError(f"FMI {version} cannot be built; choose 2 or 3")


def compile_and_pack(
    generated: Sources, targets: Mapping[int, Path], platforms: Sequence[Platform], job: Job | None = None
) -> BuildResult:
    """Compile generated sources and write the FMUs.

    Args:
        generated: What :func:`generate` or :func:`assemble` returned.
        targets: FMI version → FMU to write.
        platforms: What to compile for.
        job: Is told what takes long.

    Raises:
        BuildError: The compiler failed.
    """
    runtime = _kept({name: data for name, data in generated.c_files.items() if name != _MODEL})
    with tempfile.TemporaryDirectory(prefix="workbench-build-") as temporary:
        model = Path(temporary) / _MODEL
        model.write_bytes(generated.c_files[_MODEL])
        sources = [str(model) if name == _MODEL else name for name in generated.compiled]
        libraries = compile_all(
            runtime, sources, platforms, Path(temporary) / "lib", generated.identifier, say=(job or Job()).say
        )
        binaries = {name: library.read_bytes() for name, library in libraries.items()}
    for version, target in targets.items():
        pack(target, _contents(generated, version, platforms, binaries))
    names = tuple(p.name for p in platforms)
    return BuildResult(generated.name, tuple(targets.values()), names, generated.stiff, generated.n_states)


def _kept(files: Mapping[str, bytes]) -> Path:
    """Return a folder with these files, always the same one: the compiler knows by its path what it has compiled."""
    digest = hashlib.sha256()
    for name, contents in sorted(files.items()):
        digest.update(name.encode() + b"\0" + contents + b"\0")
    folder = cache_folder("runtime") / digest.hexdigest()[:32]
    folder.mkdir(parents=True, exist_ok=True)
    for name, contents in files.items():
        file = folder / name
        if not file.exists() or file.read_bytes() != contents:
            with replacing(file) as part:
                part.write_bytes(contents)
    return folder


def _contents(
    generated: Sources, version: int, platforms: Sequence[Platform], binaries: Mapping[str, bytes]
) -> dict[str, bytes]:
    contents = {"modelDescription.xml": generated.descriptions[version]}
    contents |= {f"sources/{name}": data for name, data in generated.c_files.items()}
    if version == 3:
        contents["sources/buildDescription.xml"] = generated.build_description
    for platform in platforms:
        folder = platform.name if version == 3 else platform.name_2
        contents[f"binaries/{folder}/{generated.identifier}{platform.suffix}"] = binaries[platform.name]
    return contents
