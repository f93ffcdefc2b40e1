"""Kinds of requirements: one class each, in one table."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.errors import InputError, suggest
from workbench.study.kinds.agreement import Agreement, ResponseAgreement
from workbench.study.kinds.bandwidth import Bandwidth
from workbench.study.kinds.base import Requirement
from workbench.study.kinds.fit import Fit
from workbench.study.kinds.limit_cycle import LimitCycleAmplitude, LimitCycleFrequency, StableGains
from workbench.study.kinds.margins import DelayMargin, DiskMargin, GainMargin, PeakSensitivity, PhaseMargin
from workbench.study.kinds.mask import Mask
from workbench.study.kinds.poles import Damping, PoleFrequency, Stability
from workbench.study.kinds.response import Gain, Offset, Phase
from workbench.study.kinds.step import FinalValue, Overshoot, Peak, RiseTime, SettlingTime
from workbench.study.kinds.value import AnyValue
from workbench.system.toml_schema import read_table

__all__ = ["KINDS", "read_requirement"]

KINDS: Mapping[str, type[Requirement]] = {
    "gain": Gain,
    "phase": Phase,
    "offset": Offset,
    "mask": Mask,
    "bandwidth": Bandwidth,
    "gain margin": GainMargin,
    "phase margin": PhaseMargin,
    "delay margin": DelayMargin,
    "disk margin": DiskMargin,
    "peak sensitivity": PeakSensitivity,
    "damping": Damping,
    "pole frequency": PoleFrequency,
    "stability": Stability,
    "settling time": SettlingTime,
    "overshoot": Overshoot,
    "rise time": RiseTime,
    "peak": Peak,
    "final value": FinalValue,
    "limit cycle amplitude": LimitCycleAmplitude,
    "limit cycle frequency": LimitCycleFrequency,
    "stable gains": StableGains,
    "fit": Fit,
    "agreement": Agreement,
    "response agreement": ResponseAgreement,
    "value": AnyValue,
}


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
        raise InputError(f"{where}: kind {kind!r} is unknown; {suggest(str(kind), KINDS)}")
    return read_table(KINDS[kind], data, where)
