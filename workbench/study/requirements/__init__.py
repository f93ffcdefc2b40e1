"""Kinds of requirements: one class each, in one table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.core.records.plug_ins import ExtensibleTable
from workbench.errors import InputError, suggest
from workbench.study.requirements.base import Requirement
from workbench.system.files.toml_schema import read_table

__all__ = ["KINDS", "read_requirement"]

# Name in a study file → module in this package and class. By name, so that a study loads what it uses and no more.
_HOME: Mapping[str, str] = {
    "gain": "response:Gain",
    "phase": "response:Phase",
    "offset": "response:Offset",
    "mask": "response:Mask",
    "bandwidth": "response:Bandwidth",
    "gain margin": "margins:GainMargin",
    "phase margin": "margins:PhaseMargin",
    "delay margin": "margins:DelayMargin",
    "disk margin": "margins:DiskMarginRequirement",
    "peak sensitivity": "margins:PeakSensitivity",
    "damping": "models:Damping",
    "pole frequency": "models:PoleFrequency",
    "stability": "models:StabilityRequirement",
    "h-infinity norm": "norms:HInfinityNorm",
    "h2 norm": "norms:H2Norm",
    "settling time": "step:SettlingTime",
    "overshoot": "step:Overshoot",
    "rise time": "step:RiseTime",
    "peak": "step:PeakRequirement",
    "final value": "step:FinalValue",
    "limit cycle amplitude": "limit_cycle:LimitCycleAmplitude",
    "limit cycle frequency": "limit_cycle:LimitCycleFrequency",
    "stable gains": "limit_cycle:StableGains",
    "fit": "models:FitRequirement",
    "agreement": "agreement:Agreement",
    "response agreement": "agreement:ResponseAgreement",
    "value": "value:AnyValue",
    "baseline": "baseline:Baseline",
}


def _wrong(name: str, held: Any) -> str:  # noqa: ANN401 - whatever a plug-in has
    del name  # in a study it has that of its entry point
    fits = isinstance(held, type) and issubclass(held, Requirement)
    return "" if fits else "is not a requirement, see workbench.study.requirements.base.Requirement"


KINDS: ExtensibleTable[type[Requirement]] = ExtensibleTable("requirements", _HOME, _wrong, within=__name__)


def read_requirement(data: object, where: str) -> Requirement:
    """Return what a table of [[requirements]] asks for.

    Args:
        data: as the TOML reader returns it.
        where: the table, for messages.

    Raises:
        InputError: an unknown kind or key (near names in the message), a missing one, a value of the wrong type.
    """
    if not isinstance(data, dict):
        raise InputError(f"{where}: must be a table with name, analysis and kind")
    kind = data.get("kind")
    if kind is None:
        raise InputError(f"{where}: key 'kind' is missing; known: {', '.join(KINDS)}")
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"{where}: kind {kind!r} is unknown; {suggest(str(kind), KINDS, most=len(KINDS))}")
    return read_table(KINDS[kind], data, where)
