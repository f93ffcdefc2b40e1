"""Load a model from a file."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections import OrderedDict
from dataclasses import KW_ONLY, field, replace
from pathlib import Path
from typing import Any

from workbench.core.machine.locks import forkable_lock
from workbench.core.machine.scratch import scratch
from workbench.core.records.option import values_of, with_options
from workbench.errors import FmuError, InputError, suggest
from workbench.fmi.archive import Unpacked, unpack
from workbench.fmi.binding import VERSIONS
from workbench.fmi.description import ModelDescription
from workbench.fmi.instance import Instance, loaded
from workbench.fmi.library import Library
from workbench.fmi.platforms import binary_path
from workbench.fmi.reading import read_description
from workbench.fmi.structure import structural_values
from workbench.fmi.ticking import time_based
from workbench.kernel.gear import why_missing
from workbench.kernel.library import intermediate_update
from workbench.model.content_hash import content_hash, files_of, hash_of
from workbench.model.described_model import DescribedModel, LoadRecipe
from workbench.model.loading import DEFAULT_TOLERANCE, Loading
from workbench.model.starts import check_biases, check_starts
from workbench.session.directional import newton_note
from workbench.session.setup import Setup

__all__ = [
    "FmuModel",
    "FmuRecipe",
    "choose_solver",
    "experiment_notes",
    "load",
    "load_fmu",
    "silent_clocks",
    "start_of",
]

SOLVERS = ("gear", "vkm", "none")


class FmuModel(DescribedModel):
    """One FMU with a chosen interface and solver; made by `load`.

    Args:
        unpacked: the FMU as a folder; the model owns it from now on.
        description: what that FMU says about itself.
        interface: "me" or "cs", one of those offered.
        setup: how sessions begin; who opens instances is put in here.
        notes: remarks for the user.
        recipe: how to load it again.
    """

    recipe: FmuRecipe

    def __init__(
        self,
        unpacked: Unpacked,
        description: ModelDescription,
        *,
        interface: str,
        setup: Setup,
        notes: tuple[str, ...],
        recipe: FmuRecipe,
    ) -> None:
        super().__init__(
            description,
            source=str(unpacked.source),
            interface=interface,
            setup=setup,
            notes=notes,
            recipe=recipe,
        )
        self._unpacked = unpacked
        self._folder = unpacked.folder.resolve()
        self._binary: Library | None = None

    def new_instance(self) -> Instance:
        instance = VERSIONS[self.description.major](
            self.description,
            self._folder,
            interface=self.interface,
            source=self.source,
            library=None if self._binary is None else self._binary.held(),
            event_mode=not self._setup.manners.other_order,
            update=intermediate_update() if self.interface == "cs" else None,
        )
        if self._binary is None and not instance.capabilities.once_per_process:  # stays loaded between sessions
            self._binary = instance.library.held()
        return instance

    def why_not_loaded(self) -> str:
        """Return why the system cannot load the binary; empty: it can."""
        try:
            loaded(self.description, self._folder, self.interface, self.source).close()
        except FmuError as error:
            return str(error)
        return ""

    def close(self) -> None:
        super().close()
        if self._binary is not None:
            self._binary.close()
        self._unpacked.close()


def load_fmu(path: str | Path, request: Loading, called: str = "") -> FmuModel:
    """Load an FMU.

    Args:
        path: an `.fmu` file, the folder of an unpacked FMU, `fmu:NAME` or `fmu:NAME@3`.
        request: how.
        called: what the user calls it, where that is not its path.

    Returns:
        The model; close it, or use it in a `with` block, to remove its temporary folder.

    Raises:
        InputError: no such file, interface, solver, variable; a value out of range.
        FmuError: the file is not a usable FMU, or has no binary for this platform.
    """
    unpacked = unpack(path, called)
    try:
        recipe = FmuRecipe(
            source=called or str(unpacked.source.absolute()),
            file=str(path) if called else "",
            folder=str(unpacked.folder.absolute()),
            **values_of(request),
        )
        return open_unpacked(unpacked, recipe)
    except BaseException:
        unpacked.close()
        raise


load = with_options(
    Loading,
    load_fmu,
    name="load",
    first=("path", "str | Path", "An `.fmu` file, the folder of an unpacked FMU, `fmu:NAME` or `fmu:NAME@3`."),
)


class FmuRecipe(LoadRecipe):
    """An FMU and what `load` was told.

    Attributes:
        source: what the user named, for messages.
        file: the path of the FMU, if `source` only names it (a part of an unpacked package); empty: `source`.
        folder: where it is unpacked; the loading process owns it.
        archive: the FMU itself as a zip archive, in place of `folder`; None: use the folder.
        sha256: of the FMU, told along with the archive; empty: read the file.
    """

    _: KW_ONLY
    folder: str
    file: str = ""
    archive: bytes | None = field(default=None, repr=False)
    sha256: str = ""

    @property
    def path(self) -> Path:
        """Where the FMU is."""
        return Path(self.file or self.source)

    def open(self) -> FmuModel:
        unpacked = self._unpacked()
        try:
            return open_unpacked(unpacked, self)
        except BaseException:
            unpacked.close()
            raise

    def _unpacked(self) -> Unpacked:
        if self.archive is None:
            if not Path(self.folder).is_dir():
                raise FmuError(f"{self.source}: the folder in which it was unpacked is gone; was the model closed?")
            return Unpacked(Path(self.source), Path(self.folder), owned=False)
        unpacked = _unpack_bytes(self.archive)
        unpacked.source = Path(self.source)
        return unpacked

    def identity(self) -> dict[str, Any]:
        return {"fmu": content_hash(self.path), **self.settings()}

    def content(self) -> str:
        if self.sha256:
            return self.sha256
        try:
            return hash_of(self.path)
        except InputError:  # removed since it was loaded
            return ""

    def packed(self) -> FmuRecipe:
        return replace(self._with_archive(), sha256=self.content())

    def settled(self) -> FmuRecipe:
        if self.archive is None:
            return self
        key = self.sha256 or hashlib.sha256(self.archive).hexdigest()
        with _settling:
            if key not in _settled:
                _settled[key] = _unpack_bytes(self.archive)
            _settled.move_to_end(key)
            while len(_settled) > _MOST_SETTLED:
                _settled.popitem(last=False)[1].close()
            return replace(self, folder=str(_settled[key].folder.absolute()), archive=None)

    def _with_archive(self) -> FmuRecipe:
        if self.path.is_file():  # with the binaries of other platforms, which were not unpacked here
            return replace(self, archive=self.path.read_bytes())
        buffer = io.BytesIO()
        folder = Path(self.folder)
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for file in files_of(folder):
                archive.write(file, file.relative_to(folder).as_posix())
        return replace(self, archive=buffer.getvalue())


# FMUs that came packed, by the SHA-256 of the archive.
_settled: OrderedDict[str, Unpacked] = OrderedDict()
_settling = forkable_lock()
_MOST_SETTLED = 64


def _unpack_bytes(archive: bytes) -> Unpacked:
    with scratch("packed") as holder:
        file = holder / "packed.fmu"
        file.write_bytes(archive)
        return unpack(file)


def open_unpacked(unpacked: Unpacked, recipe: FmuRecipe) -> FmuModel:
    """Return the model that `recipe` describes, on an FMU that is unpacked already.

    Args:
        unpacked: the FMU; the model owns it from now on.
        recipe: what `load` was told.

    Raises:
        InputError, FmuError: see `load`.
    """
    source = str(unpacked.source)
    description = read_description(unpacked.folder, source=source)
    if sizes := structural_values(description, recipe.start_values):
        description = read_description(unpacked.folder, source=source, structure=sizes)
    chosen = _choose_interface(recipe.interface, description, source)
    if recipe.hold_inputs and chosen != "cs":
        raise InputError("hold_inputs: only co-simulation holds inputs between points; use interface cs")
    binary_path(unpacked.folder, description.interfaces[chosen].identifier, source=source)
    name, note = _choose_solver(recipe.solver, chosen, description)
    variables = {v.name: v for v in description.variables}
    bias = check_biases(recipe.bias, variables, description.units)
    setup = Setup(
        variables=variables,
        start_values=check_starts(
            recipe.start_values, variables, description.enumerations, description.units, what="start_values"
        ),
        bias=bias,
        rtol=recipe.tolerance or description.experiment.tolerance or DEFAULT_TOLERANCE,
        tolerance=recipe.tolerance or description.experiment.tolerance,
        start_time=start_of(recipe, description),
        step=recipe.step,
        hold_inputs=recipe.hold_inputs,
        solver=name,
    )
    choices = [
        *_notes(recipe.interface, chosen, description, recipe.step),
        *(_course_of_inputs(description, hold=recipe.hold_inputs) if chosen == "cs" else ()),
        *experiment_notes(recipe, description),
        *filter(None, [note]),
    ]
    notes = (*description.notes, *choices)
    return FmuModel(
        unpacked, description, interface=chosen, setup=setup, notes=notes, recipe=replace(recipe, bias=bias)
    )


def start_of(recipe: LoadRecipe, description: ModelDescription) -> float:
    """Return the time at which sessions begin [s]: what was asked for, else that of the default experiment, else 0."""
    start = description.experiment.start_time if recipe.start is None else recipe.start
    return start or 0.0


def experiment_notes(recipe: LoadRecipe, description: ModelDescription) -> list[str]:
    """Return what the default experiment decides where nothing was asked for, as far as it is not usual."""
    given, notes = description.experiment, []
    if recipe.start is None and given.start_time:
        notes.append(f"start: {given.start_time:g} s, from the FMU's default experiment; `start` changes it")
    if recipe.tolerance is None and given.tolerance not in (None, DEFAULT_TOLERANCE):
        notes.append(f"tolerance: {given.tolerance:g}, from the FMU's default experiment; `tolerance` changes it")
    return notes


def _choose_interface(wanted: str, description: ModelDescription, source: str) -> str:
    offered = description.interfaces
    if not offered and description.scheduled is not None:
        raise InputError(
            f"{source}: offers scheduled execution alone: when its parts run is for a scheduler to say, not for the "
            "FMU, so it cannot be analysed by itself; export it for co-simulation or model exchange"
        )
    if not offered:
        raise InputError(f"{source}: offers neither model exchange nor co-simulation")
    if wanted == "auto":
        return "me" if "me" in offered else "cs"
    if wanted not in offered:
        raise InputError(f"{source}: interface {wanted} is not offered; it has: {', '.join(offered)}")
    return wanted


def _choose_solver(wanted: str, interface: str, description: ModelDescription) -> tuple[str, str]:
    if interface == "me":
        return choose_solver(wanted, description)
    if wanted not in ("auto", "fmu"):
        raise InputError(f"solver {wanted}: a co-simulation FMU brings its own; leave solver at auto")
    return "fmu", ""


def choose_solver(wanted: str, description: ModelDescription) -> tuple[str, str]:
    """Return the name of the solver of model exchange, and a note about it (may be empty).

    Args:
        wanted: its name, or "auto".
        description: of an FMU or a system.

    Raises:
        InputError: unknown name.
        FmuError: `gear` is wanted where its libraries are missing.
    """
    states = description.state_count
    if wanted != "auto" and wanted not in SOLVERS:
        raise InputError(f"solver '{wanted}' is unknown; {suggest(wanted, ('auto', *SOLVERS))}")
    if states == 0:
        return "none", "solver: none, the model has no continuous states"
    if wanted == "none":
        raise InputError(f"solver none: the model has {states} continuous states; use vkm or gear")
    missing = why_missing()
    if wanted == "gear" and missing:
        raise FmuError(f"solver gear is not available: {missing}; use solver vkm")
    if wanted == "auto" and missing:
        return "vkm", f"solver: vkm, because gear is not available: {missing}"
    chosen = "solver: gear (chosen by auto)" if wanted == "auto" else ""
    name = "gear" if wanted == "auto" else wanted
    return name, "; ".join(filter(None, (chosen, newton_note(description) if name == "gear" else "")))


def silent_clocks(description: ModelDescription, interface: str) -> list[str]:
    """Return notes on clocks that do not tick although something depends on them."""
    driven, claims = time_based(description.clocks), description.interfaces[interface]
    waiting = [name for name, c in description.clocks.items() if c.causality == "input" and name not in driven]
    notes = [f"triggered by nothing here, these clocks never tick: {', '.join(waiting)}"] if waiting else []
    if driven and interface == "cs" and not claims.event_mode:
        notes.append(f"without event mode, which its co-simulation does not have, no clock ticks: {', '.join(driven)}")
    return notes


def _course_of_inputs(description: ModelDescription, *, hold: bool) -> list[str]:
    """Say what a co-simulation sees of its continuous inputs inside a step, where that is not their course."""
    claims = description.interfaces["cs"]
    takes = claims.interpolates_inputs or (claims.intermediate_update and bool(description.intermediate))
    if not any(v.is_continuous_input for v in description.variables) or (takes and not hold):
        return []
    if hold or not claims.variable_step:
        why = "as asked" if hold else "since the FMU wants a constant step, at which it may sample them"
        return [
            f"inputs: held over a communication step at their value at its start, {why}: half a step late on average"
        ]
    return ["inputs: held over a communication step at their value in its middle; the FMU does not ask how they go on"]


def _notes(wanted: str, chosen: str, description: ModelDescription, step: float | None) -> list[str]:
    notes = []
    if wanted == "auto" and len(description.interfaces) > 1:
        notes.append(f"interface: {chosen} (chosen by auto; it has: {', '.join(description.interfaces)})")
    if chosen == "cs" and step is None:
        default = description.experiment.step
        notes.append(
            "communication step: derived from the signals and points; `step` changes it"
            if default is None
            else f"communication step: {default:g} s, from the FMU's default experiment; `step` changes it"
        )
    claims = description.interfaces[chosen]
    notes += silent_clocks(description, chosen)
    if claims.needs_tool:
        notes.append("the FMU says that it needs its authoring tool installed on this machine")
    return notes
