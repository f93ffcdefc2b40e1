"""Structured singular values: how large a structured perturbation a matrix, or a system over all frequencies, bears."""
