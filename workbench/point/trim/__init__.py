"""Trim: find an operating point at which a model is in equilibrium."""
