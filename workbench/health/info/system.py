"""Read what a system says of itself: its parts and how they are connected."""

from __future__ import annotations

from pathlib import Path

from workbench.health.info.result import PartFacts, SystemInfo, VariableFacts, WireFacts
from workbench.requests.kept import remember
from workbench.requests.model_facts import facts_of
from workbench.requests.origin import Origin
from workbench.system.description import (
    BlockComponent,
    Component,
    FmuComponent,
    FunctionComponent,
    GainComponent,
    LinearComponent,
    SumComponent,
)
from workbench.system.files.read import read_system
from workbench.system.load import load

__all__ = ["system_info"]


def system_info(path: str | Path) -> SystemInfo:
    """Return what a system says of itself.

    Args:
        path: as for `load`.
    """
    system = read_system(path)
    with load(path) as model:
        record = SystemInfo(
            model=system.name,
            interfaces=(model.interface,),
            solver=model.solver,
            runnable=True,
            components=tuple(PartFacts(c.name, _what(c)) for c in system.components),
            connections=tuple(
                WireFacts(c.destination, c.source, c.gain, c.offset, c.unit, c.closes_at) for c in system.connections
            ),
            inputs=VariableFacts.of(model.inputs),
            outputs=VariableFacts.of(model.outputs),
            parameters=VariableFacts.of(model.parameters),
            states=VariableFacts.of(model.states),
            notes=tuple(model.notes),
        )
        remember(record, Origin(models=(facts_of(model),)))
        return record


def _what(component: Component) -> str:
    """A component in a few words."""
    match component:
        case FmuComponent():
            return component.called or component.file
        case LinearComponent():
            kind = f"sampled at {component.dt:g} s" if component.dt > 0.0 else "continuous"
            return f"linear, {len(component.A)} states, {kind}"
        case GainComponent():
            return f"gain {component.gain:g}"
        case SumComponent():
            return f"sum {''.join('+' if s > 0 else '-' for s in component.signs)}"
        case FunctionComponent():
            return "Python function"
        case BlockComponent():
            return component.block.words
