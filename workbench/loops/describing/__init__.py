"""Describing functions: what a nonlinear block does to the fundamental of a sine, as a function of its amplitude."""
