"""Analyses: each sees models and sessions only, and returns a frozen result."""
