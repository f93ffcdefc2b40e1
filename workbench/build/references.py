"""Reference results for an FMU that was built: an experiment, an accurate solution and its error (FMI-LS-REF)."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from workbench.core.machine.files import pack
from workbench.core.records.csv_file import write_csv
from workbench.core.values.arrays import Floats
from workbench.errors import BuildError, WorkbenchError
from workbench.health.check.subject import CheckedFmu
from workbench.health.references.declared import EXPERIMENTS, FOLDER, MANIFEST, ROLE
from workbench.model.load import FmuModel, load
from workbench.response.simulate.request import simulate

__all__ = ["add_references"]

_LOOSE, _TIGHT = 1e-8, 1e-10  # relative tolerances: their difference is the error of the first
_DIGITS = 10
_NAME = "response"
_LEAST = 1e-9  # error that is stated at least: solvers do not get below it for certain


def add_references(file: Path) -> float:
    """Run an FMU that was built, and pack the results into it; return their error, relative to the ranges.

    Every continuous input jumps at the start by a twentieth of its size and stands still, as for `check`, so that the
    results do not depend on how inputs are taken between communication points. Time is that of the default experiment,
    500 steps at most. The run has the relative tolerance 1e-10; the error is the largest difference from one with 1e-8,
    at least 1e-9, and becomes the tolerance of the experiment.

    Args:
        file: an FMU for model exchange with a binary for this machine; it is written anew.

    Raises:
        BuildError: it cannot be run here.
    """
    try:
        with load(file, "me", tolerance=_TIGHT) as model:
            subject = CheckedFmu(model)
            times: Floats = subject.start + subject.step * np.arange(subject.steps + 1.0)
            levels = {name: signal.value for name, signal in subject.constants().items()}
            fine = _run(model, subject, times)
        with load(file, "me", tolerance=_LOOSE) as model:
            rough = _run(model, subject, times)
    except WorkbenchError as why:
        raise BuildError(f"{file}: its reference results cannot be computed: {why}") from None
    moved, large = np.ptp(fine, axis=0), np.abs(fine).max(axis=0)
    size = np.where(moved > _LEAST * large, moved, np.where(large > 0.0, large, 1.0))
    # Where an event falls between two points of either run, one step apart, values jump: neighbours tell.
    gaps = np.abs(fine - rough) / size
    error = max(_LEAST, float(np.minimum(gaps[1:], gaps[:-1]).max(initial=0.0)))
    rows = [["time", *subject.names], *([t, *values] for t, values in zip(times.tolist(), fine.tolist(), strict=True))]
    start, stop = float(times[0]), float(times[-1])
    tables = {"response.csv": rows}
    if levels:
        tables["inputs.csv"] = [["time", *levels], [start, *levels.values()]]
    setting = f'startTime="{start!r}" stopTime="{stop!r}" stepSize="{subject.step!r}"'
    _packed(file, {name: _text(table) for name, table in tables.items()}, setting, error)
    return error


def _run(model: FmuModel, subject: CheckedFmu, times: Floats) -> Floats:
    """Return the right limits at the times, shape (n, k)."""
    found = simulate(
        model, start_time=subject.start, stop=float(times[-1]), inputs=dict(subject.constants()),
        outputs=list(subject.names), points=times[1:].tolist(),
    )  # fmt: skip
    rows = np.searchsorted(found.time, times, side="right") - 1
    return np.column_stack([found.signals[name][rows] for name in subject.names])


def _text(rows: list[list[object]]) -> bytes:
    """Return a table as a CSV file, with the digits that are told."""
    text = io.StringIO()
    write_csv(text, [[f"{c:.{_DIGITS}g}" if isinstance(c, float) else c for c in row] for row in rows])
    return text.getvalue().encode()


def _packed(file: Path, tables: Mapping[str, bytes], setting: str, error: float) -> None:
    """Write the FMU anew, with the tables, the experiment and the manifest."""
    stimuli = '<Stimuli source="inputs.csv"/>' if "inputs.csv" in tables else ""
    words = f"solution with an error of at most {error:.1e} of each variable's range"
    experiment = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<Experiments name="reference">\n  <Experiment name="{_NAME}" description={quoteattr(words)} '
        f'tolerance="{error:.1e}">\n    <TransientSimulation {setting}/>\n    {stimuli}'
        '<References source="response.csv"/>\n  </Experiment>\n</Experiments>\n'
    ).encode()
    files = {"reference.exp": experiment, **tables}
    kinds = {"reference.exp": (EXPERIMENTS, "experiment/smoke-test")}
    related = "".join(
        f'  <Related type="{kind}" source="{name}" role="{role}" checksum="{hashlib.sha3_256(data).hexdigest()}"/>\n'
        for name, data in files.items()
        for kind, role in [kinds.get(name, ("text/csv", ROLE if name == "response.csv" else "other"))]
    )
    manifest = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiReferences xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest"\n'
        '  fmi-ls:fmi-ls-name="org.fmi-standard.fmi-ls-ref" fmi-ls:fmi-ls-version="1.0.0-beta.1"\n'
        '  fmi-ls:fmi-ls-description="Layered Standard providing information on related files included in an FMU.">\n'
        f"{related}</fmiReferences>\n"
    ).encode()
    with zipfile.ZipFile(file) as archive:
        known = {n: archive.read(n) for n in archive.namelist() if not n.startswith(f"{FOLDER}/") and n[-1] != "/"}
    pack(file, known | {f"{FOLDER}/{name}": data for name, data in {MANIFEST: manifest, **files}.items()})
