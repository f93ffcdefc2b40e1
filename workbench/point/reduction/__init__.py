"""Smaller linear systems: balanced reduction, cancellation of poles and zeros, mirrored poles, low-pass."""
