"""Sessions: advance a model in time under signals, save, restore and resume."""

from workbench.session.base import Record, Session, Snapshot

__all__ = ["Record", "Session", "Snapshot"]
