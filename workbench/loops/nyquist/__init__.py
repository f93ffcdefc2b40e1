"""Nyquist curves with true crossings: of the real axis, and of −1/N(A) of a nonlinear block."""
