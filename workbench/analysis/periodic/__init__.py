"""Periodic motions, solved for: the period map with its derivative, Newton's method on it, and branches of its fixed points."""
