"""Periodic motions, solved for: the period map with its derivative, and branches of its fixed points."""
