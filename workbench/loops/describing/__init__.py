"""Describing functions: what a nonlinear block does to the fundamental of a sine, over its amplitude."""
