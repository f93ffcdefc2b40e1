"""Modes over a parameter: poles tracked through crossings, and where they become unstable (the flutter diagram)."""
