"""Wiener, Hammerstein and Hammerstein–Wiener models: a linear block with static blocks before or behind it."""
