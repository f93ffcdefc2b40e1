"""A linear state-space model as an FMU."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench.build.fmu import FMI_VERSIONS, Sources, assemble, compile_and_pack
from workbench.build.matrices import StateSpaceFile, matrices_of, read_matrices
from workbench.build.parameter_varying import frozen, varying_state_space
from workbench.build.scalar_model import ScalarModel
from workbench.build.state_space import naming, state_space
from workbench.build.stiffness import is_stiff_matrix
from workbench.build.time_scale import default_experiment
from workbench.build.toolchain import chosen_platforms, require
from workbench.core.machine.files import file_to_write, replacing
from workbench.core.records.record import entry, read_json
from workbench.errors import InputError
from workbench.jobs.job import Job
from workbench.point.lin.varying_result import VaryingModel
from workbench.show.result import Result

__all__ = ["ExportResult", "check_linear_file", "export_linear", "generate_linear", "write_linear"]

_FILES = (".json", ".fmu")


@dataclass(frozen=True)
class ExportResult(Result):
    """What was exported.

    Attributes:
        model: name of the model in the FMU.
        file: the FMU.
        fmi: FMI version, 2 or 3.
        dt: sample period [s], 0 for a continuous model.
        n_states, n_inputs, n_outputs: sizes.
        platforms: FMI 3 platform tuples of the binaries inside.
        stiff: whether co-simulation integrates with the implicit method.
        renamed: name in the model → name in the FMU, for states whose name an input or output has.
        notes: what of the model is not in the FMU, one line each.
    """

    _page = "workbench.build.page:export_page"

    model: str
    file: Path
    fmi: int
    dt: float
    n_states: int = field(metadata=entry(key="states"))
    n_inputs: int = field(metadata=entry(key="inputs"))
    n_outputs: int = field(metadata=entry(key="outputs"))
    platforms: tuple[str, ...]
    stiff: bool
    renamed: Mapping[str, str]
    notes: tuple[str, ...] = ()

    _WHAT, _COMMAND = "an exported model", "build"

    def derived(self) -> Mapping[str, Any]:
        return {"interface": None, "solver": None}


def export_linear(
    model: object,
    out: str | Path,
    *,
    fmi: int = 2,
    name: str | None = None,
    platforms: Sequence[str] | None = None,
    stiff: bool | None = None,
    job: Job | None = None,
) -> ExportResult:
    """Write a linear model as an FMU that serves model exchange and co-simulation.

    Args:
        model: a JSON file, or a model as :func:`workbench.build.matrices.matrices_of` takes it.
        out: the FMU to write.
        fmi: FMI version, 2 or 3.
        name: name of the model in the FMU, a C identifier; None: made from the file's name.
        platforms: FMI 3 platform tuples to build for; None: all five.
        stiff: integrator of co-simulation: implicit where True, explicit where False; None: chosen from A.
        job: is told what takes long.

    Raises:
        InputError: no linear model, a wrong FMI version or name, an unknown platform, a folder that does not exist.
        BuildError: the compiler is missing or failed.
    """
    target = file_to_write(out, ".fmu")
    if fmi not in FMI_VERSIONS:
        raise InputError(f"FMI {fmi} cannot be written; choose 2 or 3")
    require("ziglang")
    chosen = chosen_platforms(platforms, usual="all")
    varying = _varying(model)
    if varying is not None:
        matrices = frozen(varying)
        scalar = varying_state_space(varying, matrices, _identifier(name, target))
    else:
        matrices = read_matrices(model) if isinstance(model, str | Path) else matrices_of(model)
        scalar = state_space(matrices, _identifier(name, target))
    sources = generate_linear(matrices, scalar, stiff=stiff)
    compile_and_pack(sources, {fmi: target}, chosen, job)
    renamed = _renamed(matrices, scalar)
    return ExportResult(
        model=scalar.name,
        file=target,
        fmi=fmi,
        dt=matrices.dt,
        n_states=len(matrices.state_names),
        n_inputs=len(scalar.references("input")),
        n_outputs=len(matrices.output_names),
        platforms=tuple(p.name for p in chosen),
        stiff=sources.stiff,
        renamed=renamed,
        notes=(
            *matrices.notes,
            *(varying.notes if varying is not None else ()),
            *(f"the state '{a}' is '{b}' in the FMU: the name is taken" for a, b in renamed.items()),
        ),
    )


def _varying(model: object) -> VaryingModel | None:
    """Return a parameter-varying model, also from its JSON file; None: it is something else."""
    if isinstance(model, VaryingModel):
        return model
    data = read_json(model) if isinstance(model, str | Path) else model
    if not isinstance(data, Mapping) or "scheduling" not in data:
        return None
    return VaryingModel.from_dict(data)


def check_linear_file(path: Path) -> None:
    """Refuse a file that `write_linear` could not write.

    Args:
        path: path of the file.

    Raises:
        InputError: another suffix than .json or .fmu, a folder that does not exist.
        BuildError: an FMU is wanted, and there is no compiler.
    """
    if path.suffix.lower() not in _FILES:
        raise InputError(f"'{path}' must end in one of {', '.join(_FILES)}")
    if file_to_write(path).suffix.lower() == ".fmu":
        require("ziglang")


def write_linear(linear: Mapping[str, Any], path: Path) -> None:
    """Write a linear model as JSON, one row of a matrix a line, or as an FMU.

    Args:
        linear: matrices and names, as `export` takes them.
        path: path of the file; its suffix says which.

    Raises:
        InputError: the file cannot be written.
        BuildError: the compiler is missing or failed.
    """
    if path.suffix.lower() == ".fmu":
        export_linear(linear, path)
        return
    rows = {k: [json.dumps(row) for row in linear[k]] for k in "ABCD"}
    matrices = [f'  "{k}": [\n    ' + ",\n    ".join(v) + "\n  ]" for k, v in rows.items()]
    rest = [f'  "{k}": {json.dumps(v)}' for k, v in linear.items() if k not in rows]
    with replacing(path) as part:
        part.write_text("{\n" + ",\n".join([*matrices, *rest]) + "\n}\n", encoding="utf-8")


def generate_linear(matrices: StateSpaceFile, scalar: ScalarModel, *, stiff: bool | None = None) -> Sources:
    """Generate all C and XML of a linear model.

    Args:
        matrices: the linear model.
        scalar: what :func:`~workbench.build.state_space.state_space` made of it.
        stiff: as in :func:`export_linear`.
    """
    return assemble(
        scalar,
        default_experiment(matrices),
        stiff=_is_stiff(matrices) if stiff is None else stiff,
        origin="a linear state-space model",
        naming=naming(scalar),
    )


def _renamed(matrices: StateSpaceFile, scalar: ScalarModel) -> dict[str, str]:
    kind = "discrete" if matrices.dt > 0.0 else "state"
    names = [v.name for v in scalar.variables if v.kind == kind and not v.output]
    return {a: b for a, b in zip(matrices.state_names, names, strict=True) if a != b}


def _identifier(name: str | None, target: Path) -> str:
    """Return the model's name: FMI wants an identifier of C."""
    if name is None:
        made = re.sub(r"[^A-Za-z0-9_]", "_", target.stem)
        return made if made[0].isalpha() else f"Model_{made}"
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise InputError(
            f"'{name}' cannot be the model's name: use letters, digits and underscores, and do not begin with a digit"
        )
    return name


def _is_stiff(matrices: StateSpaceFile) -> bool:
    return matrices.dt == 0.0 and bool(matrices.A.size) and is_stiff_matrix(matrices.A)
