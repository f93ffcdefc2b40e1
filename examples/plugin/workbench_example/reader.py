"""The reader of .lvm: LabVIEW's measurements, with one column of times."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.core.values.arrays import Floats
from workbench.errors import InputError

_END = "***End_of_Header***"


def read_lvm(path: Path) -> dict[str, Floats]:
    """Return name, with its unit in brackets → samples.

    Raises:
        InputError: the file is not made so.
    """
    head, found, body = path.read_text(encoding="utf-8-sig", errors="replace").rpartition(_END)
    if not found:
        raise InputError(f"{path}: has no line {_END}; export it as text (LVM) with a header")
    header = {line.split("\t")[0]: line.split("\t")[1:] for line in head.splitlines()}
    names, *rows = [line.split("\t") for line in body.splitlines() if line.strip()]
    signals = [name for name in names[1:] if name and name != "Comment"]
    values = np.array([row[: 1 + len(signals)] for row in rows]).astype(float)
    units = [*header.get("Y_Unit_Label", []), *[""] * len(signals)]
    headings = [f"{name} [{unit}]" if unit else name for name, unit in zip(signals, units, strict=False)]
    return {name: values[:, k] for k, name in enumerate(["time [s]", *headings])}
