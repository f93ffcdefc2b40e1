"""Sessions: advance a model in time under signals, save, restore and resume."""

from workbench.session.base import Recorded, Session, Snapshot

__all__ = ["Recorded", "Session", "Snapshot"]
