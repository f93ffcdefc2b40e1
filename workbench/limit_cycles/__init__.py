"""Limit cycles of a loop with nonlinear blocks, and what removes them."""
