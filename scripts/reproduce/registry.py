"""All experiments, and which one measures which target."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from types import MappingProxyType

from scripts.reproduce.measurement import Reproduction

__all__ = ["MODULES", "experiments"]

# One a chapter or part of it; each holds a tuple EXPERIMENTS.
MODULES = (
    "chapter3_hybrid",
    "chapter3",
    "chapter4",
    "chapter4_rudder",
    "chapter6",
    "chapter6_identification",
    "chapter7",
    "chapter8",
    "chapter8_simulated",
    "chapter8_feedback",
    "chapter8_feed_forward",
)


@cache
def experiments() -> Mapping[str, Reproduction]:
    """Return all experiments by name, in the order of the source report."""
    found = [e for module in MODULES for e in import_module(f"scripts.reproduce.{module}").EXPERIMENTS]
    return MappingProxyType({e.name: e for e in found})
